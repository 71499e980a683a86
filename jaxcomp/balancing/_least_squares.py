r"""Balances in the weighted sum of squares.

Exact, least, minimum norm, truncated, Tikhonov, bounded: $\min_B \|W (V_0 + C B)\|_2$, by the singular
value decomposition and never by the normal equations.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Complex, Float

from .._core.errors import BadInput
from .._core.extremes import max_of, maximum, min_of, minimum
from .._core.fields import is_traced
from .._core.status import Status
from .._core.words import one_of
from ._balance import Balance, balance
from ._influence import Influence


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
    return _least_squares(influence, cut, tikhonov)


@eqx.filter_jit  # one program instead of thirty
def _least_squares(influence: Influence, cut: float, tikhonov) -> Balance:
    matrix, initial = influence.weighted
    left_vectors, values, right_vectors = jnp.linalg.svd(matrix, full_matrices=False)
    counted = values > cut * values[0]
    # Double where: a value that is left out may be zero, and must not be divided by in derivatives.
    safe = jnp.where(counted, values, 1.0)
    # without a penalty one over the value, as in the pseudo-inverse; with one, small values are damped
    share = jnp.where(counted, safe / (safe**2 + (tikhonov * values[0]) ** 2), 0.0)
    correction = -right_vectors.conj().T @ (share * (left_vectors.conj().T @ initial))
    return _exact(influence, correction, "least squares")


def predicted(
    influence: Influence, correction: Complex[Array, " planes"], method: str = "given"
) -> Balance:
    """Balance by given corrections; the bound is the least squares.

    Args:
        influence: the system.
        correction: [kg m] (planes,)
        method: name of the result.
    """
    correction = jnp.asarray(correction, complex)
    bound = least_squares(influence).bound
    return balance(influence, correction, influence.size(correction), bound, method)


def bounded(
    influence: Influence,
    largest: Float[Array, " planes"] | Mapping[str, float],
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
        largest: [kg m] (planes,) bound of |B|; or by plane, and the others are free.
        tolerance: [-] of the gap between the sum of squares and its bound, over the sum of squares. A
            gap below 1e-12 of the vibration before, where rounding begins, is taken for closed.
        max_steps: after which to stop; the status then says that it did not converge.

    Raises:
        BadInput: a bound that is not positive, or of an unknown plane.
    """
    count = len(influence.planes)
    largest = jnp.broadcast_to(jnp.asarray(bounds_of(influence, largest), float), (count,))
    if not is_traced(largest) and not bool(jnp.all(largest > 0)):
        raise BadInput("largest", largest, "> 0")
    matrix, initial = influence.weighted
    size = jnp.sqrt(jnp.sum(jnp.abs(initial) ** 2))
    size = jnp.where(size > 0, size, 1.0)
    # x = B/largest, and vibration in units of what was there
    discs = _discs(matrix * largest / size, initial / size)

    def open_(high, low):
        return (high - low > tolerance * high) & (jnp.sqrt(high) - jnp.sqrt(low) > 1e-12)

    def going_on(carry):
        _, _, high, low, steps = carry
        return open_(high, low) & (steps < max_steps)

    def advance(carry):
        x, multiplier, _, low, steps = carry
        x, multiplier = discs.advanced(x, multiplier)
        # the bound is one for any multipliers, but need not rise with them: the best so far stays
        low = maximum(low, discs.bound(multiplier))
        return x, multiplier, discs.squares(x), low, steps + 1

    x = jnp.zeros(2 * count)
    # of the size of the gradient at x = 0, and above zero where nothing vibrates
    multiplier = jnp.full(count, max_of(jnp.abs(discs.a.T @ discs.b)) + 1e-300)
    start = (x, multiplier, discs.squares(x), jnp.zeros(()), jnp.asarray(0))
    x, _, high, low, _ = lax.while_loop(going_on, advance, start)
    # A traced bound cannot raise; not a number, `balance` takes it for a bad input.
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


def bounds_of(influence: Influence, largest: Any) -> Any:
    """[kg m] Bounds in the order of the planes, of bounds by plane.

    A plane that is not named has a thousand times the sum of all bounds and of the largest least-squares
    correction, which binds nothing.

    Raises:
        BadInput: an unknown plane.
    """
    if not isinstance(largest, Mapping):
        return largest
    for name in largest:
        if name not in influence.planes:
            raise BadInput(f"largest.{name}", name, one_of(name, influence.planes))
    largest_correction = max_of(jnp.abs(least_squares(influence).correction))
    free = 1e3 * (sum(largest.values()) + largest_correction)
    return jnp.stack([jnp.asarray(largest.get(name, free)) for name in influence.planes])


