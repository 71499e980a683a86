r"""Designing with a scatter: robust objectives, and how wide tolerances may be.

A robust objective is what a machine is worth with production tolerances, not at its nominal values. Its
scatter is the same few machines at every design (sample average approximation), so that it is a smooth
function of the design and the optimisers serve as they are.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import brentq
from scipy.stats import beta

from ..._core.errors import BadInput
from ..._core.extremes import maximum
from ...machine import HasMachine, Machine, machine_of
from .. import DesignResult, variable
from .._problem import RequestedQuantity, name_of, value_of
from .._variables import by_name, changed, current_values
from ._answer import Permitted
from ._moments import solved_rows
from ._scatter import Correlations, Within, drawn_normals, scatter_of
from ._tolerance import Tolerances

# Factors on the tolerances between which is searched.
_LOW = 1e-3
_HIGH = 10.0


class Robust:
    """A quantity of a design that counts its scatter; see `robust`.

    Each row of `normals` is a machine; `measure` goes from the quantities [SI] of all machines to what
    they are worth together.

    Attributes:
        changes: names of the variables that it scatters.
    """

    def __init__(self, quantity, variables, scatter, normals, measure, name):
        self._quantity = quantity
        self._variables = variables
        self._scatter = scatter
        self._normals = normals
        self._measure = measure
        self.__name__ = name
        self.changes = tuple(variable.name for variable in variables)

    def __call__(self, result: DesignResult) -> Float[Array, ""]:
        """[SI] NaN if a machine of the scatter cannot be solved."""
        return self._measure(self.sample(result))

    def sample(self, result: DesignResult) -> Float[Array, " samples"]:
        """[SI] The quantity of every machine of the scatter."""
        nominal = current_values(result.design, self._variables)

        def quantity(normals):
            design = changed(result.design, self._variables, self._scatter.at(nominal, normals))
            machine = DesignResult(design, result.options)
            value = value_of(self._quantity, machine)
            return jnp.where(machine.ok, value, jnp.nan)

        return jax.vmap(quantity)(jnp.asarray(self._normals))


def robust(
    scene: Machine | HasMachine,
    asked: RequestedQuantity,
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
    if quantile is None:
        measure = _mean_and_deviation(sigmas)
        words = f"mean {sigmas:+g} sigma"
    else:
        measure = _harrell_davis(quantile, samples)
        words = f"{quantile:g} quantile"
    return Robust(asked, variables, scatter, normals, measure, f"{name_of(asked)}, {words}")


def _mean_and_deviation(sigmas):
    def measure(values):
        # the variance of a machine without scatter is zero, where a root has no slope
        spread = jnp.sqrt(maximum(jnp.var(values), jnp.finfo(values.dtype).tiny))
        return jnp.mean(values) + sigmas * spread

    return measure


def _harrell_davis(share: float, count: int):
    edges = np.linspace(0, 1, count + 1)
    weights = np.diff(beta.cdf(edges, (count + 1) * share, (count + 1) * (1 - share)))
    return lambda values: jnp.sort(values) @ jnp.asarray(weights)


def permitted(
    found: Tolerances, rejects: float, variables: Sequence[str] | None = None
) -> Permitted:
    """The common factor on some tolerances with which a share of the machines breaks a limit.

    The machines of the study are drawn again with scaled deviations. The factor is found with
    value, slope and curvature at the mean machine, corrected for what they miss at the tolerances as
    they stand, and the machines are then solved at that factor.

    Args:
        found: a study with limits.
        rejects: [-] the share that may break any limit.
        variables: whose tolerances change; all if absent.

    Raises:
        BadInput: no limit, a share outside 0 to 1, or an unknown variable.
    """
    if not found.reliability:
        raise BadInput("limits", "none", "at least one, to reject machines by")
    if not 0 < rejects < 1:
        raise BadInput("rejects", rejects, "> 0 and < 1")
    names = tuple(found.variables if variables is None else variables)
    for name in names:
        if name not in found.variables:
            raise BadInput("variables", name, f"one of {', '.join(found.variables)}")
    mean = np.asarray(found.scatter.mean(found.nominal))
    away = np.asarray(found.scatter.at(found.nominal, found.sampled.normals)) - mean
    changes = np.array([name in names for name in found.variables])
    scaled = changes * away
    fixed = ~changes * away
    value, slope, curvature, _ = found.local

    def series(deviation):
        values = np.asarray(value) + deviation @ np.asarray(slope).T
        if curvature is not None:
            values = values + np.einsum("si,qij,sj->sq", deviation, curvature, deviation) / 2
        return values

    missed = found.sampled.values - series(away)

    good = found.sampled.ok
    before = _share_of_rejects(found, found.sampled.values[good])

    def excess(factor):
        # What the series misses shrinks at least as the square of the deviations, so that linearly is
        # prudent; wider tolerances keep it as it is, and the machines solved at the end tell the rest.
        values = series(factor * scaled + fixed) + min(factor, 1.0) * missed
        return _share_of_rejects(found, values[good]) - rejects

    # With tolerances a thousandth as wide the mean machine alone decides.
    if excess(_LOW) > 0:
        return Permitted(variables=names, factor=float("nan"), rejects=before, before=before)
    factor = _HIGH
    if excess(_HIGH) > 0:
        factor = float(brentq(excess, _LOW, _HIGH, xtol=1e-4))
    values, ok = solved_rows(found.problem, mean + factor * scaled + fixed)
    return Permitted(
        variables=names, factor=factor, rejects=_share_of_rejects(found, values[ok]), before=before
    )


def _share_of_rejects(study: Tolerances, values) -> float:
    """[-] Share of machines, of which these are the quantities [SI] (machines, quantities)."""
    broken = np.zeros(len(values), bool)
    for risk in study.reliability:
        column = values[:, study.names.index(risk.limit.quantity)]
        broken |= risk.limit.broken(column)
    return float(np.mean(broken))
