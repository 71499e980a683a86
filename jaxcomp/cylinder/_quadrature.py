r"""Weights of flows at the nodes of panels in their harmonics.

What runs through values at the nodes is a polynomial on every panel. Where the revolution passes evenly
its product with a harmonic is integrated exactly, however wide the panel is (Filon's method):

$$\frac12\int_{-1}^1 P_k(x)\,e^{i a x}\,dx = i^k j_k(a),\qquad a = n w/2 .$$
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import max_of
from .._core.polynomials import gauss
from ._cylinder import Case

# Points on every panel at which flows are multiplied with harmonics where the speed fluctuates: exact to
# rounding while n width/2 < 20, where Gauss's rule with the nodes of the collocation alone ends at 3.
_FINE = 24
_WIDEST = 20.0
# Argument up to which spherical Bessel functions are summed, and terms of that: to rounding.
_SERIES = 8
_TERMS = 32


class Quadrature(NamedTuple):
    """Weights of the flows at the nodes of p panels in their harmonics.

    Attributes:
        nodes: (p, s, h) of the values there.
        to_left, to_right: (p, s, h) change of these weights with the panel's edges.
    """

    nodes: Float[Array, "p s h"]
    to_left: Float[Array, "p s h"]
    to_right: Float[Array, "p s h"]


def harmonics(tau: Float[Array, "*n"], orders: int) -> Float[Array, "*n h"]:
    """1, then cosines, then sines of multiples of an angle.

    By sums of multiples, twice as many every time, so that an angle has one cosine and one sine of its
    own; what rounding leaves grows with the order, to 3e-14 at 64.
    """
    cosine = jnp.cos(tau)[..., None]
    sine = jnp.sin(tau)[..., None]
    while (count := cosine.shape[-1]) < orders:
        added = min(count, orders - count)
        cos_last = cosine[..., -1:]
        sin_last = sine[..., -1:]
        cos_added = cosine[..., :added] * cos_last - sine[..., :added] * sin_last
        sin_added = sine[..., :added] * cos_last + cosine[..., :added] * sin_last
        cosine = jnp.concatenate([cosine, cos_added], axis=-1)
        sine = jnp.concatenate([sine, sin_added], axis=-1)
    return jnp.concatenate([jnp.ones_like(tau)[..., None], cosine, sine], axis=-1)


def series_at(series: Float[Array, "*f h"], tau: Float[Array, ""]) -> Float[Array, "*f"]:
    """Values of series of `harmonics` at an angle, by Horner's rule in e^{i tau}."""
    orders = series.shape[-1] // 2
    parts = jnp.moveaxis(series[..., 1:], -1, 0)
    cosine = jnp.cos(tau)
    sine = jnp.sin(tau)

    # coefficients a - i b, from the highest order down; of the sum times e^{i tau} the real part
    # counts
    def add_term(total, term):
        real = total[0] + term[0]
        imaginary = total[1] - term[1]
        return (real * cosine - imaginary * sine, real * sine + imaginary * cosine), None

    start = jnp.zeros_like(parts[0] * tau)
    terms = (parts[:orders], parts[orders:])
    (real, _), _ = lax.scan(add_term, (start, start), terms, reverse=True)
    return series[..., 0] + real


def machine_time(case: Case, phase, own_angle):
    """tau [rad] at an own angle of the first cylinder, and its rate over the angle."""
    tau = own_angle - phase
    # a constant in the shape of the angle
    rate = 1 + 0 * own_angle
    if case.pace is not None:
        tau = tau + case.pace.lag(own_angle)
        rate = rate + case.pace.at(own_angle)
    return tau, rate


def quadrature(case: Case, phase, edges: Float[Array, " e"], nodes: int, orders: int) -> Quadrature:
    """Weights of the harmonics in time of what polynomials on panels run through.

    The first row gives the mean over a revolution, the others the amplitudes of cosine and sine.
    """
    if case.pace is None:
        return _even(edges, nodes, orders)
    return _uneven(case, phase, edges, nodes, orders)


def is_too_wide(case: Case, edges: Float[Array, " e"], orders: int):
    """Whether harmonics on the widest panel are no more exact."""
    if case.pace is None:
        return jnp.asarray(False)
    return max_of(jnp.diff(edges)) * orders / 2 > _WIDEST


def _scale(orders: int) -> np.ndarray:
    """From integrals over a revolution to the mean and to amplitudes."""
    scale = np.full(2 * orders + 1, 1 / np.pi)
    scale[0] = 1 / (2 * np.pi)
    return scale


