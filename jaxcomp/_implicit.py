"""Fixed points with derivatives of any order and either mode, by the implicit function theorem."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Y = TypeVar("Y")


class FixedPointReport(NamedTuple):
    """How a fixed-point iteration ended.

    Attributes:
        steps: passes that were made.
        change: [-] largest change of any unknown in the last pass.
        settled: whether the change reached the tolerance, or stopped falling at rounding.
    """

    steps: Int[Array, ""]
    change: Float[Array, ""]
    settled: Bool[Array, ""]


# A change below this that no longer falls is taken for rounding, which a stiff torque curve amplifies.
_ROUNDING = 1e-8
# A change that falls by less than this in a pass does not come from a contraction. Two changes of side at
# nearly one place contract by 0.90 only, and must not be slowed down further.
_JUMPING = 0.99
# Passes that jump to and fro, across a kink or by a strong coupling, are halved down to this; those that
# come closer again grow back, slower than they were halved.
_SMALLEST_SHARE, _REGROWTH = 0.125, 1.5
# The unknowns are of order one; a change beyond this comes from a balance that has no solution.
_RUNAWAY = 1e6


def fixed_point(
    step: Callable[[Y], Y], start: Y, tolerance: float, max_steps: int
) -> tuple[Y, FixedPointReport]:
    """Iterate a contraction until it stands still.

    Derivatives do not run through the iteration. They solve the linearised equation at the fixed
    point, by the same iteration, so they converge at the rate of the values.

    Args:
        step: maps the unknowns to better ones; the unknowns are arrays of order one. It may use
            traced values from outside, and is differentiable in them.
        start: first guess.
        tolerance: largest change of any entry at which to stop.
        max_steps: passes after which to give up (the report then shows a large change).
    """

    def solve(_, start):
        value, report = settle(step, start, tolerance, max_steps)
        # custom_root wants floats beside the root
        return value, jnp.stack([x.astype(report.change.dtype) for x in report])

    def tangent_solve(linear, right_side):
        solve = _neumann(tolerance, max_steps)
        return jax.lax.custom_linear_solve(linear, right_side, solve, transpose_solve=solve)

    def residual(value):
        return jax.tree.map(jnp.subtract, value, step(value))

    value, report = jax.lax.custom_root(residual, start, solve, tangent_solve, has_aux=True)
    report = jax.lax.stop_gradient(report)
    return value, FixedPointReport(report[0].astype(int), report[1], report[2] > 0)


def settle(
    step: Callable[[Y], Y], start: Y, tolerance: float, max_steps: int
) -> tuple[Y, FixedPointReport]:
    """`fixed_point` without derivatives, for what only prepares a solution."""

    def going_on(carry):
        _, report, _ = carry
        moving = report.change < 2 * _RUNAWAY
        return moving & ~report.settled & (report.steps < max_steps)

    def advance(carry):
        value, last, share = carry
        new = step(value)
        change = _distance(new, value)
        # A pass that runs away (NaN included) is not taken: what is reported stays finite.
        lost = ~(change < _RUNAWAY)
        share = _share(share, change > _JUMPING * last.change)
        new = jax.tree.map(lambda a, b: jnp.where(lost, b, b + share * (a - b)), new, value)
        change = jnp.where(lost, 2 * _RUNAWAY, change)
        standing = (change < _ROUNDING) & (change > 0.5 * last.change)
        settled = (change <= tolerance) | standing
        return new, FixedPointReport(last.steps + 1, change, settled), share

    first = FixedPointReport(jnp.asarray(0), jnp.asarray(_RUNAWAY), jnp.asarray(False))
    value, report, _ = jax.lax.while_loop(going_on, advance, (start, first, jnp.asarray(1.0)))
    return value, report


def _neumann(tolerance, max_steps):
    def solve(matvec, right_side):
        size = _distance(right_side, jax.tree.map(jnp.zeros_like, right_side))

        def going_on(carry):
            _, change, _, steps = carry
            return (change > tolerance * size) & (steps < max_steps)

        def advance(carry):
            value, last, share, steps = carry
            rest = jax.tree.map(jnp.subtract, right_side, matvec(value))
            change = jnp.max(jnp.stack([jnp.max(jnp.abs(r)) for r in jax.tree.leaves(rest)]))
            # as above: where the passes do not contract, the derivative means nothing but is finite
            lost = ~(change < _RUNAWAY * size)
            share = _share(share, change > _JUMPING * last)
            new = jax.tree.map(lambda v, r: jnp.where(lost, v, v + share * r), value, rest)
            return new, jnp.where(lost, 0.0, change), share, steps + 1

        start = (right_side, jnp.asarray(jnp.inf), jnp.asarray(1.0), jnp.asarray(0))
        return jax.lax.while_loop(going_on, advance, start)[0]

    return solve


def _share(last: Float[Array, ""], jumps: Bool[Array, ""]) -> Float[Array, ""]:
    """The share of the next step that is taken."""
    smaller = jnp.maximum(0.5 * last, _SMALLEST_SHARE)
    return jnp.where(jumps, smaller, jnp.minimum(_REGROWTH * last, 1.0))


def _distance(a, b) -> Float[Array, ""]:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return jnp.max(jnp.stack([jnp.max(jnp.abs(x - y)) for x, y in pairs]))
