r"""The smallest corrections that keep every reading below a limit.

$\min \sum_p c_p |B_p|$ with $|V_{0k} + (C B)_k| \le L_k$ and, where asked for, $|B_p| \le U_p$: convex,
with circles for bounds. A circle is replaced by tangents, of which each step adds one wherever the
solution of the linear programme lies outside (J. E. Kelley 1960, The cutting-plane method for solving
convex programs, J. SIAM 8, 703-712). Tangents leave out no point of the circle, so that every step's
optimum is a proven lower bound.
"""

from typing import NoReturn

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._fields import BadInput
from .._status import SolveFailed, Status
from ._balance import Balance, balance
from ._influence import Influence
from ._min_max import min_max

# Tangents of every circle to begin with, and how far outside a circle, over its radius, a point counts
# as on it.
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
    largest: Float[Array, " planes"] | None = None,
) -> Balance:
    """The least sum of corrections with which every vibration stays at or below its limit.

    Args:
        influence: the system; its weights do not count.
        limit: [m] (rows,) or one for all, in the unit of the vibration.
        cost: [1/m] (planes,) what a unit of unbalance counts in a plane, such as one over its radius so
            that the masses are least; 1 if absent.
        largest: [kg m] (planes,) bounds of the corrections.

    Returns:
        The balance; `objective` and `bound` are the sum that was made small.

    Raises:
        BadInput: a limit, cost or bound that is not positive.
        SolveFailed: no correction reaches the limit; the message has the lowest that one does.
    """
    from scipy.optimize import linprog  # a third of a second, for those who need it

    rows, planes = influence.matrix.shape
    limits = np.broadcast_to(np.asarray(limit, float), rows)
    costs = np.broadcast_to(np.asarray(1.0 if cost is None else cost, float), planes)
    bounds = None if largest is None else np.broadcast_to(np.asarray(largest, float), planes)
    for name, values in (("limit", limits), ("cost", costs), ("largest", bounds)):
        if values is not None and not np.all(values > 0):
            raise BadInput(name, values, "> 0")
    # in units of the limits and of the corrections that would take all vibration away by themselves
    matrix = np.asarray(influence.matrix) / limits[:, None]
    initial = np.asarray(influence.initial) / limits
    size = 1.0 / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    circles = [(matrix * size, initial, np.zeros((rows, planes)))]  # |A x + b| <= 1
    circles.append((np.eye(planes), np.zeros(planes), np.eye(planes)))  # |x_p| <= t_p
    if bounds is not None:
        circles.append((np.diag(size / bounds), np.zeros(planes), np.zeros((planes, planes))))
    weight = costs * size
    unit = weight.max()
    cuts, right = [], []

    def add(number: int, row: int, angle: float) -> None:
        """Re[e^{-i angle} (A x + b)] <= 1, or <= t for the corrections themselves."""
        a, b, t = circles[number]
        turned = a[row] * np.exp(-1j * angle)
        cuts.append(np.concatenate([turned.real, -turned.imag, -t[row]]))
        held = 0.0 if t[row].any() else 1.0
        right.append(held - (b[row] * np.exp(-1j * angle)).real)

    for number, (a, _, _) in enumerate(circles):
        for row in range(len(a)):
            for angle in 2 * np.pi * np.arange(_TANGENTS) / _TANGENTS:
                add(number, row, angle)
    objective = np.concatenate([np.zeros(2 * planes), weight / unit])
    ends = [(None, None)] * (2 * planes) + [(0, None)] * planes
    for _ in range(_STEPS):
        solved = linprog(objective, np.array(cuts), np.array(right), bounds=ends, options=_TIGHT)
        if solved.x is None:
            _refuse(influence, limits, bounds)
        x = solved.x[:planes] + 1j * solved.x[planes : 2 * planes]
        outside = False
        for number, (a, b, t) in enumerate(circles):
            value = a @ x + b
            radius = t @ solved.x[2 * planes :] + (~t.any(axis=1))
            for row in np.flatnonzero(np.abs(value) > radius + _OUTSIDE):
                add(number, row, float(np.angle(value[row])))
                outside = True
        if not outside:
            break
    total = float(np.sum(weight * np.abs(x)))
    low = min(float(solved.fun) * unit, total)
    failure = Status.not_converged if outside else Status.converged
    return balance(
        influence, jnp.asarray(x * size), jnp.asarray(total), jnp.asarray(low), "least masses", failure,
        jnp.asarray(total),
    )  # fmt: skip


def _refuse(influence: Influence, limits, bounds) -> NoReturn:
    """Say what could be reached instead."""
    within = Influence(influence.matrix, influence.initial, jnp.asarray(limits.max() / limits),
                       influence.rows, influence.planes)  # fmt: skip
    words = "with the bounds of the corrections" if bounds is not None else ""
    lowest = float(min_max(within).objective)
    if lowest <= limits.max():
        raise SolveFailed(Status.singular, f"no corrections reach the limit {words}".strip())
    raise SolveFailed(
        Status.singular,
        f"no corrections reach the limit: the lowest is {lowest / limits.max():.4g} times as high",
    )
