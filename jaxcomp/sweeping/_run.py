r"""`sweep`: the quantities of many designs."""

import platform
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import jax
import numpy as np
from jaxtyping import Float

from .._fields import BadInput
from .._waits import progress_of
from ..design import AnalysisOptions, Problem, by_name, prepared, problem, quantity
from ..design._problem import Asked, name_of
from ..machine import machine_of
from ._axes import Distribution, as_values
from ._blocks import solved_blocks
from ._fingerprint import fingerprint
from ._plan import Column, Plan
from ._points import GridPoints, Layout, SamplePoints
from ._program import Device, chosen_devices, default_width
from ._store import OK, InMemory, OnDisk, stored_header

if TYPE_CHECKING:
    import xarray
    from distributed import Client

# Large enough that writing a block takes a small share of working it out, small enough that a
# killed run loses a fraction of a second.
BATCH = 8192

Over: TypeAlias = Mapping[str, Distribution | Sequence[float] | Float[np.ndarray, " n"]]


def sweep(
    scene: Any,
    over: Over,
    quantities: Sequence[Asked] | None = None,
    *,
    samples: int | None = None,
    sampling: Literal["sobol", "latin_hypercube", "random"] = "sobol",
    seed: int = 0,
    options: AnalysisOptions | None = None,
    out: str | Path | None = None,
    batch: int | None = None,
    width: int | None = None,
    devices: int | Sequence[Device] | None = None,
    client: "Client | None" = None,
    progress: bool = True,
) -> "xarray.Dataset":
    """The quantities of all designs of a grid, or of samples.

    The designs are computed in blocks of one shape, each shared by all devices of this process
    and written as soon as it is done, so that memory does not grow with their number. Results are
    the same to the last bit whatever the number of devices and processes, and however often the
    sweep was stopped: run it again with the same `out` and it goes on.

    Options of a solver that are no numbers of a design (nodes, kinks, the kind of a law) are compiled
    into the program: every combination keeps some 13 MB in the process, which `jax.clear_caches()`
    does not give back. Sweep over such options in processes that end:
    `multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1).map(function, options,
    chunksize=1)` gives every option a process of its own, for a function of a module that sweeps.

    With `client` the blocks are solved by the workers of a Dask cluster and written by this process, so
    that the workers need not see the folder `out`. Blocks of workers that are lost go to others, and
    workers may come and go; where the scheduler is lost, the same call goes on. Results are the same to
    the last bit as long as the workers have processors of the kind that this process has.

    Args:
        scene: of `jaxcomp.load`, a `Machine`, or a `Problem`, which has its own quantities and options.
        over: values [SI] of each variable by name or pattern (see `Variable`, `matching`), for a
            grid; or a distribution each (`uniform`, `log_uniform`, `normal`), for samples. Set in
            this order.
        quantities: see `available_quantities`; or functions of a `DesignResult`.
        samples: how many designs to draw, for distributions.
        sampling: Sobol's points, scrambled; a Latin hypercube; or independent draws.
        seed: of the samples.
        options: of the analysis of a design.
        out: folder of a zarr store; in memory alone if absent.
        batch: designs in a block, at most. Absent: as in the store, or 8192.
        width: designs that a device computes in step. Absent: as in the store, or 32 on a CPU.
        devices: how many devices of this process, or which; all if absent.
        client: of Dask (`pip install jaxcomp[dask]`), whose workers have this version of jaxcomp, and
            know quantities of `register_quantity` that are asked for by name; this process if absent.
        progress: show a bar on standard error, if that is a terminal.

    Returns:
        A dimension for each variable of a grid, or the one dimension `sample`, with the variables
        as coordinates; a data variable for each quantity, NaN where a design failed, and `ok`.
        Units are in the attributes. With `out` it is read from disk when it is used.

    Raises:
        BadInput: an unknown variable or quantity, a value out of bounds, an option that makes no
            sense, or a folder `out` that holds something else.
        ConnectionError: the scheduler of the cluster was lost.

    >>> from jaxcomp import load
    >>> grid = {"bore": [0.12, 0.13], "motor.mean_speed": [80.0, 100.0, 120.0]}  # [m], [rad/s]
    >>> found = sweep(load("mayekawa-wbhe"), grid, ["mechanical_efficiency"], progress=False)
    >>> print((100 * found.mechanical_efficiency.values).round(1))
    [[92.5 91.3 89.7]
     [92.4 91.4 90.2]]
    """
    if over and not isinstance(scene, Problem):
        over = by_name(machine_of(scene), over)
    points = _points(over, samples, sampling, seed)
    asked = _problem(scene, points, quantities, options)
    there = None if out is None else stored_header(Path(out))
    layout = _layout(points, batch, there)
    local = chosen_devices(devices)
    width = _chosen("width", width, there, default_width(local))
    plan = Plan(points, layout, width, *_columns(asked), fingerprint(asked, points), _about(local))
    store = InMemory(plan) if out is None else OnDisk(Path(out), plan)
    _run(plan, store, partial(solved_blocks, prepared(asked), width, local, client), progress)
    return store.dataset()


