"""Roots and fixed points with derivatives of any order and either mode: implicit functions."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .extremes import max_of, maximum, minimum
from .fields import is_traced

Y = TypeVar("Y")


class FixedPointReport(NamedTuple):
    """Report on the end of a fixed-point iteration.

    Attributes:
        steps: iterations that were made.
        change: [-] largest change of any unknown in the last iteration.
        settled: whether the change reached the tolerance, or stopped falling at rounding.
    """

    steps: Int[Array, ""]
    change: Float[Array, ""]
    settled: Bool[Array, ""]


# A change below the first that has not come down to this share of its lowest value within so many
# iterations counts as rounding, which a stiff torque curve amplifies.
_ROUNDING = 1e-8
_LOWER = 0.8
_PATIENCE = 8
# A change that falls by less than this in an iteration does not come from a contraction. Two load
# reversals at nearly one place contract by 0.90 only, and must not be slowed down further.
_JUMPING = 0.99
# Iterations that jump to and fro, across a kink or by a strong coupling, are halved down to this; those
# that come closer again grow back, slower than they were halved.
_SMALLEST_SHARE = 0.125
_REGROWTH = 1.5
# Iterations that Anderson's mixing looks back on: few directions contract slowly.
_DEPTH = 5
# [-] Square of the share of a direction below which it is rounding for the mixing.
_PARALLEL = 1e-14
# The unknowns are of order one; a change beyond this comes from a balance that has no solution.
_RUNAWAY = 1e6


def frozen(tree: Y) -> Y:
    """A tree without derivatives; what is no array, as a function among the parameters, stays."""

    def without_derivatives(leaf):
        # outside of a trace there are none, and the operation would be a program of its own
        return jax.lax.stop_gradient(leaf) if is_traced(leaf) else leaf

    return jax.tree.map(without_derivatives, tree)


@jax.custom_jvp
def only_of_solved(values: Float[Array, "*n"], solved: Bool[Array, ""]) -> Float[Array, "*n"]:
    """The values, whose derivatives are not a number where nothing was solved.

    What an iteration leaves that has not ended does not depend on its parameters as a solution does, and
    often not at all.
    """
    return values


@only_of_solved.defjvp
def _only_of_solved_jvp(primals, tangents):
    values, solved = primals
    return only_of_solved(values, solved), tangents[0] * jnp.where(solved, 1.0, jnp.nan)


def zeros_of(function: Callable[..., Any], *arguments) -> Any:
    """Zeros in the shapes of what a function returns, which is traced and not computed."""

    def zero(leaf):
        if isinstance(leaf, jax.ShapeDtypeStruct):
            return jnp.zeros(leaf.shape, leaf.dtype)
        return leaf

    return jax.tree.map(zero, eqx.filter_eval_shape(function, *arguments))


class AbstractRoot(eqx.Module):
    """Equations whose unknowns follow from the parts of this module."""

    @abstractmethod
    def solve(self) -> Any:
        """The unknowns, by whatever means."""

    @abstractmethod
    def residual(self, unknowns) -> Any:
        """Residual of the equations: zero at the root."""

    def newton_correction(self, unknowns, residual) -> Any:
        """Change of the unknowns that removes a small residual, of equations that are independent."""
        # independent equations have a diagonal matrix, all of which one tangent of ones gives
        return -residual / jax.jvp(self.residual, (unknowns,), (jnp.ones_like(unknowns),))[1]


@eqx.filter_custom_jvp
def root(equations: AbstractRoot):
    """The unknowns of equations, with derivatives by the implicit function theorem.

    Derivatives are those at the root, of every order and in both modes: the iteration that finds it is
    not differentiated.
    """
    return equations.solve()


@root.def_jvp
def _root_jvp(primals, tangents):
    # By `root` again and not by `solve`: derivatives of the next order take this rule as well.
    unknowns = root(*primals)
    residual, residual_tangent = eqx.filter_jvp(
        lambda equations: equations.residual(unknowns), primals, tangents
    )

    def zero_if_absent(tangent, like):
        return jnp.zeros_like(like) if tangent is None else tangent

    # Equations that no tangent moves have `None`, where `newton_correction` wants a zero.
    residual_tangent = jax.tree.map(zero_if_absent, residual_tangent, residual, is_leaf=_absent)
    return unknowns, primals[0].newton_correction(unknowns, residual_tangent)


def _absent(leaf) -> bool:
    return leaf is None


def _present(leaf) -> bool:
    return leaf is not None


class AbstractFixedPoint(eqx.Module):
    """A fixed-point problem: how it is solved, and the step whose fixed point the solution is.

    Attributes:
        tolerance: largest change of any unknown at which to stop.
        max_iterations: iterations after which to give up (the report then shows a large change).
    """

    tolerance: eqx.AbstractVar[float | Float[Array, ""]]
    max_iterations: eqx.AbstractVar[int]

    @abstractmethod
    def solve(self, parameters: Any) -> tuple[Any, Any]:
        """The unknowns, arrays of order one, and data that comes along without derivatives."""

    @abstractmethod
    def step(self, parameters: Any, data: Any, unknowns: Any) -> Any:
        """Better unknowns. At the fixed point only this step is differentiated."""


@eqx.filter_custom_jvp
def fixed_point(problem: AbstractFixedPoint, parameters):
    """Solve a fixed-point problem, with derivatives to its parameters.

    Derivatives do not run through the iteration. They solve the linearised equation at the fixed
    point, by the same iteration, so they converge at the rate of the values. What they need is
    traced only where something is differentiated.

    Returns:
        What `problem.solve` returns.
    """
    return problem.solve(parameters)


@fixed_point.def_jvp
def _fixed_point_jvp(primals, tangents):
    problem, parameters = primals
    value, data = fixed_point(problem, parameters)
    fixed = jax.lax.stop_gradient(data)
    varied, constant = eqx.partition(
        parameters, jax.tree.map(_present, tangents[1], is_leaf=_absent)
    )

    def step(varied, value):
        return problem.step(eqx.combine(varied, constant), fixed, value)

    # Traced once; how the step follows the parameters, and how the unknowns, are two readings of it.
    _, linear = jax.linearize(step, varied, value)
    zeros = jax.tree.map(jnp.zeros_like, (varied, value))
    _, right_side = jax.jvp(lambda varied: linear(varied, zeros[1]), zeros[:1], tangents[1:])
    _, of_unknowns = jax.linearize(lambda value: linear(zeros[0], value), zeros[1])
    # An unknown that no parameter moves directly may still follow the others. Reverse mode wants each
    # right side to depend on the tangents, so a zero that does is added to all.
    entries = 0
    for leaf in jax.tree.leaves(tangents[1]):
        if leaf.size:
            entries = entries + leaf.ravel()[0]
    zero = 0 * entries

    def depending(tangent, unknown):
        if unknown is None:  # a machine without it
            return None
        if tangent is None or not tangent.size:
            return jnp.full_like(unknown, zero)
        return tangent + zero

    right_side = jax.tree.map(depending, right_side, value, is_leaf=_absent)
    solve = _neumann(problem.tolerance, problem.max_iterations)
    # The transposed map contracts at the same rate, so that the same iteration solves it.
    value_tangent = jax.lax.custom_linear_solve(
        lambda v: jax.tree.map(jnp.subtract, v, of_unknowns(v)),
        right_side,
        solve,
        transpose_solve=solve,
    )
    return (value, data), (value_tangent, jax.tree.map(lambda _: None, data))


def settle(
    step: Callable[[Y, Any], tuple[Y, Any]],
    start: Y,
    start_data: Any,
    tolerance: float | Float[Array, ""],
    max_iterations: int,
    rounding: float | Float[Array, ""] = 0.0,
) -> tuple[Y, Any, FixedPointReport]:
    """Iterate a contraction until it converges, without derivatives.

    Args:
        step: maps the unknowns, arrays of order one, and the data of the iteration before to better
            ones and new data.
        start: first guess.
        start_data: data of the first guess.
        tolerance: largest change of any entry at which to stop.
        max_iterations: iterations after which to give up.
        rounding: change that rounding alone may leave beside what it leaves of an ordinary problem.
    """

    def going_on(carry):
        return _goes_on(carry[2], max_iterations)

    def advance(carry):
        value, data, previous, share, lowest, waited = carry
        new, data = step(value, data)
        change = _distance(new, value)
        # An iteration that runs away (NaN included) is not taken: what is reported stays finite.
        lost = ~(change < _RUNAWAY)
        # One that changes more than the one before jumps to and fro: half of it comes closer.
        share = _share(share, change > _JUMPING * previous.change)
        new = jax.tree.map(lambda a, b: jnp.where(lost, b, b + share * (a - b)), new, value)
        change = jnp.where(lost, 2 * _RUNAWAY, change)
        settled, lowest, waited = _ended(change, lowest, waited, tolerance, rounding)
        return (
            new,
            data,
            FixedPointReport(previous.steps + 1, change, settled),
            share,
            lowest,
            waited,
        )

    begin = (start, start_data, _begun(), jnp.asarray(1.0), jnp.asarray(_RUNAWAY), jnp.asarray(0))
    value, data, report, *_ = jax.lax.while_loop(going_on, advance, begin)
    return value, data, report


def _weighted(weights: Float[Array, " depth"], outputs: Y, _: Y) -> Y:
    return jax.tree.map(lambda leaf: jnp.tensordot(weights, leaf, 1), outputs)


def _raveled(tree) -> Float[Array, " n"]:
    return ravel_pytree(tree)[0]


def mix(
    step: Callable[[Y, Any], tuple[Y, Any]],
    start: Y,
    start_data: Any,
    tolerance: float | Float[Array, ""],
    max_iterations: int,
    sampled: Callable[[Y], Float[Array, " n"]] = _raveled,
    combined: Callable[[Float[Array, " depth"], Y, Y], Y] = _weighted,
    noise: float = 0.0,
) -> tuple[Y, Any, FixedPointReport]:
    """Iterate to a fixed point by Anderson's mixing, without derivatives.

    What the last steps gave is combined with weights of sum one, those with which the changes by these
    steps nearly cancel. Of a linear step that is GMRES. It converges where the step by itself hardly
    contracts, or moves away in a few directions.
    Source: Walker and Ni (2011), SIAM J. Numer. Anal. 49, 1715-1735, eqs. (2.1)-(2.2).

    Args:
        step: maps the unknowns, arrays of order one, and the data of the iteration before to better
            ones and new data.
        start: first guess.
        start_data: data of the first guess.
        tolerance: largest change by a step at which to stop.
        max_iterations: iterations after which to give up.
        sampled: n numbers of the unknowns, in which changes are measured.
        combined: unknowns of which these are the weighted sum, of the weights, what the last steps gave
            (with a leading axis), and the newest of it.
        noise: change below which a step that is not smooth may stop falling.

    Returns:
        What the last step gave, the data of it, and how it ended.
    """
    # room for all steps from the beginning, because what a loop carries keeps its shape
    changes = jnp.stack([jnp.zeros_like(sampled(start))] * _DEPTH)
    outputs = jax.tree.map(lambda leaf: jnp.stack([leaf] * _DEPTH), start)

    def going_on(carry):
        return _goes_on(carry[2], max_iterations)

    def advance(carry):
        value, data, previous, lowest, waited, changes, outputs = carry
        new, data = step(value, data)
        change = sampled(new) - sampled(value)
        size = _largest(change)
        # lost as in `settle`: a NaN in the columns of changes would spoil every later combination
        lost = ~(size < _RUNAWAY)
        new = jax.tree.map(lambda after, before: jnp.where(lost, before, after), new, value)
        size = jnp.where(lost, 2 * _RUNAWAY, size)
        changes = jnp.roll(changes, 1, axis=0).at[0].set(jnp.where(lost, 0.0, change))
        outputs = jax.tree.map(
            lambda old, leaf: jnp.roll(old, 1, axis=0).at[0].set(leaf), outputs, new
        )
        settled, lowest, waited = _ended(size, lowest, waited, tolerance, noise)
        weights = _weights(changes, previous.steps + 1)
        mixed = combined(weights, outputs, new)
        # the last step is taken as it is: the data belong to it
        value = jax.tree.map(lambda a, b: jnp.where(settled | lost, a, b), new, mixed)
        report = FixedPointReport(previous.steps + 1, size, settled)
        return value, data, report, lowest, waited, changes, outputs

    begin = start, start_data, _begun(), jnp.asarray(_RUNAWAY), jnp.asarray(0), changes, outputs
    value, data, report, *_ = jax.lax.while_loop(going_on, advance, begin)
    return value, data, report


def _weights(changes: Float[Array, "depth n"], steps: Int[Array, ""]) -> Float[Array, " depth"]:
    """The weights of sum one with which the newest changes nearly cancel.

    Args:
        changes: by the last steps, the newest first.
        steps: how many there have been; changes before the first are not looked at.
    """
    exists = (jnp.arange(1, _DEPTH) < steps)[:, None]
    bends = jnp.where(exists, changes[0] - changes[1:], 0.0)
    squares = jnp.sum(bends**2, axis=1)
    usable = squares > 0
    # all of length one, so that the small last ones count as the large first ones do
    length = jnp.sqrt(jnp.where(usable, squares, 1.0))
    bends = bends / length[:, None]
    normal = bends @ bends.T + jnp.diag(jnp.where(usable, _PARALLEL, 1.0))
    of_earlier = jnp.linalg.solve(normal, bends @ changes[0]) / length
    return jnp.concatenate([1 - jnp.sum(of_earlier, keepdims=True), of_earlier])


def _begun() -> FixedPointReport:
    """The report before the first iteration, with half of the change that a lost one has."""
    return FixedPointReport(jnp.asarray(0), jnp.asarray(_RUNAWAY), jnp.asarray(False))


def _goes_on(report: FixedPointReport, max_iterations: int) -> Bool[Array, ""]:
    """Whether there is another iteration after a report: neither lost, nor settled, nor one too many."""
    moving = report.change < 2 * _RUNAWAY
    return moving & ~report.settled & (report.steps < max_iterations)


def _ended(change, lowest, waited, tolerance, rounding=0.0):
    """Whether an iteration has ended, the lowest change, and for how long it has not fallen.

    Args:
        change: of this iteration.
        lowest: before it.
        waited: iterations since that one fell.
        tolerance: change at which to stop.
        rounding: as in `settle`.
    """
    falls = change < _LOWER * lowest
    lowest = jnp.where(falls, change, lowest)
    waited = jnp.where(falls | ~(change < _ROUNDING + rounding), 0, waited + 1)
    return (change <= tolerance) | (waited >= _PATIENCE), lowest, waited


def _neumann(tolerance, max_iterations):
    def solve(matvec, right_side):
        size = _distance(right_side, jax.tree.map(jnp.zeros_like, right_side))

        def going_on(carry):
            _, change, _, steps = carry
            return (change > tolerance * size) & (steps < max_iterations)

        def advance(carry):
            value, previous, share, steps = carry
            residual = jax.tree.map(jnp.subtract, right_side, matvec(value))
            change = _largest(residual)
            # as above: where the iterations do not contract, the derivative is finite but means nothing
            lost = ~(change < _RUNAWAY * size)
            share = _share(share, change > _JUMPING * previous)
            new = jax.tree.map(lambda v, r: jnp.where(lost, v, v + share * r), value, residual)
            # A change of zero ends the loop.
            return new, jnp.where(lost, 0.0, change), share, steps + 1

        start = (right_side, jnp.asarray(jnp.inf), jnp.asarray(1.0), jnp.asarray(0))
        return jax.lax.while_loop(going_on, advance, start)[0]

    return solve


def _share(share: Float[Array, ""], jumps: Bool[Array, ""]) -> Float[Array, ""]:
    """The share of the next step that is taken."""
    smaller = maximum(0.5 * share, _SMALLEST_SHARE)
    return jnp.where(jumps, smaller, minimum(_REGROWTH * share, 1.0))


def _distance(a, b) -> Float[Array, ""]:
    return _largest(jax.tree.map(jnp.subtract, a, b))


def _largest(tree) -> Float[Array, ""]:
    largest = []
    for leaf in jax.tree.leaves(tree):
        if leaf.size:
            largest.append(max_of(jnp.abs(leaf)))
    return max_of(jnp.stack(largest))
