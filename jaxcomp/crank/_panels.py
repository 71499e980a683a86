"""Gauss panels: a revolution cut at its kinks, with polynomials in between.

Each panel carries s Gauss-Legendre nodes. Integrating the polynomial through the nodes from the
panel's left end gives the s-stage Gauss Runge-Kutta method, of order 2 s at the panel ends.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from .._core.extremes import clip, max_of, minimum
from .._core.lookup import interval_of
from .._core.polynomials import Rule, gauss

# [rad] Panels below hold no part of the revolution: edges that no load reversal needs lie on others.
NO_WIDTH = 1e-9


class Panels(NamedTuple):
    """A revolution cut into p panels with s nodes each."""

    edges: Float[Array, " p_plus_1"]  # [rad] shape (p + 1,), the last a revolution after the first
    angle: Float[Array, "p s"]  # [rad] nodes, shape (p, s)
    weight: Float[Array, "p s"]  # [rad] quadrature weights, shape (p, s)
    rule: Rule  # the Gauss rule on every panel

    @property
    def width(self) -> Float[Array, " p"]:
        """[rad]"""
        return jnp.diff(self.edges)

    def cumulative(
        self, values: Float[Array, "p s"]
    ) -> tuple[Float[Array, "p s"], Float[Array, " p_plus_1"]]:
        """Integral from the first edge to every node and to every edge."""
        over_panels = self.width * (values @ self.rule.weights)
        at_edges = jnp.concatenate([jnp.zeros(1), jnp.cumsum(over_panels)])
        within = self.width[:, None] * (values @ self.rule.integral.T)
        return at_edges[:-1, None] + within, at_edges

    def total(self, values: Float[Array, "*j p s"]) -> Float[Array, "*j"]:
        """Integral over the revolution."""
        return jnp.sum(self.weight * values, axis=(-2, -1))

    def by_panels(self, row: Float[Array, "*m r"]) -> Float[Array, "*m p s"]:
        """Values in a row at the nodes, by panels; what follows the nodes in the row is left out."""
        return row[..., : self.angle.size].reshape(*row.shape[:-1], *self.angle.shape)

    def panel_of(self, angle: Float[Array, "*n"]) -> Int[Array, "*n"]:
        """Index of the panel that holds an angle [rad]; at an edge, the one that begins there."""
        return interval_of(self.edges, angle)

    def interpolate(self, values, angle: Float[Array, "*n"]):
        """Value at angles [rad] within the revolution of the panel polynomials there.

        Without derivatives to the angles.

        Args:
            values: at the nodes, (..., p, s); or a tree of such arrays.
            angle: [rad] (*n).
        """
        panel = self.panel_of(angle)
        width = self.width[panel]
        x = jnp.where(width > 0, (angle - self.edges[panel]) / jnp.where(width > 0, width, 1), 0.5)
        weight = self.rule.weights_at(x)
        return jax.tree.map(lambda v: jnp.sum(v[..., panel, :] * weight, axis=-1), values)


def panels(edges: Float[Array, " k"], nodes: int) -> Panels:
    """Panels from the sorted edges of a revolution, of which the last is a revolution after the first.

    Args:
        edges: [rad] (k,) sorted crank angles; equal ones make panels of no width.
        nodes: of the Gauss rule in each panel.
    """
    rule = gauss(nodes)
    width = jnp.diff(edges)[:, None]
    return Panels(edges, edges[:-1, None] + width * rule.nodes, width * rule.weights, rule)


def highest(rule: Rule, width: Float[Array, " p"], values: Float[Array, "p s"]) -> Float[Array, ""]:
    """Largest value of the panel polynomials. Panels of no width do not count.

    Its place needs no derivative: the slope vanishes there.

    Args:
        rule: of the nodes in each panel.
        width: [rad] of the panels, (p,).
        values: at the nodes, (p, s).
    """
    fixed = lax.stop_gradient(values)
    x = np.linspace(0.0, 1.0, 2 * rule.nodes.size + 1)
    samples = fixed @ rule.through(x).T
    samples = jnp.where(lax.stop_gradient(width)[:, None] > NO_WIDTH, samples, -jnp.inf)
    derivative = rule.derivative

    def refined(panel):
        start = jnp.asarray(x)[jnp.argmax(samples[panel])]
        slope = derivative @ fixed[panel]
        slope_and_bend = jnp.stack([slope, derivative @ slope])

        def newton(_, place):
            slope, bend = slope_and_bend @ rule.weights_at(place)
            return clip(place - slope / minimum(bend, -1e-300), start - x[1], start + x[1])

        place = clip(lax.fori_loop(0, 4, newton, start), 0.0, 1.0)
        # where the polynomial bends upwards Newton's method leaves the maximum
        return max_of(rule.weights_at(jnp.stack([place, start])) @ values[panel])

    # of an edge that two panels share either may have the largest value close to it
    _, best = lax.top_k(max_of(samples, axis=1), min(2, samples.shape[0]))
    return max_of(jax.vmap(refined)(best))


def farthest(
    rule: Rule, width: Float[Array, " p"], vectors: Float[Array, "k p s"]
) -> Float[Array, ""]:
    """Largest length of vectors whose components are panel polynomials, as `highest`.

    The square of the length is a polynomial of twice the degree; the length itself is none, and turns
    sharply where a vector passes near zero.
    """
    fine = gauss(2 * rule.nodes.size)
    square = jnp.sum((vectors @ rule.through(fine.nodes).T) ** 2, axis=0)
    return jnp.sqrt(highest(fine, width, square))
