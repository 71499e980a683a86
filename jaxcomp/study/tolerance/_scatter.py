r"""The scatter of production: the tolerance of each number, and how deviations go together.

Deviations are functions of independent standard normal variables u, so that every method works in one
space: z = L u has the correlations of the model of Nataf (Liu and Der Kiureghian 1986, Probabilistic
Engineering Mechanics 1, 105-112), and each deviation is that of its own distribution at z_i.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf, ndtr, ndtri
from jaxtyping import Array, Float
from scipy.optimize import brentq

from ..._core.declared import BESIDE, Record, reading, word
from ..._core.errors import BadInput
from ..sweep import normal
from ..sweep._points import SamplePoints

Distribution = Literal["normal", "uniform", "truncated"]
Sampling = Literal["sobol", "latin_hypercube", "random"]
Correlations = Mapping[tuple[str, str], float]
# Points of Gauss and Hermite for the correlation of two deviations; 1e-12 for all distributions.
_POINTS = 64
_NEAR_ONE = 1 - 1e-9


@dataclass(frozen=True)
class Within(Record):
    """A tolerance and how production fills it, symmetric about its middle.

    Attributes:
        low, high: [SI] limits of the deviation from the nominal value; shares of it if relative.
        distribution: "normal", with the limits at so many standard deviations of it; "truncated",
            the same cut off at the limits; "uniform" between them.
        sigmas: [-] standard deviations from the middle to a limit, before any cut.
        relative: whether the limits are shares of the nominal value.
    """

    low: float = reading(BESIDE)
    high: float = reading(BESIDE)
    distribution: Distribution = word(default="normal")
    sigmas: float = reading("", default=3.0)
    relative: bool = word(default=False)

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
    if isinstance(tolerance, tuple):
        low, high = tolerance
    else:
        low = -tolerance
        high = tolerance
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise BadInput("tolerance", f"{low:g} to {high:g}", "a finite range that rises")
    if distribution not in get_args(Distribution):
        raise BadInput("distribution", distribution, f"one of {', '.join(get_args(Distribution))}")
    if not 0.1 <= sigmas <= 8:  # below it a cut bell is uniform, above it nothing is cut
        raise BadInput("sigmas", sigmas, ">= 0.1 and <= 8")
    return Within(
        low=float(low),
        high=float(high),
        distribution=distribution,
        sigmas=float(sigmas),
        relative=relative,
    )


class Scatter(NamedTuple):
    """Tolerances of several variables.

    Attributes:
        tolerances: by name of the variable, see `Variable`.
        correlation: [-] (n, n) of the deviations.
        root: [-] (n, n) L, lower triangular.
        given: [-] the correlations by pairs of names, as they were given.
    """

    tolerances: dict[str, Within]
    correlation: Float[np.ndarray, "n n"]
    root: Float[np.ndarray, "n n"]
    given: tuple[tuple[tuple[str, ...], float], ...] = ()

    def at(
        self, nominal: Float[Array, " n"], normals: Float[Array, "*batch n"]
    ) -> Float[Array, "*batch n"]:
        """[SI] Values of the variables with these nominal values [SI], at u [-]."""
        z = normals @ self.root.T
        columns = []
        for number, band in enumerate(self.tolerances.values()):
            columns.append(band.at(z[..., number]))
        return nominal + jnp.stack(columns, -1) * self._scale(nominal)

    def mean(self, nominal: Float[Array, " n"]) -> Float[Array, " n"]:
        """[SI] Mean values; the nominal ones, unless a tolerance lies on one side."""
        return nominal + self._of("middle") * self._scale(nominal)

    def deviation(self, nominal: Float[Array, " n"]) -> Float[Array, " n"]:
        """[SI] Standard deviations."""
        return self._of("deviation") * jnp.abs(self._scale(nominal))

    def limits(self, nominal: Float[Array, " n"]) -> Float[Array, "2 n"]:
        """[SI] Values at the low and the high limit of every tolerance."""
        ends = jnp.stack([self._of("low"), self._of("high")])
        return nominal + ends * self._scale(nominal)

    def covariance(self, nominal: Float[Array, " n"]) -> Float[Array, "n n"]:
        """[SI] of the values."""
        # With its sign: a relative deviation of a negative value turns the correlation round.
        sigma = self._of("deviation") * self._scale(nominal)
        return jnp.asarray(self.correlation) * jnp.outer(sigma, sigma)

    def _of(self, name: str) -> Float[Array, " n"]:
        return jnp.array([getattr(band, name) for band in self.tolerances.values()])

    def _scale(self, nominal) -> Float[Array, " n"]:
        nominal = jnp.asarray(nominal)
        relative = jnp.array([band.relative for band in self.tolerances.values()])
        return jnp.where(relative, nominal, jnp.ones_like(nominal))  # pyright: ignore


def scatter_of(
    tolerances: Mapping[str, Within], correlations: Correlations | None = None
) -> Scatter:
    """Tolerances that belong together.

    Args:
        tolerances: by name of the variable.
        correlations: [-] of the deviations of two variables; 0 where absent.

    Raises:
        BadInput: no tolerance, an unknown name, or correlations that no deviations can have.
    """
    if not tolerances:
        raise BadInput(
            "tolerances", "none", 'at least one, such as {"bore_at_displacement": within(2e-5)}'
        )
    _check_kinds(tolerances)
    names = list(tolerances)
    correlation = np.eye(len(names))
    # Correlations of the normal variables behind the deviations, which are not those of the deviations.
    latent = np.eye(len(names))
    for pair, value in (correlations or {}).items():
        label = f"correlations.{' and '.join(pair)}"
        if len(set(pair)) != 2 or not set(pair) <= set(names):
            raise BadInput(label, " and ".join(pair), f"two of {', '.join(names)}")
        if not -1 < value < 1:
            raise BadInput(label, value, "> -1 and < 1")
        i, j = map(names.index, pair)
        first, second = map(tolerances.__getitem__, pair)
        correlation[i, j] = correlation[j, i] = value
        latent[i, j] = latent[j, i] = _normal_correlation(first, second, value, label)
    try:
        root = np.linalg.cholesky(latent)
    except np.linalg.LinAlgError:
        smallest = f"{np.linalg.eigvalsh(latent)[0]:.3g}"
        bound = "such that the matrix of all of them has positive eigenvalues"
        raise BadInput("correlations", f"of smallest eigenvalue {smallest}", bound) from None
    return Scatter(
        tolerances=dict(tolerances),
        correlation=correlation,
        root=root,
        given=tuple((correlations or {}).items()),
    )


def _check_kinds(tolerances: Any) -> None:
    """That every tolerance is one, and not a bare number."""
    example = "tolerances by name, such as {'mechanism.bore': within(2e-5)}, which is +-0.02 mm"
    if not isinstance(tolerances, Mapping):
        raise BadInput("tolerances", f"a {type(tolerances).__name__}", example)
    for name, band in tolerances.items():
        if not isinstance(band, Within):
            raise BadInput(f"tolerances.{name}", f"{band}", f"made with `within`: {example}")


def _normal_correlation(a: Within, b: Within, correlation: float, label: str) -> float:
    """Correlation of two normal variables whose deviations have the wanted one."""
    if a.distribution == b.distribution == "normal":
        return correlation
    x, w = np.polynomial.hermite_e.hermegauss(_POINTS)
    # Of probability; those of NumPy add up to sqrt(2 pi).
    w = w / w.sum()

    def standard(band: Within, z):
        return (np.asarray(band.at(z)) - band.middle) / band.deviation

    def miss(rho):
        first = standard(a, x)[:, None]
        second = standard(b, rho * x[:, None] + np.sqrt(1 - rho**2) * x[None, :])
        return w @ (first * second) @ w - correlation

    # Two different distributions cannot be correlated up to one.
    low = miss(-_NEAR_ONE) + correlation
    high = miss(_NEAR_ONE) + correlation
    if not low < correlation < high:
        raise BadInput(label, correlation, f"> {low:.4g} and < {high:.4g} for these distributions")
    return float(brentq(miss, -_NEAR_ONE, _NEAR_ONE, xtol=1e-14))  # pyright: ignore


def drawn_normals(
    names: list[str], count: int, sampling: Sampling, seed: int
) -> Float[np.ndarray, "count names"]:
    """[-] Independent standard normal variables, a column each."""
    points = SamplePoints(dict.fromkeys(names, normal(0.0, 1.0)), count, sampling, seed)
    return points.rows((slice(0, count),))
