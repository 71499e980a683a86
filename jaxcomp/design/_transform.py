r"""Bounded numbers as unbounded ones, and the even scatter of designs over their ranges.

A number keeps its range by $x = a + (b - a)\,(1 + \sin t)/2$, whatever a solver does with t. A sigmoid
puts the bounds at infinity, where a solver creeps; the sine reaches them at a finite t, where an
optimum on a bound becomes an ordinary one with a curvature (`tests/benchmarks/optimise.py --bounds`
counts the evaluations of both, beside a projected method).
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._fields import BadInput
from ._design import Variable

# The sine has no slope at the ends: a start on a bound could not leave it.
_MARGIN = 0.01


class Ranges(eqx.Module):
    """The ranges of the variables.

    Attributes:
        low, high: (variables,) in the SI units of the variables.
    """

    low: Float[Array, " variables"]
    high: Float[Array, " variables"]

    @property
    def width(self) -> Float[Array, " variables"]:
        """Of each range."""
        return self.high - self.low

    def inside(self, free: Float[Array, "*n variables"]) -> Float[Array, "*n variables"]:
        """[SI] the variables at unbounded numbers."""
        return self.low + self.width * (1 + jnp.sin(free)) / 2

    def free(self, values: Float[Array, "*n variables"]) -> Float[Array, "*n variables"]:
        """[rad] unbounded numbers at or, from an end of a range, near some values of the variables."""
        share = jnp.clip((values - self.low) / self.width, _MARGIN, 1 - _MARGIN)
        return jnp.arcsin(2 * share - 1)


def ranges_of(variables: tuple[Variable, ...]) -> Ranges:
    """The ranges of variables.

    Raises:
        BadInput: an end that is missing, or a range without width.
    """
    for one in variables:
        for end in (one.low, one.high):
            if not math.isfinite(end):
                raise BadInput(one.name, end, "given a range with two finite ends to be optimised")
        if not one.low < one.high:
            raise BadInput(one.name, one.high, f"given a range that rises from {one.low:g}")
    return Ranges(
        jnp.array([v.low for v in variables], float), jnp.array([v.high for v in variables], float)
    )


def scattered(ranges: Ranges, count: int, seed: int) -> Float[Array, "count variables"]:
    """Designs spread evenly over the ranges, of which the first few are spread evenly as well.

    The additive recurrence with the powers of the generalised golden ratio (Roberts 2018, "The
    unreasonable effectiveness of quasirandom sequences"), from an offset that the seed draws.
    """
    number = ranges.low.size
    ratio = 2.0
    for _ in range(64):  # the root of g^(n + 1) = g + 1; a contraction
        ratio = (1 + ratio) ** (1 / (number + 1))
    offset = np.random.default_rng(seed).uniform(size=number)
    share = (offset + np.outer(np.arange(count), ratio ** -np.arange(1.0, number + 1))) % 1
    return ranges.low + ranges.width * jnp.asarray(share)
