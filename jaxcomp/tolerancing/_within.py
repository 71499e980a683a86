r"""The deviation that production leaves on one number."""

import math
from typing import Literal, NamedTuple, get_args

import jax.numpy as jnp
from jax.scipy.special import erf, ndtr, ndtri
from jaxtyping import Array, Float

from .._fields import BadInput

Distribution = Literal["normal", "uniform", "truncated"]


class Within(NamedTuple):
    """A tolerance and how production fills it, symmetric about its middle.

    Attributes:
        low, high: [SI] limits of the deviation from the nominal value; shares of it if relative.
        distribution: "normal", with the limits at so many standard deviations of it; "truncated",
            the same cut off at the limits; "uniform" between them.
        sigmas: [-] standard deviations from the middle to a limit, before any cut.
        relative: whether the limits are shares of the nominal value.
    """

    low: float
    high: float
    distribution: Distribution = "normal"
    sigmas: float = 3.0
    relative: bool = False

    @property
    def middle(self) -> float:
        """[SI] Mean deviation; [-] if relative."""
        return (self.low + self.high) / 2

    @property
    def half(self) -> float:
        """[SI] From the middle to a limit; [-] if relative."""
        return (self.high - self.low) / 2

    @property
    def deviation(self) -> float:
        """[SI] Standard deviation; [-] if relative."""
        return self.half * math.sqrt(self._moments[0])

    @property
    def excess(self) -> float:
        """[-] Excess kurtosis: 0 for the normal distribution, -1.2 for the uniform one."""
        second, fourth = self._moments
        return fourth / second**2 - 3

    def at(self, normal: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[SI] The deviation that stands where a standard normal variable has this value [-]."""
        return self.middle + self.half * self._share(jnp.asarray(normal, float))

    @property
    def _moments(self) -> tuple[float, float]:
        """Second and fourth central moments, for limits at -1 and 1."""
        k = self.sigmas
        if self.distribution == "uniform":
            return 1 / 3, 1 / 5
        if self.distribution == "normal":
            return 1 / k**2, 3 / k**4
        cut = 2 * math.exp(-(k**2) / 2) / math.sqrt(2 * math.pi) / math.erf(k / math.sqrt(2))
        return (1 - k * cut) / k**2, (3 - (k**3 + 3 * k) * cut) / k**4

    def _share(self, z):
        if self.distribution == "normal":
            return z / self.sigmas
        if self.distribution == "uniform":
            return erf(z / math.sqrt(2))
        outside = math.erfc(self.sigmas / math.sqrt(2)) / 2

        def lower(z):
            return ndtri(outside + ndtr(z) * (1 - 2 * outside)) / self.sigmas

        # Each half from its own tail, where the share of all that lies beyond keeps its digits.
        half = lower(jnp.where(z > 0, -z, z))
        return jnp.where(z > 0, -half, half)


def within(
    tolerance: float | tuple[float, float],
    distribution: Distribution = "normal",
    *,
    sigmas: float = 3.0,
    relative: bool = False,
) -> Within:
    """A tolerance, +- one number or between two.

    Args:
        tolerance: [SI] limits of the deviation; shares of the nominal value if relative.
        distribution, relative: see `Within`.
        sigmas: [-] see `Within`.

    Raises:
        BadInput: limits that do not rise, an unknown distribution, or sigmas out of bounds.
    """
    low, high = tolerance if isinstance(tolerance, tuple) else (-tolerance, tolerance)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise BadInput("tolerance", f"{low:g} to {high:g}", "a finite range that rises")
    if distribution not in get_args(Distribution):
        raise BadInput("distribution", distribution, f"one of {', '.join(get_args(Distribution))}")
    if not 0.1 <= sigmas <= 8:  # below it a cut bell is uniform, above it nothing is cut
        raise BadInput("sigmas", sigmas, ">= 0.1 and <= 8")
    return Within(float(low), float(high), distribution, float(sigmas), relative)
