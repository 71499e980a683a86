r"""Balances in other norms: the least largest vibration, and the least masses.

`min_max` is Lawson's method (C. L. Lawson 1961, Contributions to the theory of linear least maximum
approximation, thesis, University of California): least squares with row weights $\lambda_k$,
$\sum\lambda_k = 1$, which grow where the vibration is large. The weights are the multipliers of the dual
problem, so that every step carries its own proof: for any of them

$$\Big(\min_B \sum_k \lambda_k |r_k|^2\Big)^{1/2} \le \min_B \max_k |r_k| \le \max_k |r_k| .$$

`least_masses` solves $\min \sum_p c_p |B_p|$ with $|V_{0k} + (C B)_k| \le L_k$ and, where asked for,
$|B_p| \le U_p$: convex, with circles for bounds. A circle is replaced by tangents, of which each step
adds one wherever the solution of the linear programme lies outside (J. E. Kelley 1960, The cutting-plane
method for solving convex programs, J. SIAM 8, 703-712). Tangents leave out no point of the circle, so
that every step's optimum is a proven lower bound.
"""

from collections.abc import Mapping
from typing import NamedTuple, NoReturn

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import max_of, maximum, minimum
from .._core.status import SolveFailed, Status
from ._balance import Balance, balance
from ._influence import Influence
from ._least_squares import bounds_of


def min_max(influence: Influence, *, tolerance: float = 1e-6, max_steps: int = 20_000) -> Balance:
    """The least largest weighted vibration.

    Args:
        influence: the system.
        tolerance: [-] of the gap between the two sides of the proof, over the upper one.
        max_steps: after which to stop; the gap shows what was reached.
    """
    matrix, initial = influence.weighted
    # in units of the largest vibration before, of which 1 and 1e-12 below are shares
    scale = maximum(max_of(jnp.abs(initial)), 1e-300)
    rows = initial.size

    def solve(share):
        root = jnp.sqrt(share)
        solution = jnp.linalg.lstsq(root[:, None] * matrix, -root * initial / scale, rcond=1e-13)[0]
        sizes = jnp.abs(matrix @ solution + initial / scale)
        return solution, sizes, jnp.sqrt(jnp.sum(share * sizes**2))

    def going_on(carry):
        _, _, highest, lowest, steps = carry
        open_ = highest - lowest > tolerance * highest
        return open_ & (highest > 1e-12) & (steps < max_steps)

    def advance(carry):
        share, best, highest, lowest, steps = carry
        solution, sizes, below = solve(share)
        top = max_of(sizes)
        best = jnp.where(top < highest, solution, best)
        # A row that ever gets no weight never gets any again: a trace of it stays.
        grown = maximum(share * sizes, 1e-14 * top / rows)
        grown = grown / jnp.sum(grown)
        return grown, best, minimum(highest, top), maximum(lowest, below), steps + 1

    # No correction at all reaches 1, the largest vibration before; nothing gets below 0.
    even = jnp.full(rows, 1.0 / rows)
    zero = jnp.zeros(matrix.shape[1], complex)
    start = (even, zero, jnp.asarray(1.0), jnp.asarray(0.0), jnp.asarray(0))
    _, best, highest, lowest, steps = lax.while_loop(going_on, advance, start)
    failure = Status.where(
        # By the gap alone: the last step that was allowed may have closed it.
        going_on((even, best, highest, lowest, minimum(steps, max_steps - 1))),
        Status.not_converged,
        Status.converged,
    )
    return balance(influence, best * scale, highest * scale, lowest * scale, "min-max", failure)


# Tangents of every circle to begin with, whose corners stand out by 2 % of the radius, and how far
# outside a circle, over its radius, a point counts as on it.
_TANGENTS = 16
_OUTSIDE = 1e-8
# Of the solver of linear programmes.
_TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
_STEPS = 200


