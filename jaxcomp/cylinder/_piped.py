"""Rounds of march and Newton's method for cycles behind pipes."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from .._core.extremes import max_of, min_of
from ._border import Both, limited, newton
from ._evaluation import CycleSolution
from ._options import COARSE, CycleOptions
from ._panels import resolution
from ._revolutions import START, march
from ._several import NEAR
from ._system import Cylinders
from ._waves import WIDEST, waves_at_rest

# From nothing six pipes up to 17 % of pulsation took up to 3 rounds, others up to 37 % took 5.
_ROUNDS = 6


def piped_rounds(
    system: Cylinders, options: CycleOptions, start: CycleSolution | None, lay, no_solution
) -> CycleSolution:
    """March and Newton's method in turns, the waves from nothing or from a start.

    Where Newton's method leaves the sequence of the valves, so much of its first step of the waves is
    followed as is safe, and the next march meets them.

    Args:
        system: the cylinders.
        options: of the solver.
        start: of a similar machine.
        lay: panels after a march, see `_solve._laid`.
        no_solution: solution before the first round.
    """
    has_start = jnp.asarray(False) if start is None else start.solved
    few = min(8, options.revolutions_at_most)
    max_rounds = max(options.max_rounds, _ROUNDS)

    def advance(carry):
        state, flags, waves, watched, previous, rounds = carry
        ready = rounds < 0
        tolerance = options.march_tolerance_of(rounds)
        repeat = 100 * tolerance
        is_marched = ~(previous.solved | ready)
        behind = system.with_waves(waves)
        end = march(
            behind, options, tolerance, repeat, state, flags, is_marched, few, tuple(watched)
        )
        laid = *lay(end, options), end.totals, end.change <= repeat
        if start is not None:
            of_start = start.mesh, start.z, start.events, start.totals, start.repeats
            laid = jax.tree.map(partial(jnp.where, ready), of_start, laid)
        mesh, z, events, totals, repeats = laid
        tolerances = options.tolerance, options.max_newton
        cycle_and_waves, report = newton(system, mesh, Both(z, waves), *tolerances)
        sound = mesh.fits & (report.size < NEAR)
        # harmonics of panels that are too wide are no more exact
        wide = max_of(jnp.diff(cycle_and_waves.panels.edges)) * system.orders / 2 > WIDEST
        coarse = sound & report.holds & ((resolution(cycle_and_waves.panels) > COARSE) | wide)
        coarse &= options.may_grow
        mesh = mesh._replace(fits=mesh.fits & ~coarse)
        solution = CycleSolution(
            mesh=mesh,
            z=cycle_and_waves.panels,
            marched=z,
            totals=totals,
            solved=sound & report.holds & ~coarse,
            residual=report.size,
            steps=report.steps,
            revolutions=previous.revolutions + end.revolutions,
            passes=previous.passes + end.passes,
            events=events,
            repeats=repeats,
            alternates=jnp.asarray(False),
            waves=cycle_and_waves.waves,
        )
        least = min_of(cycle_and_waves.panels.left[:, system.columns(0, 1)])
        goes_on = sound & (least > 0.01)
        state = jnp.where(goes_on, cycle_and_waves.panels.left[0], end.state)
        flags = jnp.where(goes_on, mesh.flags[0], end.flags)
        followed = limited(system, waves, report.first)
        choose = partial(jnp.where, goes_on)
        waves = jax.tree.map(choose, cycle_and_waves.waves, followed)
        watched = watched.at[rounds].set(jnp.where(goes_on, report.left_at, jnp.inf))
        usable = end.ended & mesh.fits
        rounds = jnp.where(usable, rounds + 1, max_rounds)
        return state, flags, waves, watched, solution, rounds

    def going_on(carry):
        *_, solution, rounds = carry
        return ~solution.solved & (rounds < max_rounds)

    state, flags = system.initial(START)
    waves = waves_at_rest(system.cases.cylinder)
    if start is not None:
        no_solution = no_solution._replace(revolutions=start.revolutions, passes=start.passes)
        assert start.waves is not None
        waves = jax.tree.map(partial(jnp.where, start.solved), start.waves, waves)
    no_solution = no_solution._replace(waves=waves)
    watched = jnp.full(max_rounds, jnp.inf)
    begin = state, flags, waves, watched, no_solution, -1 * has_start
    return lax.while_loop(going_on, advance, begin)[4]
