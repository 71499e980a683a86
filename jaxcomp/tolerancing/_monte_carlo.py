r"""Monte Carlo: every sample is a machine that is solved in full.

The samples come in several independent sets, each scrambled by itself if it is a sequence of Sobol; how
much the sets differ is the error of what all of them together say, whatever the kind of sampling.
"""

from typing import TYPE_CHECKING, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from .._fields import BadInput
from .._waits import progress_of
from ..design import Problem
from ..sweeping import normal
from ..sweeping._blocks import solved_blocks
from ..sweeping._points import SamplePoints
from ..sweeping._program import default_width
from ._scatter import Scatter

if TYPE_CHECKING:
    from distributed import Client

Sampling = Literal["sobol", "latin_hypercube", "random"]
# Independent sets: enough for an error that is itself known to a quarter.
SETS = 8
# Designs of a block.
_BLOCK = 8192
# Designs in step where each costs a product of small matrices: wide enough to be worth a call.
_WIDE = 1024


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
) -> Sampled:
    """Draw machines and solve them.

    Raises:
        BadInput: fewer than two samples in a set.
    """
    if samples < 2 * SETS:
        raise BadInput("samples", samples, f">= {2 * SETS}")
    names = list(scatter.tolerances)
    sizes = [samples // SETS + (i < samples % SETS) for i in range(SETS)]
    normals = np.concatenate(
        [
            drawn_normals(names, size, sampling, seed * SETS + number)
            for number, size in enumerate(sizes)
        ]
    )
    values, ok = solved_normals(problem, scatter, nominal, normals, progress, client)
    groups = np.repeat(np.arange(SETS), sizes)
    return _summary(normals, values, ok, groups)


def drawn_normals(
    names: list[str], count: int, sampling: Sampling, seed: int
) -> Float[np.ndarray, "count names"]:
    """[-] Independent standard normal variables, a column each."""
    points = SamplePoints({name: normal(0.0, 1.0) for name in names}, count, sampling, seed)
    return points.rows((slice(0, count),))


def solved_normals(
    problem: Problem, scatter: Scatter, nominal, normals, progress=True, client=None
):
    """[SI] (samples, quantities) of machines u, and whether they could be solved."""

    def values_of(u):
        return np.asarray(scatter.at(nominal, u))

    return solved_rows(problem, normals, values_of, progress, client)


def solved_rows(problem: Problem, rows, values_of=lambda rows: rows, progress=False, client=None):
    """[SI] (rows, quantities) and whether they could be solved, in blocks as a sweep solves them.

    Args:
        problem: what is asked.
        rows: (rows, variables)
        values_of: from a block of rows to values of the variables [SI].
        progress: show a bar.
        client: of a Dask cluster that solves them; this process if absent.
    """
    devices = jax.local_devices()
    width = default_width(devices) if problem.options.known is None else _WIDE
    starts = range(0, len(rows), _BLOCK)
    blocks = ((first, values_of(rows[first : first + _BLOCK])) for first in starts)
    done = {}
    with progress_of("Drawing machines", len(rows), unit="machines", show=progress) as shown:
        for first, _, values, ok in solved_blocks(problem, width, devices, client, blocks):
            done[first] = values, ok
            shown.at(sum(len(values) for values, _ in done.values()))
    values, ok = (np.concatenate(p) for p in zip(*(done[first] for first in starts), strict=True))
    return values, ok


def _summary(normals, values, ok, groups) -> Sampled:
    good = values[ok]
    if len(good) < 2:
        nothing = np.full(values.shape[1], np.nan)
        return Sampled(normals, values, ok, *([nothing] * 5))
    mean, deviation = good.mean(0), good.std(0)
    flat = np.where(deviation > 0, deviation, 1.0)
    skewness = np.mean(((good - mean) / flat) ** 3, axis=0)
    sets = [values[ok & (groups == i)] for i in range(SETS)]
    sets = [one for one in sets if len(one)]
    errors = [
        np.std([f(one) for one in sets], axis=0, ddof=1) / np.sqrt(len(sets))
        if len(sets) > 1
        else np.full(values.shape[1], np.nan)
        for f in (lambda v: v.mean(0), lambda v: v.std(0))
    ]
    return Sampled(normals, values, ok, mean, deviation, skewness, *errors)