class _Discs(NamedTuple):
    """Least squares |A x + b|^2 with every entry of a complex x within the unit disc.

    Attributes:
        a, b: real, for the real parts of x with the imaginary ones below them.
        unreachable: squares that no x can remove.
    """

    a: Float[Array, "r r"]
    b: Float[Array, " r"]
    unreachable: Float[Array, ""]

    def squares(self, x):
        """The sum of squares."""
        return jnp.sum((self.a @ x + self.b) ** 2) + self.unreachable

    def bound(self, multiplier):
        """The minimum of the Lagrangian over all x, which no x within the discs gets below."""
        root = jnp.sqrt(jnp.tile(multiplier, 2))
        rows = jnp.vstack([self.a, jnp.diag(root)])
        x = _solved(rows, jnp.append(-self.b, jnp.zeros(root.size)))
        return self.squares(x) + jnp.sum((root * x) ** 2) - jnp.sum(multiplier)

    def advanced(self, x, multiplier):
        """A Newton step towards a tenth of the mean of multiplier times room."""
        room = (1 - _dots(x, x)) / 2
        # The factor mu of the source, 10.
        target = 0.1 * jnp.mean(multiplier * room)
        steep = jnp.sqrt(multiplier / room)
        real, imaginary = x.reshape(2, -1)
        radial = jnp.hstack([jnp.diag(steep * real), jnp.diag(steep * imaginary)])
        rows = [self.a, jnp.diag(jnp.sqrt(jnp.tile(multiplier, 2))), radial]
        # Rows whose normal equations are the Newton step with the change of multipliers eliminated.
        right = [-(self.a @ x + self.b), jnp.zeros(x.size), -target / jnp.sqrt(multiplier * room)]
        step = _solved(jnp.vstack(rows), jnp.concatenate(right))
        change = (target + multiplier * _dots(x, step)) / room - multiplier
        # The shares of the step at which a plane reaches its bound, or a multiplier zero.
        along = _dots(x, step)
        step_squared = _dots(step, step)
        # The root of |x + s dx| = 1 with the surd below, because a plane that does not move divides
        # by zero in the usual form.
        ends = 2 * room / (along + jnp.sqrt(along**2 + 2 * step_squared * room) + 1e-300)
        ends = jnp.append(ends, jnp.where(change < 0, -multiplier / change, jnp.inf))
        # Short of the bound, where the next step divides by room and multipliers.
        share = minimum(1.0, 0.99 * min_of(ends))
        return x + share * step, multiplier + share * change


def _discs(matrix: Complex[Array, "rows planes"], initial: Complex[Array, " rows"]) -> _Discs:
    """In real numbers, and reduced to as many rows as unknowns."""
    # Orthogonal, so that it changes no sum of squares but by the part that no x reaches.
    q, a = jnp.linalg.qr(jnp.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]]))
    b = jnp.append(initial.real, initial.imag)
    unreachable = jnp.sum((b - q @ (q.T @ b)) ** 2)
    return _Discs(a, q.T @ b, unreachable)


def _dots(x, y) -> Float[Array, " planes"]:
    """Products of complex entries as of vectors in the plane."""
    return jnp.sum((x * y).reshape(2, -1), 0)


def _solved(rows, right):
    """Least squares of a tall real system."""
    q, r = jnp.linalg.qr(rows)
    return solve_triangular(r, q.T @ right)


def _exact(influence, correction, method, failure=None) -> Balance:
    objective = influence.size(correction)
    return balance(influence, correction, objective, objective, method, failure)


def quadratic(influence: Influence) -> Callable[[Array], Array]:
    """The weighted sum of squares as a function of the corrections, for any descent.

    Args:
        influence: rows with their weights, as `direct_influence` makes them.
    """

    def objective(correction):
        matrix, initial = influence.weighted
        vibration = initial + matrix @ correction
        # by parts, a polynomial of the corrections: an `abs` would take a root only to square it
        return jnp.sum(vibration.real**2 + vibration.imag**2)

    return jax.jit(objective)
