r"""Balances in the weighted sum of squares: exact, least, minimum norm, truncated, Tikhonov, bounded.

$\min_B \|W (V_0 + C B)\|_2$, by the singular value decomposition and never by the normal equations.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Complex, Float

from .._fields import BadInput, is_traced
from .._status import Status
from ._balance import Balance, balance, condition
from ._influence import Influence


def invert(influence: Influence) -> Balance:
    """As many planes as rows: the vibration vanishes, Eq. (12).

    The status is `singular` where the condition of the system is above 1e12.

    Raises:
        BadInput: another number of rows than of planes.
    """
    rows, planes = influence.matrix.shape
    if rows != planes:
        raise BadInput("influence", f"{rows} rows, {planes} planes", "square")
    correction = -jnp.linalg.solve(influence.matrix, influence.initial)
    regular = condition(influence.matrix) < 1e12
    correction = jnp.where(jnp.isfinite(correction) | regular, correction, 0.0)
    failure = Status.where(regular, Status.converged, Status.singular)
    return _exact(influence, correction, "inversion", failure)


def least_squares(
    influence: Influence, *, cut: float = 1e-12, tikhonov: Float[Array, ""] | float = 0.0
) -> Balance:
    """The least weighted sum of squares, Eq. (13); the smallest correction where many reach it.

    Args:
        influence: the system.
        cut: [-] singular values below this share of the largest are left out.
        tikhonov: [-] a penalty on the corrections: their squares, in units of the largest
            singular value times this number, join the sum.

    Raises:
        BadInput: a negative penalty, or a cut outside 0 to 1.
    """
    if not 0 <= cut < 1:
        raise BadInput("cut", cut, ">= 0 and < 1")
    if not is_traced(tikhonov) and tikhonov < 0:
        raise BadInput("tikhonov", tikhonov, ">= 0")
    matrix, initial = influence.weighted
    left, values, right = jnp.linalg.svd(matrix, full_matrices=False)
    kept = values > cut * values[0]
    safe = jnp.where(kept, values, 1.0)
    share = jnp.where(kept, safe / (safe**2 + (tikhonov * values[0]) ** 2), 0.0)
    correction = -right.conj().T @ (share * (left.conj().T @ initial))
    return _exact(influence, correction, "least squares")


def predicted(
    influence: Influence, correction: Complex[Array, " planes"], method: str = "given"
) -> Balance:
    """What given corrections do; the bound is the least squares.

    Args:
        influence: the system.
        correction: [kg m] (planes,)
        method: name of the result.
    """
    best = least_squares(influence)
    given = jnp.asarray(correction, complex)
    left = jnp.linalg.norm(influence.weight * influence.vibration(given))
    return balance(influence, given, left, best.bound, method)


def bounded(
    influence: Influence,
    largest: Float[Array, " planes"],
    *,
    tolerance: float = 1e-10,
    max_steps: int = 100,
) -> Balance:
    r"""Least squares with a bound on the unbalance of every plane.

    An interior-point method: Newton steps for $\nabla|Ax+b|^2/2 + \lambda\circ x = 0$ and
    $\lambda_i(1-|x_i|^2)/2 = \tau$ with $\tau \to 0$ (Boyd and Vandenberghe 2004, Convex Optimization,
    Section 11.7), each solved as a least-squares problem, never by the normal equations. Its bound is a
    proof: the minimum over all x of the Lagrangian at the multipliers.

    Args:
        influence: the system.
        largest: [kg m] (planes,) bound of |B|.
        tolerance: [-] of the gap between the sum of squares and its bound, over the sum of squares. A
            gap below 1e-12 of the vibration before, where rounding begins, is taken for closed.
        max_steps: after which to stop; the status then says that it did not converge.

    Raises:
        BadInput: a bound that is not positive.
    """
    count = len(influence.planes)
    largest = jnp.broadcast_to(jnp.asarray(largest, float), (count,))
    if not is_traced(largest) and not bool(jnp.all(largest > 0)):
        raise BadInput("largest", largest, "> 0")
    matrix, initial = influence.weighted
    size = jnp.sqrt(jnp.sum(jnp.abs(initial) ** 2))
    size = jnp.where(size > 0, size, 1.0)
    # Real and imaginary parts of x = B/largest one below the other, vibration in units of what was there.
    a = matrix * largest / size
    q, a = jnp.linalg.qr(jnp.block([[a.real, -a.imag], [a.imag, a.real]]))
    b = _pair(initial / size)
    rest = jnp.sum((b - q @ (q.T @ b)) ** 2)  # that no correction can remove
    b = q.T @ b

    def squares(x):
        return jnp.sum((a @ x + b) ** 2) + rest

    def dot(x, y):
        return jnp.sum((x * y).reshape(2, count), 0)

    def bound(multiplier):
        root = jnp.sqrt(jnp.tile(multiplier, 2))
        x = _solved(jnp.vstack([a, jnp.diag(root)]), jnp.append(-b, jnp.zeros(2 * count)))
        return squares(x) + jnp.sum((root * x) ** 2) - jnp.sum(multiplier)

    def open_(high, low):
        return (high - low > tolerance * high) & (jnp.sqrt(high) - jnp.sqrt(low) > 1e-12)

    def going_on(carry):
        _, _, high, low, steps = carry
        return open_(high, low) & (steps < max_steps)

    def advance(carry):
        x, multiplier, _, low, steps = carry
        room = (1 - dot(x, x)) / 2
        target = 0.1 * jnp.mean(multiplier * room)
        steep = jnp.sqrt(multiplier / room)
        rows = (jnp.diag(steep * half) for half in x.reshape(2, count))
        rows = [a, jnp.diag(jnp.sqrt(jnp.tile(multiplier, 2))), jnp.hstack([*rows])]
        right = [-(a @ x + b), jnp.zeros(2 * count), -target / jnp.sqrt(multiplier * room)]
        step = _solved(jnp.vstack(rows), jnp.concatenate(right))
        change = (target + multiplier * dot(x, step)) / room - multiplier
        # The steps that would use up the room of a plane, or a multiplier.
        along, across = dot(x, step), dot(step, step)
        ends = 2 * room / (along + jnp.sqrt(along**2 + 2 * across * room) + 1e-300)
        ends = jnp.append(ends, jnp.where(change < 0, -multiplier / change, jnp.inf))
        share = jnp.minimum(1.0, 0.99 * jnp.min(ends))
        x, multiplier = x + share * step, multiplier + share * change
        return x, multiplier, squares(x), jnp.maximum(low, bound(multiplier)), steps + 1

    x = jnp.zeros(2 * count)
    multiplier = jnp.full(count, jnp.max(jnp.abs(a.T @ b)) + 1e-300)
    start = (x, multiplier, squares(x), jnp.zeros(()), jnp.asarray(0))
    x, _, high, low, _ = lax.while_loop(going_on, advance, start)
    good = jnp.all(largest > 0)
    failure = Status.where(open_(high, low), Status.not_converged, Status.converged)
    return balance(
        influence,
        (x[:count] + 1j * x[count:]) * largest,
        jnp.where(good, jnp.sqrt(high), jnp.nan) * size,
        jnp.sqrt(low) * size,
        "bounded least squares",
        failure,
    )


def _pair(values):
    return jnp.append(values.real, values.imag)


def _solved(rows, right):
    """Least squares of a tall real system."""
    q, r = jnp.linalg.qr(rows)
    return solve_triangular(r, q.T @ right)


def _exact(influence, correction, method, failure=None) -> Balance:
    objective = jnp.linalg.norm(influence.weight * influence.vibration(correction))
    return balance(influence, correction, objective, objective, method, failure)


def quadratic(influence: Influence):
    """The weighted sum of squares as a function of the corrections, for any descent."""

    def objective(correction):
        matrix, initial = influence.weighted
        rest = initial + matrix @ correction
        return jnp.sum(rest.real**2 + rest.imag**2)

    return jax.jit(objective)
