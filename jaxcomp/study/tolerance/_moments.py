r"""Mean and deviation of quantities: from derivatives at the mean design, and by Monte Carlo.

With d = x - mean(x), covariance S and y ~ y_0 + g d + d' H d / 2 (Hahn and Shapiro 1967, Statistical
Models in Engineering, ch. 7):

    mean = y_0 + tr(H S)/2,    variance = g' S g + tr(H S H S)/2 + sum_i k_i (H_ii s_i^2)^2 / 4

with s_i the deviation and k_i the excess kurtosis of variable i. The first order stops at y_0 and g' S g.
Exact for a quadratic function of symmetric independent variables, or of correlated normal ones.

Every sample of the Monte Carlo is a machine that is solved in full. The samples come in several
independent sets, each scrambled by itself if it is a sequence of Sobol; how much the sets differ is the
error of what all of them together say, whatever the kind of sampling.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._core.errors import BadInput
from ..._core.progress import progress_of
from .._problem import Problem, solved, solves_gas
from .._variables import is_fraction
from ..sweep._design_blocks import default_width, solved_blocks
from ._scatter import Sampling, Scatter, drawn_normals

if TYPE_CHECKING:
    from distributed import Client

Curvature = Literal["differences", "exact"] | None
# Of a standard deviation: so wide that solvers' residuals do not count, and narrower than the scatter.
_STEP = 0.5
# Independent sets: enough for an error that is itself known to a quarter.
SETS = 8
# Designs of a block.
_BLOCK = 8192
# The same of machines whose gas is solved, some seconds of them.
_SLOW_BLOCK = 32
# Called with the rows so far [SI], their quantities [SI], and whether each could be solved.
Keep = Callable[[np.ndarray, np.ndarray, np.ndarray], None]
# Designs in step where each costs a product of small matrices: wide enough to be worth a call.
_WIDE = 1024


class Local(NamedTuple):
    """Quantities near one design.

    Attributes:
        value: [SI] (quantities,)
        slope: [SI] (quantities, variables)
        curvature: [SI] (quantities, variables, variables), or `None`.
        ok: whether all of it can be relied on.
    """

    value: Float[Array, " quantities"]
    slope: Float[Array, "quantities variables"]
    curvature: Float[Array, "quantities variables variables"] | None
    ok: bool


class Moments(NamedTuple):
    """Mean and standard deviation.

    Attributes:
        mean, deviation: [SI] (quantities,)
    """

    mean: Float[np.ndarray, " quantities"]
    deviation: Float[np.ndarray, " quantities"]


def local(problem: Problem, point, deviation, curvature: Curvature) -> Local:
    """Values, slopes and curvature at a design.

    Args:
        problem: what is asked.
        point: [SI] (variables,)
        deviation: [SI] (variables,) of the scatter, the scale of differences.
        curvature: "differences" of slopes half a deviation to both sides, "exact" by products of
            the Hessian with unit vectors (which compiles five times as long), or `None`.
    """
    fractions = any(is_fraction(problem.design, name) for name in problem.variable_names)
    if curvature == "exact" and fractions:
        bound = '"differences" with a composition, whose dew and bubble lines are of first order'
        raise BadInput("curvature", '"exact"', bound)
    if curvature != "differences":
        solutions = solved(problem, jnp.asarray(point)[None])
        bent = None
        ok = solutions.ok[0]
        if curvature is not None:
            bent, finite = _exact(problem, jnp.asarray(point))
            ok &= finite
        return Local(
            value=solutions.values[0], slope=solutions.slope[0], curvature=bent, ok=bool(ok)
        )
    # One program for all: the design, then each variable half a deviation to either side.
    step = _STEP * jnp.diag(deviation)
    solutions = solved(problem, jnp.concatenate([point[None], point + step, point - step]))
    ahead, behind = jnp.split(solutions.slope[1:], 2)
    bent = jnp.moveaxis((ahead - behind) / (2 * _STEP * deviation)[:, None, None], 0, 2)
    # Differences of slopes are symmetric but for their own error.
    bent = (bent + jnp.swapaxes(bent, 1, 2)) / 2
    return Local(
        value=solutions.values[0],
        slope=solutions.slope[0],
        curvature=bent,
        ok=bool(jnp.all(solutions.ok)),
    )


@eqx.filter_jit
def _exact(problem: Problem, point) -> tuple[Array, Bool[Array, ""]]:
    def values(x):
        answer = problem(x)
        return answer.values, answer.ok

    slope = jax.jacrev(values, has_aux=True)

    def product(direction):
        _, moved, ok = jax.jvp(slope, (point,), (direction,), has_aux=True)
        return moved, ok

    bent, ok = jax.lax.map(product, jnp.eye(point.size))
    bent = jnp.moveaxis(bent, 0, 2)
    return bent, jnp.all(ok) & jnp.all(jnp.isfinite(bent))


def moments(at: Local, covariance, excess) -> Moments:
    """Moments of second order, or of first where no curvature is known.

    Args:
        at: the mean design.
        covariance: [SI] (variables, variables) of the variables.
        excess: [-] (variables,) their excess kurtosis.
    """
    mean = at.value
    if at.curvature is not None:
        mean = mean + jnp.trace(at.curvature @ covariance, axis1=1, axis2=2) / 2
    variance = jnp.sum(_parts(at, covariance, excess), -1)
    return Moments(np.asarray(mean), np.sqrt(np.maximum(np.asarray(variance), 0)))


def shares(at: Local, covariance, excess) -> Float[np.ndarray, "quantities variables"]:
    """[-] Share of each variable in the variance; what two have in common is split evenly.

    They sum to one. A share is negative where a correlation makes a variable take scatter away.
    """
    parts = np.asarray(_parts(at, covariance, excess))
    total = parts.sum(-1, keepdims=True)
    return np.where(total > 0, parts / np.where(total > 0, total, 1.0), 0.0)


def _parts(at: Local, covariance, excess):
    """Variance by variable, up to the order that is known."""
    # g_i (S g)_i and (H S H S)_ii, whose sums over i are the variance: so each has its share.
    parts = at.slope * (at.slope @ covariance)
    if at.curvature is None:
        return parts
    bent = at.curvature @ covariance
    single = jnp.diagonal(at.curvature, axis1=1, axis2=2) * jnp.diagonal(covariance)
    coupled = jnp.diagonal(bent @ bent, axis1=1, axis2=2)
    return parts + coupled / 2 + excess * single**2 / 4


class Sampled(NamedTuple):
    """Machines of a scatter.

    Attributes:
        normals: [-] (samples, variables) u.
        values: [SI] (samples, quantities); NaN where a machine could not be solved.
        ok: (samples,)
        mean, deviation: [SI] (quantities,) of those that could be solved.
        skewness: [-] (quantities,)
        mean_error, deviation_error: [SI] (quantities,) standard errors, from the sets.
    """

    normals: Float[np.ndarray, "samples variables"]
    values: Float[np.ndarray, "samples quantities"]
    ok: Bool[np.ndarray, " samples"]
    mean: Float[np.ndarray, " quantities"]
    deviation: Float[np.ndarray, " quantities"]
    skewness: Float[np.ndarray, " quantities"]
    mean_error: Float[np.ndarray, " quantities"]
    deviation_error: Float[np.ndarray, " quantities"]

    def quantile(self, share) -> Float[np.ndarray, "*shares quantities"]:
        """[SI] Values that these shares of the machines do not exceed."""
        return np.quantile(self.values[self.ok], share, axis=0)


def sampled(
    problem: Problem,
    scatter: Scatter,
    nominal,
    samples: int,
    sampling: Sampling = "sobol",
    seed: int = 0,
    progress: bool = True,
    client: "Client | None" = None,
    keep: Keep | None = None,
) -> Sampled:
    """Draw machines and solve them.

    Raises:
        BadInput: fewer than two samples in a set.
    """
    if samples < 2 * SETS:
        raise BadInput("samples", samples, f">= {2 * SETS}")
    names = list(scatter.tolerances)
    drawn = []
    for number, places in enumerate(np.array_split(np.arange(samples), SETS)):
        # No set of one seed is scrambled as a set of another.
        drawn.append(drawn_normals(names, len(places), sampling, seed * SETS + number))
    normals = np.concatenate(drawn)
    title = "Drawing machines" if progress else None
    values, ok = solved_rows(problem, scatter.at(nominal, normals), title, client, keep)
    good = values[ok]
    if len(good) < 2:
        undefined = np.full(values.shape[1], np.nan)
        return Sampled(
            normals=normals,
            values=values,
            ok=ok,
            mean=undefined,
            deviation=undefined,
            skewness=undefined,
            mean_error=undefined,
            deviation_error=undefined,
        )
    mean = good.mean(0)
    deviation = good.std(0)
    flat = np.where(deviation > 0, deviation, 1.0)
    skewness = np.mean(((good - mean) / flat) ** 3, axis=0)
    of_sets = []
    for machines, fine in zip(np.array_split(values, SETS), np.array_split(ok, SETS), strict=True):
        if fine.any():
            of_sets.append((machines[fine].mean(0), machines[fine].std(0)))
    # The sets are independent: their scatter over the root of their number is the standard error.
    statistics = np.array(of_sets)
    errors = np.full_like(statistics[0], np.nan)
    if len(statistics) > 1:
        errors = statistics.std(axis=0, ddof=1) / np.sqrt(len(statistics))
    return Sampled(
        normals=normals,
        values=values,
        ok=ok,
        mean=mean,
        deviation=deviation,
        skewness=skewness,
        mean_error=errors[0],
        deviation_error=errors[1],
    )


def solved_rows(
    problem: Problem,
    rows,
    progress: str | None = None,
    client: "Client | None" = None,
    keep: Keep | None = None,
):
    """[SI] (rows, quantities) and whether they could be solved, in blocks as a sweep solves them."""
    rows = np.asarray(rows)
    devices = jax.local_devices()
    width = _WIDE
    if problem.options.known is None:
        width = default_width(problem, devices)
    size = _BLOCK
    if solves_gas(problem):
        size = _SLOW_BLOCK
    # the first one is small, so that a forecast of the rest comes early
    edges = sorted({0, *range(min(width, size), len(rows), size), len(rows)})
    blocks = ((first, rows[first:end]) for first, end in pairwise(edges))
    values = np.empty((len(rows), len(problem.quantities)))
    ok = np.empty(len(rows), bool)
    count = 0
    title = progress or ""
    show = progress is not None
    with progress_of(title, len(rows), unit="machines", show=show) as shown:
        for first, machines, quantities, _, solved in solved_blocks(
            problem, width, devices, client, blocks
        ):
            end = first + len(machines)
            values[first:end] = quantities
            ok[first:end] = solved
            count += len(machines)
            shown.at(count)
            if keep is not None:
                keep(rows[:count], values[:count], ok[:count])
    return values, ok
