"""The ranges of the variables, and designs spread evenly over them."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._fields import BadInput
from ._design import Variable


class Ranges(NamedTuple):
    """The ranges of the variables.

    Attributes:
        low, high: (variables,) in the SI units of the variables.
    """

    low: Float[np.ndarray, " variables"]
    high: Float[np.ndarray, " variables"]

    @property
    def width(self) -> Float[np.ndarray, " variables"]:
        """Of each range."""
        return self.high - self.low

    def values(
        self, shares: Float[np.ndarray, "*n variables"]
    ) -> Float[np.ndarray, "*n variables"]:
        """[SI] the variables at shares of their ranges."""
        return self.low + self.width * shares

    def shares(
        self, values: Float[np.ndarray, "*n variables"]
    ) -> Float[np.ndarray, "*n variables"]:
        """[-] variables as shares of their ranges."""
        return np.clip((values - self.low) / self.width, 0.0, 1.0)

    def contain(self, values: Float[np.ndarray, "n variables"]) -> np.ndarray:
        """(n,) whether designs lie inside."""
        return np.all((values >= self.low) & (values <= self.high), axis=1)


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
    return Ranges(np.array([v.low for v in variables]), np.array([v.high for v in variables]))


def even_sample(ranges: Ranges, count: int, seed: int) -> Float[np.ndarray, "count variables"]:
    """[SI] Designs of a scrambled Sobol sequence, of which the first few are spread evenly as well."""
    from scipy.stats import qmc  # a second, for those who draw

    engine = qmc.Sobol(len(ranges.low), rng=seed)
    return ranges.values(engine.random_base2(math.ceil(math.log2(count)))[:count])
