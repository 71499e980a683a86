"""Piecewise polynomials: Gauss-Legendre on panels, and cubics between points."""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from .extremes import clip


class Rule(NamedTuple):
    """Gauss-Legendre on [0, 1]."""

    nodes: np.ndarray  # abscissae
    weights: np.ndarray  # quadrature weights
    integral: np.ndarray  # row i integrates the polynomial through the nodes from 0 to node i
    # coefficients in Legendre polynomials of 2 x - 1 from values at the nodes
    to_legendre: np.ndarray

    def through(self, x: np.ndarray) -> np.ndarray:
        """Values at places x in [0, 1] of the polynomial through values at the nodes: a matrix."""
        return legendre.legvander(2 * x - 1, self.nodes.size - 1) @ self.to_legendre

    def weights_at(self, x: Float[Array, "*n"]) -> Float[Array, "*n s"]:
        """Weights of the values at the nodes in the polynomial's value at places x in [0, 1].

        Without derivatives to the places.
        """
        diagonal = np.eye(self.nodes.size, dtype=bool)
        # products instead of the barycentric form, which divides by zero where a place is a node
        between = 1 / np.prod(np.where(diagonal, 1.0, self.nodes[:, None] - self.nodes), axis=-1)
        away = clip(lax.stop_gradient(x), 0.0, 1.0)[..., None, None] - self.nodes
        return between * jnp.prod(jnp.where(diagonal, 1.0, away), axis=-1)

    @property
    def damping(self) -> np.ndarray:
        """Weights that make `integral` that of Radau's method IIA: errors of a stiff equation die in one
        panel.

        By it the highest Legendre polynomial of the integral, which vanishes at the nodes, is replaced
        by the one below, of the same value at the right end (Hairer and Wanner 1996, Solving Ordinary
        Differential Equations II, section IV.5, W-transformation).
        """
        count = self.nodes.size
        below = legendre.legvander(2 * self.nodes - 1, count - 1)[:, -1]
        # The integral of P_(n-1) ends with P_n/(2 n - 1), halved on a panel from 0 to 1.
        return np.outer(below, self.to_legendre[-1]) / (4 * count - 2)

    @property
    def derivative(self) -> np.ndarray:
        """From values at the nodes to the slopes there, per width of the panel."""
        slopes = legendre.legder(self.to_legendre)
        return 2 * legendre.legvander(2 * self.nodes - 1, self.nodes.size - 2) @ slopes


@cache
def gauss(count: int) -> Rule:
    """The rule with so many nodes."""
    x, w = legendre.leggauss(count)
    coefficients = np.linalg.inv(legendre.legvander(x, count - 1))
    # integrals from the left end; the rule of NumPy is on [-1, 1], twice as wide as a panel
    primitive = np.stack([legendre.legint(c, lbnd=-1) for c in coefficients.T], axis=1)
    integral = legendre.legvander(x, count) @ primitive
    return Rule((x + 1) / 2, w / 2, integral / 2, coefficients)


def legendre_columns(x: Float[Array, "*n"], count: int) -> Float[Array, "count *n"]:
    """The first Legendre polynomials at x, with derivatives.

    Bonnet's recurrence for polynomials that begin with $x^k$, whose fewer operations count in programs,
    which have this for every pressure and speed; their leading coefficients follow at the end.
    """
    columns = [jnp.ones_like(x), x]
    leading = [1.0, 1.0]
    for k in range(1, count - 1):
        columns.append(x * columns[k] - k**2 / (4 * k**2 - 1) * columns[k - 1])
        leading.append(leading[k] * (2 * k + 1) / (k + 1))
    scales = np.array(leading[:count]).reshape(-1, *[1] * jnp.ndim(x))
    return jnp.stack(columns[:count]) * scales


def cubic_step(t, width, ends, slopes):
    """Value at a share t of a step of the cubic with these values and slopes at its ends (Hermite)."""
    s = 1 - t
    begin, end = ends
    begin_slope, end_slope = slopes
    return (
        begin * s * s * (1 + 2 * t)
        + end * t * t * (1 + 2 * s)
        + width * t * s * (begin_slope * s - end_slope * t)
    )


def quintic_step(t, width, ends, slopes, bends):
    """Step of an event on the quintic with these values, slopes and second derivatives at its ends."""
    s = 1 - t
    begin, end = ends
    begin_slope, end_slope = slopes
    begin_bend, end_bend = bends
    # 1 + 3 t + 6 t^2 begins the series of (1 - t)^-3, which the factor s^3 of the result takes off
    # again: value, slope and second derivative at this end stay as they are, at the other end all three
    # are zero.
    near_slope = begin_slope * (1 + 3 * t) + width * t * begin_bend / 2
    near = begin * (1 + 3 * t + 6 * t**2) + width * t * near_slope
    far_slope = end_slope * (1 + 3 * s) - width * s * end_bend / 2
    far = end * (1 + 3 * s + 6 * s**2) - width * s * far_slope
    return s**3 * near + t**3 * far


def cubics(
    x: Float[Array, "*m"],
    knots: Float[Array, " n"],
    values: Float[Array, " n"],
    slopes: Float[Array, " n"],
) -> Float[Array, "*m"]:
    """Value at x of the cubics between points with these slopes; those at the ends go on beyond."""
    # a point on a knot belongs to the interval that begins there; the outer ones go on
    interval = clip(jnp.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    width = knots[interval + 1] - knots[interval]
    t = (x - knots[interval]) / width
    return cubic_step(
        t, width, (values[interval], values[interval + 1]), (slopes[interval], slopes[interval + 1])
    )


def inner_slopes(
    knots: Float[Array, " n"], values: Float[Array, " n"]
) -> tuple[Float[Array, " n-1"], Float[Array, " n-2"]]:
    """Slopes of the lines between points, and of the parabolas through three at all but the ends."""
    gap = jnp.diff(knots)
    secant = jnp.diff(values) / gap
    # the slope of the parabola weights each secant with the other gap: the nearer point counts more
    parabola = (gap[1:] * secant[:-1] + gap[:-1] * secant[1:]) / (gap[1:] + gap[:-1])
    return secant, parabola
