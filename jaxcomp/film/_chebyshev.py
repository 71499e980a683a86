"""Chebyshev series with traced coefficients, and their continuation to a known limit."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


@jax.custom_jvp
@jax.jit
def chebyshev_sum(coefficients: Float[Array, " n"], t: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Sum of c_k T_k(t) by Clenshaw's recurrence.

    The loop is unrolled: a short chain of multiplications that XLA fuses into one kernel. The
    derivative is a series of the same kind, which keeps derivatives of every order that short.
    """
    last = before = jnp.zeros_like(t)
    for k in range(coefficients.shape[0] - 1, 0, -1):
        last, before = coefficients[k] + 2 * t * last - before, last
    return coefficients[0] + t * last - before


@chebyshev_sum.defjvp
def _chebyshev_sum_jvp(primals, tangents):
    coefficients, t = primals
    coefficients_dot, t_dot = tangents
    slope = chebyshev_sum(_derivative_matrix(coefficients.shape[0]) @ coefficients, t)
    basis = _basis(coefficients.shape[0], t)
    return chebyshev_sum(*primals), slope * t_dot + jnp.tensordot(coefficients_dot, basis, axes=1)


@functools.cache
def _derivative_matrix(n: int) -> np.ndarray:
    """Coefficients of the derivative from the coefficients, one fewer."""
    return np.polynomial.chebyshev.chebder(np.eye(n))


@functools.partial(jax.jit, static_argnums=0)
def _basis(n: int, t: Float[Array, "*b"]) -> Float[Array, "n *b"]:
    """T_0(t) ... T_(n-1)(t)."""
    values = [jnp.ones_like(t), t]
    for _ in range(n - 2):
        values.append(2 * t * values[-1] - values[-2])
    return jnp.stack(values[:n])


@jax.jit
def collapsed(
    coefficients: Float[Array, "n m"], interval: Float[Array, " 2"], x: Float[Array, ""]
) -> Float[Array, " n"]:
    """The series in the first axis that a tensor series leaves at `x` of its second axis.

    Outside `interval` the series goes on along its tangent, because the polynomial itself would
    run away.
    """
    low, high = interval
    t = (2 * x - low - high) / (high - low)
    inside = jnp.where(t > 1, 1.0, jnp.where(t < -1, -1.0, t))
    # The tangent at the end of the interval; inside it the second term is zero.
    values, slopes = jax.jvp(lambda t: _basis(coefficients.shape[1], t), (inside,), (t - inside,))
    return coefficients @ (values + slopes)


class Place(eqx.Module):
    """Coordinate t in [-1, 1] of s in [edge, 1], with nodes drawn together about a centre.

    s = centre + width sinh(shift + scale t) (Tee and Trefethen 2006); without a centre t is linear.
    """

    edge: float = eqx.field(static=True)
    crowd: tuple[Float[Array, ""], Float[Array, ""]] | None = None  # centre and width

    def __call__(self, s: Float[Array, "*b"]) -> Float[Array, "*b"]:
        if self.crowd is None:
            return (2 * s - self.edge - 1) / (1 - self.edge)
        centre, width, low, high = self._sinh(self.crowd)
        return (2 * jnp.arcsinh((s - centre) / width) - low - high) / (high - low)

    def back(self, t: Float[Array, "*b"]) -> Float[Array, "*b"]:
        """s of t."""
        if self.crowd is None:
            return 0.5 * (1 + self.edge) + 0.5 * (1 - self.edge) * t
        centre, width, low, high = self._sinh(self.crowd)
        return centre + width * jnp.sinh(0.5 * (low + high) + 0.5 * (high - low) * t)

    def edge_slope(self) -> Float[Array, ""]:
        """dt/ds at the edge."""
        if self.crowd is None:
            return jnp.asarray(2 / (1 - self.edge))
        centre, width, low, high = self._sinh(self.crowd)
        return 2 / ((high - low) * jnp.sqrt(width**2 + (self.edge - centre) ** 2))

    def _sinh(self, crowd):
        centre, width = crowd
        ends = (jnp.arcsinh((end - centre) / width) for end in (self.edge, 1.0))
        return centre, width, *ends


class SeriesToLimit(eqx.Module):
    """A function of s = sqrt(1 - eps): a Chebyshev series on [edge, 1], continued down to s = 0.

    The continuation has the value and the slope of the series at the edge and the known limit, and
    the limiting slope if that is known, at s = 0 (the journal touching the bush): a parabola or
    Hermite's cubic.
    """

    coefficients: Float[Array, " n"]
    edge_value: Float[Array, ""]
    edge_slope: Float[Array, ""]
    limit: Float[Array, ""]
    place: Place
    limit_slope: float | None = eqx.field(static=True)

    def __init__(
        self,
        coefficients: Float[Array, " n"],
        place: Place,
        limit: Float[Array, ""],
        limit_slope: float | None = None,
    ):
        order = np.arange(coefficients.shape[0])
        self.coefficients, self.place = coefficients, place
        self.limit, self.limit_slope = limit, limit_slope
        self.edge_value = coefficients @ (-1.0) ** order  # T_k(-1)
        self.edge_slope = coefficients @ ((-1.0) ** (order + 1) * order**2) * place.edge_slope()

    def __call__(self, s: Float[Array, ""]) -> Float[Array, ""]:
        edge = self.place.edge
        beyond = s < edge
        t = self.place(jnp.where(beyond, edge, s))
        outer = continuation(
            s, edge, self.edge_value, self.edge_slope, self.limit, self.limit_slope
        )
        return jax.lax.select(beyond, outer, chebyshev_sum(self.coefficients, t))


def continuation(s, edge, value, slope, limit, limit_slope=None):
    """Polynomial with `value` and `slope` at `edge`, `limit` (and `limit_slope`) at zero."""
    rise, t = value - limit, s / edge
    if limit_slope is None:
        return limit + t * (2 * rise - edge * slope + t * (edge * slope - rise))
    start, end = edge * limit_slope, edge * slope
    return limit + t * (start + t * (3 * rise - 2 * start - end + t * (start + end - 2 * rise)))
