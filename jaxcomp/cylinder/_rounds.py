"""Rounds of march and Newton's method, until the sequence of events stands."""

from abc import abstractmethod
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import min_of
from ._cycle_collocation import NewtonReport, PanelEquations, newton
from ._cycle_evaluation import CycleSolution
from ._cycle_options import COARSE, CycleOptions
from ._cylinder_system import Cylinders
from ._event_panels import RESOLVED, Mesh, Unknowns, is_edge, lay_mesh, resolution
from ._gas_balance import EVENTS, FLAGS, Accounts
from ._march import Record
from ._revolutions import START, TURN, March, march
from ._several import NEAR

# [rad] Distance of a kink of the rates from the nearest edge beyond which more panels are taken. Two
# kinks of a port that chokes for a moment, 5 degrees from an edge, cost 3e-4 of the flow.
_FAR_KINK = 0.02


def count_events(record: Record) -> Int[Array, "2"]:
    """Events of the suction and of the discharge valves in the revolution of a record.

    The given angles of unloaders, which want panels as well, count as those of suction valves.
    """
    happens = jnp.isfinite(record.angle) & is_edge(record)
    discharge = (record.event >= 0) & (record.event % EVENTS >= EVENTS // 2)
    return jnp.stack([jnp.sum(happens & ~discharge), jnp.sum(happens & discharge)])


def laid(
    system: Cylinders, end: March, options: CycleOptions
) -> tuple[Mesh, Unknowns, Int[Array, "2"]]:
    """Panels after a march, whether they have room for it among them, and the events of the valves.

    Args:
        system: the cylinders that were marched.
        end: of the march.
        options: of the solver.
    """
    kinks = system.choking_margins
    layout = lay_mesh(end.record, options.panel_count, options.panel_nodes, kinks)
    events = count_events(end.record)
    # a record that is not complete counts as one step too many
    steps = jnp.where(end.complete, 0, options.kept_steps + 1)
    fits = layout.mesh.fits & options.has_room(jnp.sum(events), steps)
    if options.may_grow and options.method == "collocation":
        # more panels have an edge for every kink; a march needs none there
        fits &= layout.kink_distance < _FAR_KINK
    return layout.mesh._replace(fits=fits), layout.unknowns, events


def blank_solution(count: int, states: int, options: CycleOptions) -> CycleSolution:
    """Solution of `count` cylinders before the first round."""
    p = options.panel_count
    s = options.panel_nodes
    none = jnp.zeros((), int)
    flat = jnp.zeros(p, int)
    mesh = Mesh(jnp.zeros((p, FLAGS * count), int), flat, flat, jnp.asarray(False))
    edges = START + TURN * jnp.linspace(0.0, 1.0, p + 1)
    z = Unknowns(jnp.zeros((p, s + 1, states)), jnp.zeros((p, states)), edges)
    totals = jnp.zeros((count, len(Accounts._fields)))
    solved = jnp.asarray(False)
    return CycleSolution(
        mesh=mesh,
        z=z,
        marched=z,
        totals=totals,
        solved=solved,
        residual=jnp.zeros(()),
        steps=none,
        revolutions=none,
        passes=none,
        events=jnp.zeros(2, int),
        repeats=jnp.asarray(False),
        alternates=jnp.asarray(False),
    )


class Approach(NamedTuple):
    """A step of the waves towards those of the flows of a march.

    Attributes:
        goes_on: whether another march is to follow before Newton's method is asked.
        waves: those it is to meet.
        size: [-] of the step.
    """

    goes_on: Bool[Array, ""]
    waves: Any
    size: Float[Array, ""]


class AbstractLines(eqx.Module):
    """The lines as the rounds meet them: with waves that are unknown beside the panels, or none."""

    def prepared(self, system: Cylinders) -> "AbstractLines":
        """These lines with what all rounds share."""
        del system
        return self

    @abstractmethod
    def rounds(self, options: CycleOptions) -> int:
        """Rounds at most."""

    @abstractmethod
    def waves_at_rest(self, system: Cylinders) -> Any:
        """Waves before the first round."""

    @abstractmethod
    def marched(self, system: Cylinders, waves) -> Cylinders:
        """The cylinders of a march."""

    @abstractmethod
    def solve(
        self, system: Cylinders, mesh: Mesh, z: Unknowns, waves, options: CycleOptions
    ) -> tuple[Unknowns, Any, NewtonReport]:
        """Panels and waves by Newton's method."""

    @abstractmethod
    def is_coarse(self, system: Cylinders, z: Unknowns) -> Bool[Array, ""]:
        """Whether panels resolve too little."""

    def revolutions(self, system: Cylinders, count: int, memory) -> int | Int[Array, ""]:
        """Revolutions of a march at most."""
        del system, memory
        return count

    def memory(self, waves) -> Any:
        """Memory before the first round."""
        del waves

    def approach(
        self, system: Cylinders, mesh: Mesh, z: Unknowns, waves, memory
    ) -> Approach | None:
        """Step of the waves by what earlier rounds have found out; `None` of lines without any."""
        del system, mesh, z, waves, memory

    def remembered(self, memory, approach: Approach | None, report: NewtonReport) -> Any:
        """Memory after a round."""
        del memory, approach, report

    @abstractmethod
    def next_waves(self, goes_on, waves, new, report: NewtonReport) -> Any:
        """Waves of the next round.

        Args:
            goes_on: whether Newton's method came near a cycle.
            waves: before it.
            new: after it.
            report: its own.
        """


class ConstantLines(AbstractLines):
    """Lines of constant pressure, and plenums."""

    def rounds(self, options):
        return options.max_rounds

    def waves_at_rest(self, system):
        return None

    def marched(self, system, waves):
        return system

    def solve(self, system, mesh, z, waves, options):
        equations = PanelEquations(system, mesh)
        new, report = newton(equations, z, options.tolerance, options.max_newton)
        return new, None, report

    def is_coarse(self, system, z):
        return resolution(z, system.columns(*RESOLVED)) > COARSE

    def next_waves(self, goes_on, waves, new, report):
        return None


def _unless_marched(mesh: Mesh, approach: Approach | None) -> Mesh:
    """Panels that Newton's method leaves alone where another march follows."""
    if approach is None:
        return mesh
    # Newton's method takes no step on panels that do not fit
    return mesh._replace(fits=mesh.fits & ~approach.goes_on)


def rounds_of(
    system: Cylinders, options: CycleOptions, start: CycleSolution | None, lines: AbstractLines
) -> CycleSolution:
    """March and Newton's method in turns: where Newton leaves the sequence, march from there.

    If there is a start, the first round takes its panels instead of a march.

    Args:
        system: the cylinders.
        options: of the solver.
        start: of a similar machine.
        lines: on which the cylinders work.
    """
    lines = lines.prepared(system)
    has_start = jnp.asarray(False) if start is None else start.solved
    max_rounds = lines.rounds(options)
    # further revolutions cost more than another round
    few = min(8, options.revolutions_at_most)

    def advance(carry):
        state, flags, waves, watched, memory, previous, is_lost, rounds = carry
        ready = rounds < 0
        tolerance = options.march_tolerance_of(rounds)
        repeat = 100 * tolerance  # Newton's method closes the rest
        is_marched = ~(previous.solved | ready)
        marched = lines.marched(system, waves)
        end = march(
            marched,
            options,
            tolerance,
            repeat,
            state,
            flags,
            is_marched,
            lines.revolutions(system, few, memory),
            tuple(watched),
            # a start that is near enough without it is nearer, since settling leaves out what necks mix
            settles=is_lost & (rounds == 1),
        )
        after_march = *laid(marched, end, options), end.totals, end.change <= repeat
        if start is not None:
            of_start = start.mesh, start.z, start.events, start.totals, start.repeats
            after_march = jax.tree.map(partial(jnp.where, ready), of_start, after_march)
        mesh, z, events, totals, repeats = after_march
        approach = lines.approach(system, mesh, z, waves, memory)
        tried = _unless_marched(mesh, approach)
        new, new_waves, report = lines.solve(system, tried, z, waves, options)
        sound = tried.fits & (report.size < NEAR)
        coarse = sound & report.holds & lines.is_coarse(system, new) & options.may_grow
        # panels that resolve too little are too few
        mesh = mesh._replace(fits=mesh.fits & ~coarse)
        solution = CycleSolution(
            mesh=mesh,
            z=new,
            marched=z,
            totals=totals,
            solved=sound & report.holds & ~coarse,
            residual=report.size,
            steps=report.steps,
            revolutions=previous.revolutions + end.revolutions,
            passes=previous.passes + end.passes,
            events=events,
            repeats=repeats,
            # Newton's method may find the state between two revolutions all the same
            alternates=jnp.asarray(False),
            waves=new_waves,
        )
        # a root with hardly any gas in a cylinder solves the equations, but no march may begin
        # there; any other one is nearer to the cycle than the end of the march, though its
        # branches may not hold
        least = min_of(new.left[:, system.columns(0, 1)])
        goes_on = sound & (least > 0.01)
        state = jnp.where(goes_on, new.left[0], end.state)
        flags = jnp.where(goes_on, mesh.flags[0], end.flags)
        waves = lines.next_waves(goes_on, waves, new_waves, report)
        memory = lines.remembered(memory, approach, report)
        number = rounds + 1
        is_lost = ~goes_on
        if approach is not None:
            is_lost &= ~approach.goes_on
            waves = jax.tree.map(partial(jnp.where, approach.goes_on), approach.waves, waves)
            number = jnp.where(approach.goes_on, rounds, number)
        # a step of the march may have dipped there beyond an event and out again; that of a start is
        # noted in the last row, which no other round reads
        watched = watched.at[rounds].set(jnp.where(goes_on, report.left_at, jnp.inf))
        # a march that broke off or lacks room would do so again in every round: the next size is
        # for that
        usable = end.ended & mesh.fits
        rounds = jnp.where(usable, number, max_rounds)
        return state, flags, waves, watched, memory, solution, is_lost, rounds

    def going_on(carry):
        *_, solution, _, rounds = carry
        return ~solution.solved & (rounds < max_rounds)

    state, flags = system.initial(START)
    no_solution_yet = _before_first_round(system, options, start, lines)
    waves = no_solution_yet.waves
    watched = jnp.full(max_rounds, jnp.inf)
    memory = lines.memory(waves)
    lost = jnp.asarray(False)
    # with a start the rounds begin at -1, which takes its panels as they are
    begin = state, flags, waves, watched, memory, no_solution_yet, lost, -1 * has_start
    return lax.while_loop(going_on, advance, begin)[5]


def _before_first_round(
    system: Cylinders, options: CycleOptions, start: CycleSolution | None, lines: AbstractLines
) -> CycleSolution:
    """No solution, with the waves that a start has and with what it took to find it."""
    waves = lines.waves_at_rest(system)
    blank = blank_solution(system.count, system.size, options)
    if start is None:
        return blank._replace(waves=waves)
    waves = jax.tree.map(partial(jnp.where, start.solved), start.waves, waves)
    return blank._replace(waves=waves, revolutions=start.revolutions, passes=start.passes)
