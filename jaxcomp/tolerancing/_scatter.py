r"""The joint scatter of several numbers: their tolerances and how they go together.

Deviations are functions of independent standard normal variables u, so that every method works in one
space: z = L u has the correlations of the model of Nataf (Liu and Der Kiureghian 1986, Probabilistic
Engineering Mechanics 1, 105-112), and each deviation is that of its own distribution at z_i.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import brentq

from .._fields import BadInput
from ._within import Within

Correlations = Mapping[tuple[str, str], float]
# Points of Gauss and Hermite for the correlation of two deviations; 1e-12 for all distributions.
_POINTS = 64
_NEAR_ONE = 1 - 1e-9


class Scatter(NamedTuple):
    """Tolerances of several variables.

    Attributes:
        tolerances: by name of the variable, see `Variable`.
        correlation: [-] (n, n) of the deviations.
        root: [-] (n, n) L, lower triangular.
    """

    tolerances: dict[str, Within]
    correlation: Float[np.ndarray, "n n"]
    root: Float[np.ndarray, "n n"]

    def at(
        self, nominal: Float[Array, " n"], normals: Float[Array, "*batch n"]
    ) -> Float[Array, "*batch n"]:
        """[SI] Values of the variables.

        Args:
            nominal: [SI] nominal values.
            normals: [-] u.
        """
        z = normals @ self.root.T
        columns = [one.at(z[..., i]) for i, one in enumerate(self.tolerances.values())]
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
        sigma = self._of("deviation") * self._scale(nominal)
        return jnp.asarray(self.correlation) * jnp.outer(sigma, sigma)

    def _of(self, name: str) -> Float[Array, " n"]:
        return jnp.array([getattr(one, name) for one in self.tolerances.values()])

    def _scale(self, nominal) -> Float[Array, " n"]:
        nominal = jnp.asarray(nominal)
        relative = jnp.array([one.relative for one in self.tolerances.values()])
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
        raise BadInput("tolerances", "none", "at least one")
    names = list(tolerances)
    wanted, normal = np.eye(len(names)), np.eye(len(names))
    for pair, value in (correlations or {}).items():
        label = f"correlations.{' and '.join(pair)}"
        if len(set(pair)) != 2 or not set(pair) <= set(names):
            raise BadInput(label, " and ".join(pair), f"two of {', '.join(names)}")
        if not -1 < value < 1:
            raise BadInput(label, value, "> -1 and < 1")
        i, j = (names.index(name) for name in pair)
        wanted[i, j] = wanted[j, i] = value
        normal[i, j] = normal[j, i] = _normal_correlation(
            tolerances[pair[0]], tolerances[pair[1]], value, label
        )
    try:
        root = np.linalg.cholesky(normal)
    except np.linalg.LinAlgError:
        smallest = f"{np.linalg.eigvalsh(normal)[0]:.3g}"
        bound = "such that the matrix of all of them has positive eigenvalues"
        raise BadInput("correlations", f"of smallest eigenvalue {smallest}", bound) from None
    return Scatter(dict(tolerances), wanted, root)


def check_nominal(scatter: Scatter, nominal: Float[np.ndarray, " n"]) -> None:
    """Refuse shares of nothing.

    Raises:
        BadInput: a relative tolerance of a number that is zero.
    """
    for (name, one), value in zip(scatter.tolerances.items(), nominal, strict=True):
        if one.relative and value == 0:
            raise BadInput(name, 0.0, "different from zero for a relative tolerance")


def _normal_correlation(a: Within, b: Within, wanted: float, label: str) -> float:
    """Correlation of two normal variables whose deviations have the wanted one."""
    if a.distribution == b.distribution == "normal":
        return wanted
    x, w = np.polynomial.hermite_e.hermegauss(_POINTS)
    w = w / w.sum()

    def standard(one: Within, z):
        return (np.asarray(one.at(z)) - one.middle) / one.deviation

    def miss(rho):
        first = standard(a, x)[:, None]
        second = standard(b, rho * x[:, None] + np.sqrt(1 - rho**2) * x[None, :])
        return w @ (first * second) @ w - wanted

    low, high = miss(-_NEAR_ONE) + wanted, miss(_NEAR_ONE) + wanted
    if not low < wanted < high:
        raise BadInput(label, wanted, f"> {low:.4g} and < {high:.4g} for these distributions")
    return float(brentq(miss, -_NEAR_ONE, _NEAR_ONE, xtol=1e-14))  # pyright: ignore