def _even(edges: Float[Array, " e"], nodes: int, orders: int) -> Quadrature:
    """Weights where the revolution passes evenly."""
    rule = gauss(nodes)
    numbers = np.arange(orders + 1.0)
    width = jnp.diff(edges)
    # a of the formula above, for every panel and order
    place = width[:, None] / 2 * numbers
    bessel, slope = spherical_bessel(place, nodes)
    # i^k, as parts of the real and of the imaginary part
    sign = np.array([1.0, 1.0, -1.0, -1.0])[np.arange(nodes) % 4]
    is_even = np.arange(nodes) % 2 == 0
    series = sign[:, None] * rule.to_legendre
    even = jnp.asarray(np.where(is_even[:, None], series, 0.0))
    odd = jnp.asarray(np.where(is_even[:, None], 0.0, series))

    def on_nodes(values, matrix):
        return jnp.einsum("pnk,kj->pjn", values, matrix)

    middle = (edges[:-1] + width / 2)[:, None]
    turning = harmonics(middle[:, 0], orders)[:, None]
    cosine = jnp.concatenate([jnp.ones_like(middle)[:, None], turning[..., 1 : 1 + orders]], axis=2)
    sine = jnp.concatenate([jnp.zeros_like(middle)[:, None], turning[..., 1 + orders :]], axis=2)

    def turned(real, imaginary):
        """Real and imaginary part of what the middle of the panel turns, as rows of a series."""
        of_cosine = cosine * real - sine * imaginary
        of_sine = sine * real + cosine * imaginary
        return jnp.concatenate([of_cosine, of_sine[..., 1:]], axis=2) * _scale(orders)

    real = on_nodes(bessel, even)
    imaginary = on_nodes(bessel, odd)
    # an edge moves the middle of its panel by half of its own way and the width by all of it:
    # slopes over the left edge are half those over the middle less those over the width, over the
    # right edge the sum
    share = place[:, None]
    values = turned(real, imaginary)
    moved = turned(-share * imaginary, share * real)
    widened = values + turned(share * on_nodes(slope, even), share * on_nodes(slope, odd))
    return Quadrature(width[:, None, None] * values, moved - widened, moved + widened)


def _uneven(case: Case, phase, edges: Float[Array, " e"], nodes: int, orders: int) -> Quadrature:
    """Weights where the speed fluctuates, at fine points of every panel."""
    rule = gauss(_FINE)
    through = jnp.asarray(gauss(nodes).through(rule.nodes))
    width = jnp.diff(edges)
    angle = edges[:-1, None] + width[:, None] * rule.nodes
    scale = _scale(orders)

    def density(angle):
        tau, rate = machine_time(case, phase, phase + angle)
        return harmonics(tau, orders) * (rate[..., None] * scale)

    def at(angle):
        return jax.vmap(density)(angle.ravel()).reshape(*angle.shape, -1)

    # an edge moves the points, and stretches the panel that weighs them
    values, slopes = jax.jvp(at, (angle,), (jnp.ones_like(angle),))
    values = values * rule.weights[:, None]
    slopes = slopes * rule.weights[:, None] * width[:, None, None]
    by_left_edge = -values + slopes * (1 - rule.nodes)[:, None]
    right = values + slopes * rule.nodes[:, None]

    def on_nodes(fine):
        return jnp.einsum("mj,pmh->pjh", through, fine)

    return Quadrature(
        on_nodes(values * width[:, None, None]), on_nodes(by_left_edge), on_nodes(right)
    )


@cache
def _series_of_bessel(order: int) -> np.ndarray:
    """Coefficients of j_k(x)/x^k in powers of x^2, the highest first."""
    term = 1 / np.prod(np.arange(1.0, 2 * order + 2, 2))
    terms = [term]
    for number in range(1, _TERMS):
        term *= -1 / (2 * number * (2 * order + 2 * number + 1))
        terms.append(term)
    return np.array(terms[::-1])


def spherical_bessel(x: Float[Array, "*n"], count: int):
    """Spherical Bessel functions j_0 to j_(count - 1) of x >= 0, and their derivatives.

    Near zero the highest two by their series and the others by recursion downward, which is stable
    there; beyond by recursion upward.

    Returns:
        (..., count) of each.
    """
    border = max(_SERIES, count + 2)
    is_near = x < border
    # double where: either branch is computed at an argument of its own range, as the series fails
    # far out and the quotients at zero
    near = jnp.where(is_near, x, border)
    square = near**2
    coefficients = np.stack([_series_of_bessel(count), _series_of_bessel(count - 1)], axis=1)

    def add_term(total, coefficient):
        return total * square[..., None] + coefficient, None

    # of a scan XLA keeps what it has, where it would repeat a chain of products for every order
    start = jnp.zeros((*x.shape, 2))
    highest, _ = lax.scan(add_term, start, jnp.asarray(coefficients))

    def lower(pair, factor):
        above, scaled = pair
        return (scaled, factor * scaled - square * above), scaled

    factors = 2.0 * np.arange(count + 2) + 1
    pair = highest[..., 0], highest[..., 1]
    _, scaled = lax.scan(lower, pair, jnp.asarray(factors[:count][::-1]))
    scaled = jnp.concatenate([pair[0][None], scaled])[::-1]
    powers = [jnp.ones_like(near)]
    for _ in range(count):
        powers.append(powers[-1] * near)
    by_series = scaled * jnp.stack(powers)
    far = jnp.where(is_near, border, x)
    first = jnp.sin(far) / far

    def higher(pair, factor):
        below, value = pair
        return (value, factor / far * value - below), below

    pair = first, (first - jnp.cos(far)) / far
    _, by_recursion = lax.scan(higher, pair, jnp.asarray(factors[1:]))
    values = jnp.moveaxis(jnp.where(is_near, by_series, by_recursion), 0, -1)
    orders = np.arange(count)
    # (2 k + 1) j_k' = k j_(k-1) - (k + 1) j_(k+1)
    below = jnp.roll(values, 1, axis=-1)[..., :count]
    # of j_0 the first of these counts nothing
    slopes = (orders * below - (orders + 1) * values[..., 1:]) / (2 * orders + 1)
    return values[..., :count], slopes
