"""Pipes behind the flanges as the rounds of march and Newton's method meet them."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import max_of
from ._border import (
    BorderEquations,
    Both,
    blank_border,
    chord_step,
    fixed_responses,
    limited,
)
from ._cycle_collocation import newton
from ._cycle_options import COARSE
from ._event_panels import RESOLVED, resolution
from ._quadrature import is_too_wide
from ._rounds import AbstractLines, Approach
from ._waves import waves_at_rest

# From nothing six pipes up to 17 % of pulsation took up to 3 rounds, others up to 37 % took 5.
_ROUNDS = 6
# [-] Step of the waves below which Newton's method is asked, and marches before it at most.
_SETTLED = 5e-5
_MOST_MARCHES = 8
# A step that is not this much smaller than the second before it wants equations that are linearised anew.
# The one before says less: a march of one revolution has not forgotten where it began.
_SHRINKING = 0.5


class Memory(NamedTuple):
    """Linearised equations of the waves that rounds remember.

    Attributes:
        border: factors of the condensed equations.
        is_linearised: whether there were any.
        sizes: [-] of the second last step with them and of the last.
        marches: steps with them, each after a march.
    """

    border: tuple[Array, Array]
    is_linearised: Bool[Array, ""]
    sizes: Float[Array, "2"]
    marches: Int[Array, ""]


class PipedLines(AbstractLines):
    """Lines that are networks of pipes.

    Where Newton's method leaves the sequence of the valves, so much of its first step of the waves is
    followed as is safe, and the next march meets them. The flows of that march change the waves again,
    with the equations of the waves as they were linearised: a march and such a step cost a quarter of
    what linearising costs, and come five to ten times nearer.

    Attributes:
        responses: of networks that do not change with their waves.
    """

    responses: Any = None

    def prepared(self, system):
        return PipedLines(fixed_responses(system, self.waves_at_rest(system)))

    def rounds(self, options):
        return max(options.max_rounds, _ROUNDS)

    def waves_at_rest(self, system):
        return waves_at_rest(system.cases.cylinder)

    def marched(self, system, waves):
        return system.with_waves(waves).with_samples()

    def solve(self, system, mesh, z, waves, options):
        equations = BorderEquations(system, mesh, self.responses)
        start = Both(z, waves)
        new, report = newton(equations, start, options.tolerance, options.max_newton)
        return new.panels, new.waves, report

    def is_coarse(self, system, z):
        wide = is_too_wide(system.first, z.edges, system.orders)
        return wide | (resolution(z, system.columns(*RESOLVED)) > COARSE)

    def revolutions(self, system, count, memory):
        if system.cases.cylinder.plenums:
            return count  # a plenum has not forgotten after one revolution where it began
        return jnp.where(memory.is_linearised, 1, count)

    def memory(self, waves):
        false = jnp.asarray(False)
        return Memory(blank_border(waves), false, jnp.full(2, jnp.inf), jnp.zeros((), int))

    def approach(self, system, mesh, z, waves, memory):
        def step(_):
            return chord_step(system, mesh, z, waves, self.responses, memory.border)

        def stand_still(_):
            return jax.tree.map(jnp.zeros_like, waves)

        # before the first linearisation there are no factors to step with
        change = lax.cond(memory.is_linearised, step, stand_still, None)
        parts = [max_of(jnp.abs(part)) for part in jax.tree.leaves(change) if part.size]
        size = max_of(jnp.stack(parts))
        shrinks = jnp.isfinite(size) & (size < _SHRINKING * memory.sizes[0])
        goes_on = shrinks & (size > _SETTLED) & (memory.marches < _MOST_MARCHES)
        return Approach(goes_on & memory.is_linearised, limited(waves, change), size)

    def remembered(self, memory, approach, report):
        assert approach is not None
        is_new = report.steps > 0
        return Memory(
            # factors of the first linearisation in a round, nearest to the march that the next
            # steps follow
            border=jax.tree.map(partial(jnp.where, is_new), report.border, memory.border),
            is_linearised=memory.is_linearised | is_new,
            sizes=jnp.where(is_new, jnp.inf, jnp.append(memory.sizes[1], approach.size)),
            marches=jnp.where(is_new, 0, memory.marches + 1),
        )

    def next_waves(self, goes_on, waves, new, report):
        followed = limited(waves, report.first)
        return jax.tree.map(partial(jnp.where, goes_on), new, followed)
