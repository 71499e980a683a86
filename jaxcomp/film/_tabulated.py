r"""Reynolds (Swift-Stieber) films of full journal bearings, from tables of solutions.

The film starts with p = 0 on the line of maximum film and ends where p = dp/dn = 0: the film of
Raimondi and Boyd (1958), Butenschoen (1976), VDI 2204, DIN 31652 and ISO 7902. The start travels
with the line of centres.

The Reynolds equation was solved offline (`_reference`). A table holds three smooth functions of
s = sqrt(1 - eps) and ln q as tensor Chebyshev series: ln(Phi_p (1-eps)/(eps q^2)), the attitude
angle, and ln(C_rr (1-eps)^1.5/q^2). They have expansions in eps at one end and in s at the other.
A fourth series gives Phi_T of Phi_p at once, without a position in between.

A film between axial grooves needs two more functions. Along its load line the attitude angle moves
the film against the line of centres; Someya's stiffness (and that of other databooks) lets the film
move with the journal instead, so that it is not the slope of the tabulated forces. The table holds
K_rr (1-eps)/(Phi_p/eps) and K_tr (1-eps)/(Phi_p/eps), found from the linear response of the film.
Its nodes crowd about the eccentricity ratio, a function of L/D, from which on the film of the mid-plane
ends ahead of the groove: second derivatives of the force, and slopes of the coefficients, are steep
below it and jump there.
"""

import functools
import json
from importlib import resources
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._film import AbstractSolvedFilm, Scalar, as_float, slope_stiffness


