"""What prescribed indicator diagrams share: a pressure behind the piston, curves through points."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import replaced
from .._core.polynomials import cubics, inner_slopes
from ._gas_law import AbstractGas


class AbstractDiagram(AbstractGas):
    """A pressure that is given, with the pressure behind the piston beside it."""

    back_pressure: eqx.AbstractVar[Float[Array, ""]]

    @property
    def behind_piston(self):
        return self.back_pressure


def curve(x, knots, values):
    """Cubics through the points with the slope of the parabola through three neighbours."""
    secant, inner = inner_slopes(knots, values)
    # At an end, the slope there of the parabola through the last three points.
    at_start = 2 * secant[:1] - inner[:1]
    at_end = 2 * secant[-1:] - inner[-1:]
    return cubics(x, knots, values, jnp.concatenate([at_start, inner, at_end]))


def with_knots(part, name: str, even):
    """A table with even knots where its own break its rules, so that its curve is finite."""
    good = jnp.all(jnp.asarray(list(part.conditions().values())))
    return replaced(part, **{name: jnp.where(good, getattr(part, name), even)})


def check_same_length(part, first: str, second: str) -> None:
    lengths = getattr(part, first).shape, getattr(part, second).shape
    if lengths[0] != lengths[1]:
        raise ValueError(
            f"`{first}` and `{second}` must have the same length, but have {lengths[0]} and "
            f"{lengths[1]}."
        )