def _run(plan, store, solved, progress):
    """Work out the blocks that are not there."""
    layout, total = plan.layout, int(np.prod(plan.layout.shape))
    left, done = [], 0
    for number in range(layout.number):
        if store.has(number):
            done += _size(layout, number)
        else:
            left.append(number)
    with progress_of("Sweeping", total, done, "designs", progress) as shown:
        for number, rows, values, ok in solved(
            (n, plan.points.rows(layout.place(n))) for n in left
        ):
            store.write(number, rows, values, ok)
            done += len(rows)
            shown.at(done)


def _points(over, samples, sampling, seed) -> GridPoints | SamplePoints:
    if not over:
        raise BadInput("over", "none", "at least one variable")
    scattered = {name: axis for name, axis in over.items() if isinstance(axis, Distribution)}
    if samples is None:
        if scattered:
            name = next(iter(scattered))
            raise BadInput(name, "a distribution", "a list of values, or go with `samples`")
        return GridPoints({name: as_values(name, axis) for name, axis in over.items()})
    if len(scattered) < len(over):
        name = next(name for name in over if name not in scattered)
        raise BadInput(name, "a list of values", "a distribution, where `samples` is given")
    return SamplePoints(scattered, samples, sampling, seed)


def _problem(scene, points, quantities, options) -> Problem:
    if isinstance(scene, Problem):
        if quantities is not None or options is not None:
            raise BadInput("quantities", "given twice", "left to the `Problem`, as are the options")
        names = tuple(variable.name for variable in scene.variables)
        if tuple(points.axes) != names:
            raise BadInput("over", ", ".join(points.axes), f"{', '.join(names)}, in this order")
        _refuse_clashes(points, scene.names)
        made = scene
        for variable in made.variables:
            for end in _ends(points.axes[variable.name]):
                if not bool(variable.bound.holds(end)):
                    raise BadInput(variable.name, end, str(variable.bound))
    else:
        quantities = quantities or ("mechanical_efficiency",)
        _refuse_clashes(points, [name_of(q) for q in quantities])
        ends = {name: _ends(axis) for name, axis in points.axes.items()}
        made = problem(scene, ends, quantities, options)
    return made


def _refuse_clashes(points, quantities) -> None:
    names = [*{*points.dims, *points.axes}, *quantities, OK]
    for name in names:
        if names.count(name) > 1:
            raise BadInput("quantities", name, "a name that nothing else in the sweep has")


def _ends(axis) -> tuple[float, float]:
    if isinstance(axis, Distribution):
        return axis.ends
    return float(np.min(axis)), float(np.max(axis))


def _columns(asked: Problem) -> tuple[tuple[Column, ...], tuple[Column, ...]]:
    found = [quantity(one) if isinstance(one, str) else None for one in asked.quantities]
    pairs = zip(asked.names, found, strict=True)
    return (
        tuple(Column(variable.name, variable.unit) for variable in asked.variables),
        tuple(Column(n, q.unit, q.better, q.doc) if q else Column(n, "") for n, q in pairs),
    )


def _layout(points, batch, there) -> Layout:
    if there is None:
        batch = BATCH if batch is None else batch
        if batch < 1:
            raise BadInput("batch", batch, ">= 1")
        return Layout.of(points.shape, batch)
    stored = tuple(there["block"])
    if batch is not None and Layout.of(points.shape, batch).block != stored:
        raise BadInput("batch", batch, f"as in the store, whose blocks have shape {stored}")
    return Layout(points.shape, stored)


def _chosen(name, given, there, default) -> int:
    if given is not None and given < 1:
        raise BadInput(name, given, ">= 1")
    stored = None if there is None else there[name]
    if stored is not None and given not in (None, stored):
        raise BadInput(name, given, f"{stored}, as in the store")
    return given or stored or default


def _size(layout: Layout, number: int) -> int:
    return int(np.prod([part.stop - part.start for part in layout.place(number)]))


def _about(devices) -> dict[str, str]:
    return {
        "made_with": f"jaxcomp {version('jaxcomp')}, jax {jax.__version__}",
        "made_on": f"{devices[0].device_kind}, {platform.machine()}",
    }