@jax.custom_jvp
@jax.jit
def chebyshev_sum(coefficients: Float[Array, " n"], t: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Sum of c_k T_k(t) by Clenshaw's recurrence.

    The loop is unrolled: a short chain of multiplications that XLA fuses into one kernel. The
    derivative is a series of the same kind, which keeps derivatives of every order that short.
    """
    b_1 = b_2 = jnp.zeros_like(t)
    for k in range(coefficients.shape[0] - 1, 0, -1):
        b_0 = coefficients[k] + 2 * t * b_1 - b_2
        b_2 = b_1
        b_1 = b_0
    return coefficients[0] + t * b_1 - b_2


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
        self.coefficients = coefficients
        self.place = place
        self.limit = limit
        self.limit_slope = limit_slope
        # With T_k(-1) = (-1)^k and T_k'(-1) = (-1)^(k+1) k^2.
        self.edge_value = coefficients @ (-1.0) ** order
        self.edge_slope = coefficients @ ((-1.0) ** (order + 1) * order**2) * place.edge_slope()

    def __call__(self, s: Float[Array, ""]) -> Float[Array, ""]:
        edge = self.place.edge
        beyond = s < edge
        # Double where: beyond the edge the polynomial and its slopes run away.
        t = self.place(jnp.where(beyond, edge, s))
        outer = continuation(
            s, edge, self.edge_value, self.edge_slope, self.limit, self.limit_slope
        )
        return jax.lax.select(beyond, outer, chebyshev_sum(self.coefficients, t))


def continuation(s, edge, value, slope, limit, limit_slope=None):
    """Polynomial with `value` and `slope` at `edge`, `limit` (and `limit_slope`) at zero."""
    rise = value - limit
    t = s / edge
    if limit_slope is None:
        return limit + t * (2 * rise - edge * slope + t * (edge * slope - rise))
    start = edge * limit_slope
    end = edge * slope
    return limit + t * (start + t * (3 * rise - 2 * start - end + t * (start + end - 2 * rise)))


# Limits for eps -> 1 at any L/D: the thin zone theta - pi = sqrt(2 (1-eps)) t looks infinitely
# long, h = (1-eps)(1 + t^2), and the Reynolds equation integrates in closed form. (Our derivation;
# the film ends at t = 0.47513.)
LOAD_LIMIT = 1.2237421234783  # Phi_p (1 - eps)
ATTITUDE_LIMIT = 1.8799209353354  # phi/sqrt(1 - eps)
DAMPING_LIMIT = 3.2741379095279  # C_rr (1 - eps)^1.5
CROWDING = 0.018  # how narrowly the nodes of a table crowd about its corner, in s


class AbstractTabulatedFilm(AbstractSolvedFilm):
    """Film from a table of solutions, collapsed to one L/D.

    Args:
        length_ratio: [-] q = L/D.
        table: arrays by name, as `tests/tools/film_tables.py` writes them; absent: those of
            the package.
    """

    load: SeriesToLimit
    attitude: SeriesToLimit
    damping_series: SeriesToLimit
    stiffness_series: tuple[SeriesToLimit, ...]
    friction: Scalar
    friction_scale: Scalar
    length_ratio_range: ClassVar[tuple[float, float]] = (0.1, 2.0)
    table_name: ClassVar[str]

    def __init__(self, length_ratio, *, table=None):
        table = table_of(self.table_name) if table is None else table
        q = as_float(length_ratio)
        ln_q = jnp.log(q)
        place = place_of(table, ln_q)

        def series(name, limit, limit_slope=None):
            coefficients = collapsed(table[name], table["ln_q_range"], ln_q)
            return SeriesToLimit(coefficients, place, jnp.asarray(limit, q.dtype), limit_slope)

        self.length_ratio = q
        self.load = series("load", jnp.log(LOAD_LIMIT) - 2 * ln_q)
        self.attitude = series("attitude", 0.0, ATTITUDE_LIMIT)
        self.damping_series = series("damping", jnp.log(DAMPING_LIMIT) - 2 * ln_q)
        # a closing film knows nothing of grooves: the limits of the plain ring
        # There F_r grows like 1/s^2 and F_t like 1/s, which leaves 1 and -phi/2.
        limits = ("stiffness_r", 1.0, None), ("stiffness_t", 0.0, -ATTITUDE_LIMIT / 2)
        self.stiffness_series = tuple(series(*each) for each in limits if each[0] in table)
        self.friction = collapsed(table["friction"], table["ln_q_range"], ln_q)
        self.friction_scale = self.load_gain(jnp.ones_like(q))  # Phi_p at eps = 1/2

    def load_gain(self, film_ratio):
        return self.length_ratio**2 * jnp.exp(self.load(_closeness(film_ratio)))

    def attitude_angle(self, film_ratio):
        return self.attitude(_closeness(film_ratio))

    def damping(self, film_ratio):
        x = film_ratio
        c_rr = self.length_ratio**2 * jnp.exp(self.damping_series(_closeness(x))) * (1 + x) ** 1.5
        # Maxwell's reciprocity of the linearised film: C_tr = C_rt = 2 F_r/eps
        chord = (1 + x) * self.load_gain(x) * jnp.cos(self.attitude_angle(x))
        return c_rr, -2 * chord

    def radial_stiffness(self, film_ratio):
        if not self.stiffness_series:
            return slope_stiffness(self, film_ratio)
        # Phi_p/eps over 1 - eps, by which the table divides.
        scale = (1 + film_ratio) ** 2 * self.load_gain(film_ratio)
        k_rr, k_tr = (series(_closeness(film_ratio)) for series in self.stiffness_series)
        return scale * k_rr, scale * k_tr

    def friction_number(self, load_number):
        # u ~ s for a short bearing and u^2 ~ s for a long one, so that P is smooth up to u = 0.
        # ln(Phi_T/pi) = -2 ln u - 2 (1 - u) + (1 - u)^2 P(u): Petroff's value with zero slope at no
        # load, and Phi_T ~ sqrt(Phi_p) at high load, whatever the polynomial P.
        root = jnp.sqrt(1 + load_number / self.friction_scale)
        u = 1 / jnp.sqrt(root)
        polynomial = chebyshev_sum(self.friction, 2 * u - 1)
        return jnp.pi * root * jnp.exp((1 - u) * ((1 - u) * polynomial - 2))

    def friction_number_at(self, film_ratio, load_number):
        # a fit over the load, which needs no position
        return self.friction_number(load_number)


def place_of(table: dict, ln_q: Scalar) -> Place:
    """Coordinate in s of a table at one L/D."""
    edge = float(table["s_range"][0])
    if "corner" not in table:
        return Place(edge)
    corner = jnp.exp(collapsed(table["corner"], table["ln_q_range"], ln_q)[0])  # eps of it
    return Place(edge, (jnp.sqrt(1 - corner), jnp.asarray(CROWDING, corner.dtype)))


def _closeness(film_ratio: Scalar) -> Scalar:
    """s = sqrt(1 - eps)"""
    # 1 - eps = 1/(1 + x) keeps its digits as the film closes, which a difference from 1 would lose.
    return 1 / jnp.sqrt(1 + film_ratio)


@functools.cache
def table_of(name: str) -> dict[str, np.ndarray]:
    """The arrays of a table of the package by their names."""
    text = resources.files(__package__).joinpath(name).read_text()
    return {k: np.asarray(v, float) for k, v in json.loads(text).items()}