def least_masses(
    influence: Influence,
    limit: Float[Array, " rows"],
    *,
    cost: Float[Array, " planes"] | None = None,
    largest: Float[Array, " planes"] | Mapping[str, float] | None = None,
) -> Balance:
    """The least sum of corrections with which every vibration stays at or below its limit.

    Args:
        influence: the system; its weights do not count.
        limit: [m] (rows,) or one for all, in the unit of the vibration.
        cost: [1/m] (planes,) what a unit of unbalance counts in a plane, such as one over its radius so
            that the masses are least; 1 if absent.
        largest: [kg m] (planes,) bounds of the corrections; or by plane, and the others are free.

    Returns:
        The balance; `objective` and `bound` are the sum that was made small.

    Raises:
        BadInput: a limit, cost or bound that is not positive, or a bound of an unknown plane.
        SolveFailed: no correction reaches the limit; the message has the lowest that one does.
    """
    from scipy.optimize import linprog  # a third of a second, for those who need it

    rows, planes = influence.matrix.shape
    limits = np.broadcast_to(np.asarray(limit, float), rows)
    costs = np.broadcast_to(np.asarray(1.0 if cost is None else cost, float), planes)
    largest = bounds_of(influence, largest)
    bounds = None
    if largest is not None:
        bounds = np.broadcast_to(np.asarray(largest, float), planes)
    for name, values in (("limit", limits), ("cost", costs), ("largest", bounds)):
        if values is not None and not np.all(values > 0):
            raise BadInput(name, values, "> 0")
    circles, size = _circles(influence, limits, bounds)
    weight = costs * size
    unit = weight.max()
    angles = 2 * np.pi * np.arange(_TANGENTS) / _TANGENTS
    count = len(circles.a)
    cuts, right = circles.tangents(np.repeat(np.arange(count), _TANGENTS), np.tile(angles, count))
    # Costs of one size, because the tolerances of the solver are absolute.
    objective = np.concatenate([np.zeros(2 * planes), weight / unit])
    # real and imaginary parts of the corrections are free, their sizes t are not negative
    ends = [(None, None)] * (2 * planes) + [(0, None)] * planes
    step = 0
    while True:
        step += 1
        solved = linprog(objective, cuts, right, bounds=ends, options=_TIGHT)
        if solved.x is None:
            _refuse(influence, limits, bounds)
        x = solved.x[:planes] + 1j * solved.x[planes : 2 * planes]
        value = circles.a @ x + circles.b
        radius = circles.fixed + circles.t @ solved.x[2 * planes :]
        outside = np.flatnonzero(np.abs(value) > radius + _OUTSIDE)
        if not outside.size or step == _STEPS:
            break
        # A tangent at the angle of the point cuts it off, and no point of the circle.
        new_cuts, new_right = circles.tangents(outside, np.angle(value[outside]))
        cuts = np.vstack([cuts, new_cuts])
        right = np.append(right, new_right)
    total = float(np.sum(weight * np.abs(x)))
    # The programme is solved to a tolerance, which must not lift the bound above what was reached.
    low = min(float(solved.fun) * unit, total)
    failure = Status.not_converged if outside.size else Status.converged
    return balance(
        influence, jnp.asarray(x * size), jnp.asarray(total), jnp.asarray(low), "least masses", failure,
        jnp.asarray(total),
    )  # fmt: skip


class _Circles(NamedTuple):
    """Circles |A x + b| <= fixed + T t, one a row.

    Attributes:
        a: (circles, planes) complex.
        b: (circles,) complex.
        fixed: (circles,) 1 of the readings and of the bounds, 0 of the sizes of the corrections.
        t: (circles, planes) which size of a correction is the radius.
    """

    a: np.ndarray
    b: np.ndarray
    fixed: np.ndarray
    t: np.ndarray

    def tangents(self, at: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Re[e^{-i angle} (A x + b)] <= fixed + T t, as rows over (Re x, Im x, t) and right sides."""
        turn = np.exp(-1j * angle)
        turned = self.a[at] * turn[:, None]
        rows = np.hstack([np.real(turned), -np.imag(turned), -self.t[at]])
        offset = np.real(self.b[at]) * np.real(turn) - np.imag(self.b[at]) * np.imag(turn)
        return rows, self.fixed[at] - offset


def _circles(influence: Influence, limits, bounds) -> tuple[_Circles, np.ndarray]:
    """Circles of readings, sizes and bounds; and the unit of each correction [kg m].

    Readings are in units of their limits, corrections in units of those that would take all vibration
    away by themselves: otherwise the tolerance of the linear programme would mean nothing.
    """
    rows, planes = influence.matrix.shape
    matrix = np.asarray(influence.matrix) / limits[:, None]
    initial = np.asarray(influence.initial) / limits
    size = 1.0 / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    # rows: the readings, the corrections within their sizes t, and within their bounds if there are any
    a = np.vstack([matrix * size, np.eye(planes)])
    if bounds is not None:
        a = np.vstack([a, np.diag(size / bounds)])
    t = np.zeros((len(a), planes))
    t[rows : rows + planes] = np.eye(planes)
    b = np.append(initial, np.zeros(len(a) - rows))
    return _Circles(a, b, np.where(t.any(axis=1), 0.0, 1.0), t), size


def _refuse(influence: Influence, limits, bounds) -> NoReturn:
    """Say what could be reached instead."""
    # with these weights min-max judges every reading in shares of its own limit
    within = Influence(influence.matrix, influence.initial, jnp.asarray(limits.max() / limits),
                       influence.rows, influence.planes)  # fmt: skip
    words = ""
    if bounds is not None:
        words = "with the bounds of the corrections"
    lowest = float(min_max(within).objective)
    # free corrections do reach the limit: the bounds are in the way
    if lowest <= limits.max():
        raise SolveFailed(Status.singular, f"no corrections reach the limit {words}".strip())
    raise SolveFailed(
        Status.singular,
        f"no corrections reach the limit: the lowest is {lowest / limits.max():.4g} times as high",
    )
