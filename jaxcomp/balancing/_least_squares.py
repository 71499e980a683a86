r"""Balances in the weighted sum of squares: exact, least, minimum norm, truncated, Tikhonov, bounded.

$\min_B \|W (V_0 + C B)\|_2$, by the singular value decomposition and never by the normal equations.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Complex, Float

from .._fields import BadInput, is_traced
from ._balance import Balance
from ._influence import Influence


def invert(influence: Influence) -> Balance:
    """As many planes as rows: the vibration vanishes, Eq. (12).

    Raises:
        BadInput: another number of rows than of planes.
    """
    rows, planes = influence.matrix.shape
    if rows != planes:
        raise BadInput("influence", f"{rows} rows, {planes} planes", "square")
    correction = -jnp.linalg.solve(influence.matrix, influence.initial)
    return _balance(influence, correction, "inversion")


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
    return _balance(influence, correction, "least squares")


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
    left = jnp.linalg.norm(influence.weight * influence.vibration(jnp.asarray(correction, complex)))
    return Balance(influence, jnp.asarray(correction, complex), left, best.bound, method)


def bounded(
    influence: Influence,
    largest: Float[Array, " planes"],
    *,
    tolerance: float = 1e-8,
    max_steps: int = 100_000,
) -> Balance:
    """Least squares with a bound on the unbalance of every plane.

    Accelerated projected gradients on a convex problem. Its bound is a proof: the linear minorant
    of the sum of squares at the correction, at the best admissible place.

    Args:
        influence: the system.
        largest: [kg m] (planes,) bound of |B|.
        tolerance: [-] of the sum of squares, over its value without correction.
        max_steps: after which to stop; the gap shows what was reached.

    Raises:
        BadInput: a bound that is not positive.
    """
    largest = jnp.broadcast_to(jnp.asarray(largest, float), (len(influence.planes),))
    if not is_traced(largest) and not bool(jnp.all(largest > 0)):
        raise BadInput("largest", largest, "> 0")
    matrix, initial = influence.weighted
    # In units of the bounds, so that planes of different size step alike.
    scaled = matrix * largest
    rate = 1 / jnp.maximum(jnp.linalg.norm(scaled, ord=2) ** 2, 1e-300)
    whole = jnp.maximum(jnp.sum(jnp.abs(initial) ** 2), 1e-300)

    def slope(x):
        return scaled.conj().T @ (scaled @ x + initial)

    def inside(x):
        return x / jnp.maximum(jnp.abs(x), 1.0)

    def gap(x):
        """Of half the sum of squares: Re<g, x - s> at its largest over the bounded s."""
        g = slope(x)
        return jnp.sum((g.conj() * x).real + jnp.abs(g))

    def going_on(carry):
        _, _, _, left, steps = carry
        return (2 * left > tolerance * whole) & (steps < max_steps)

    def advance(carry):
        x, y, momentum, _, steps = carry
        new = inside(y - rate * slope(y))
        uphill = jnp.sum(((y - new).conj() * (new - x)).real) > 0
        later = jnp.where(uphill, 1.0, 0.5 * (1 + jnp.sqrt(1 + 4 * momentum**2)))
        y = new + jnp.where(uphill, 0.0, (momentum - 1) / later) * (new - x)
        return new, y, later, gap(new), steps + 1

    zero = jnp.zeros(largest.size, complex)
    start = (zero, zero, jnp.ones(()), jnp.asarray(jnp.inf), jnp.asarray(0))
    x, _, _, left, _ = lax.while_loop(going_on, advance, start)
    objective = jnp.linalg.norm(scaled @ x + initial)
    bound = jnp.sqrt(jnp.maximum(objective**2 - 2 * jnp.maximum(left, 0.0), 0.0))
    return Balance(influence, x * largest, objective, bound, "bounded least squares")


def _balance(influence, correction, method) -> Balance:
    objective = jnp.linalg.norm(influence.weight * influence.vibration(correction))
    return Balance(influence, correction, objective, objective, method)


def quadratic(influence: Influence):
    """The weighted sum of squares as a function of the corrections, for any descent."""

    def objective(correction):
        matrix, initial = influence.weighted
        rest = initial + matrix @ correction
        return jnp.sum(rest.real**2 + rest.imag**2)

    return jax.jit(objective)
