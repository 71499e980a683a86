r"""Robust objectives: what a machine is worth with production tolerances, not at its nominal values.

The scatter is the same few machines at every design (sample average approximation), so that the
objective is a smooth function of the design and the optimisers serve as they are.
"""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import beta

from .._fields import BadInput
from ..design import DesignResult, by_name, variable
from ..design._problem import Asked, name_of, value_of
from ..machine import machine_of
from ._monte_carlo import drawn_normals
from ._scatter import Correlations, scatter_of
from ._within import Within


class Robust:
    """A quantity of a design that counts its scatter; see `robust`.

    Args:
        asked: the quantity.
        variables: that scatter.
        scatter: of these.
        normals: (samples, variables) standard normal values, one machine a row.
        weights: of the sorted values, for a quantile; `None` for the mean and its deviation.
        sigmas: standard deviations to be added; only without weights.
        name: of the objective.

    Attributes:
        changes: names of the variables that it scatters.
    """

    def __init__(self, asked, variables, scatter, normals, weights, sigmas, name):
        self._asked, self._variables, self._scatter = asked, variables, scatter
        self._normals, self._weights, self._sigmas = normals, weights, sigmas
        self.__name__ = name
        self.changes = tuple(one.name for one in variables)

    def __call__(self, found: DesignResult) -> Float[Array, ""]:
        """[SI] NaN if a machine of the scatter cannot be solved."""
        values = self.sample(found)
        if self._weights is None:
            # the variance of a machine without scatter is zero, where a root has no slope
            spread = jnp.sqrt(jnp.maximum(jnp.var(values), jnp.finfo(values.dtype).tiny))
            return jnp.mean(values) + self._sigmas * spread
        return jnp.sort(values) @ jnp.asarray(self._weights)

    def sample(self, found: DesignResult) -> Float[Array, " samples"]:
        """[SI] The quantity of every machine of the scatter."""
        nominal = jnp.stack([jnp.asarray(v.current(found.design), float) for v in self._variables])

        def one(normals):
            design = found.design
            for number, value in enumerate(self._scatter.at(nominal, normals)):
                design = self._variables[number].apply(design, value)
            machine = DesignResult(design, found.options)
            value = value_of(self._asked, machine)
            return jnp.where(machine.ok, value, jnp.nan)

        return jax.vmap(one)(jnp.asarray(self._normals))


def robust(
    scene: Any,
    asked: Asked,
    tolerances: Mapping[str, Within],
    *,
    sigmas: float | None = None,
    quantile: float | None = None,
    correlations: Correlations | None = None,
    samples: int = 64,
    seed: int = 0,
) -> Robust:
    """An objective for `optimise`, `pareto` or `problem` that counts the scatter about each design.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        asked: the quantity.
        tolerances: of the scattered variables, which may be design variables too: the scatter goes
            with the nominal value, and relative tolerances grow with it.
        sigmas: [-] the objective is the mean plus so many standard deviations; negative for
            quantities that should be large.
        quantile: [-] or it is the value below which this share of the machines lies (Harrell and
            Davis 1982, Biometrika 69, 635-640: all machines count, so that it has a slope).
        correlations: [-] see `tolerance`.
        samples: machines about each design, of a scrambled Sobol sequence.
        seed: of these.

    Raises:
        BadInput: neither or both of sigmas and quantile, a quantile that so few machines cannot
            show, or what `tolerance` refuses.
    """
    if (sigmas is None) == (quantile is None):
        raise BadInput("sigmas", str(sigmas), "given, or else `quantile`, and not both")
    if samples < 8:
        raise BadInput("samples", samples, ">= 8")
    tail = 1 / (samples + 1)
    if quantile is not None and not tail <= quantile <= 1 - tail:
        raise BadInput("quantile", quantile, f">= {tail:.3g} and <= {1 - tail:.3g} for {samples}")
    design = machine_of(scene)
    tolerances = by_name(design, tolerances)
    scatter = scatter_of(tolerances, correlations)
    variables = tuple(variable(design, name) for name in tolerances)
    normals = drawn_normals(list(tolerances), samples, "sobol", seed)
    measure = f"mean {sigmas:+g} sigma" if quantile is None else f"{quantile:g} quantile"
    weights = None if quantile is None else _harrell_davis(quantile, samples)
    name = f"{name_of(asked)}, {measure}"
    return Robust(asked, variables, scatter, normals, weights, sigmas, name)


def _harrell_davis(share: float, count: int) -> Float[np.ndarray, " count"]:
    edges = np.linspace(0, 1, count + 1)
    return np.diff(beta.cdf(edges, (count + 1) * share, (count + 1) * (1 - share)))
