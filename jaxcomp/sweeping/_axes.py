r"""Values that a sweep gives a variable: a list of them, or a distribution to draw from."""

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float

from .._fields import BadInput

Values: TypeAlias = Float[np.ndarray, " n"]


class Distribution(NamedTuple):
    """A scattered variable.

    Attributes:
        kind: "uniform" or "log_uniform" between two ends, or "normal" about a mean.
        first, second: [SI] the ends, or mean and standard deviation.
    """

    kind: Literal["uniform", "log_uniform", "normal"]
    first: float
    second: float

    def at(self, share: Values) -> Values:
        """The values below which these shares (0 to 1, both left out) of all designs lie."""
        if self.kind == "normal":
            from scipy.special import ndtri

            return self.first + self.second * ndtri(share)
        if self.kind == "log_uniform":
            return self.first * (self.second / self.first) ** share
        return self.first + (self.second - self.first) * share

    @property
    def ends(self) -> tuple[float, float]:
        """[SI] What the variable must allow: the ends, of a normal distribution its mean."""
        return (self.first, self.first if self.kind == "normal" else self.second)


def grid(low: float, high: float, count: int) -> Values:
    """Evenly spaced values, both ends included.

    Args:
        low, high: [SI] the ends.
        count: how many.

    Raises:
        BadInput: a range that does not rise, or fewer than two values.
    """
    return np.linspace(*_rising("grid", low, high, count), count)


def log_grid(low: float, high: float, count: int) -> Values:
    """Values of a constant ratio, both ends included.

    Args:
        low, high: [SI] the ends, above zero.
        count: how many.

    Raises:
        BadInput: as `grid`, or an end that is not above zero.
    """
    return np.geomspace(*_rising("log_grid", low, high, count, positive=True), count)


def uniform(low: float, high: float) -> Distribution:
    """Every value between two ends is as likely.

    Args:
        low: [SI] the lower end.
        high: [SI] the upper end.

    Raises:
        BadInput: a range that does not rise.
    """
    return Distribution("uniform", *_rising("uniform", low, high))


def log_uniform(low: float, high: float) -> Distribution:
    """Every ratio between two ends is as likely.

    Args:
        low: [SI] the lower end.
        high: [SI] the upper end.

    Raises:
        BadInput: a range that does not rise or is not above zero.
    """
    return Distribution("log_uniform", *_rising("log_uniform", low, high, positive=True))


def normal(mean: float, deviation: float) -> Distribution:
    """Gauss's bell; designs beyond the variable's bound count as failed.

    Args:
        mean: [SI] of the variable.
        deviation: [SI] standard deviation.

    Raises:
        BadInput: a deviation that is not above zero.
    """
    if not 0 < deviation < np.inf:
        raise BadInput("deviation", deviation, "> 0")
    if not np.isfinite(mean):
        raise BadInput("mean", mean, "finite")
    return Distribution("normal", float(mean), float(deviation))


def as_values(name: str, given: Sequence[float] | Values) -> Values:
    """A list of values of a grid.

    Raises:
        BadInput: none, more than one dimension, a repeated value, or one that is not finite.
    """
    values = np.asarray(given, dtype=float)
    if values.ndim != 1 or values.size == 0:
        raise BadInput(name, values, "a list of at least one value")
    if not np.all(np.isfinite(values)):
        raise BadInput(name, values, "finite")
    if np.unique(values).size != values.size:
        raise BadInput(name, values, "a list without repeated values")
    return values


def _rising(name, low, high, count=2, positive=False) -> tuple[float, float]:
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise BadInput(name, f"{low:g} to {high:g}", "a finite range that rises")
    if positive and not low > 0:
        raise BadInput(name, low, "> 0")
    if count < 2:
        raise BadInput(f"{name}.count", count, ">= 2")
    return float(low), float(high)
