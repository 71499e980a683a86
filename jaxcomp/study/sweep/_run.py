r"""`sweep`: the quantities of many designs of one machine, or of several."""

import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import jax
import numpy as np
from jaxtyping import Float

from ..._core.arguments import by_names
from ..._core.errors import BadInput
from ..._core.progress import progress_of
from ...machine import HasMachine, Machine, machine_of
from .. import AnalysisOptions, prepared
from .. import variable as find_variable
from .._analysis import quantity_named
from .._problem import Problem, RequestedQuantity, problem_of
from .._variables import Variable, by_name
from ._design_blocks import Device, chosen_devices, default_width, solved_blocks
from ._points import Blocks, Distribution, GridPoints, Rows, SamplePoints, extent, uniform
from ._store import (
    OK,
    STATUS,
    Headings,
    InMemory,
    OnDisk,
    Plan,
    fingerprint,
    heading,
    stored_header,
)

if TYPE_CHECKING:
    import xarray
    from distributed import Client

# Large enough that writing a block takes a small share of working it out, small enough that a
# killed run loses a fraction of a second.
BATCH = 8192
# Which number takes its own value where nothing but the machine changes.
_HELD = "mechanism.crank_radius"

Over: TypeAlias = Mapping[str, Distribution | Sequence[float] | Float[np.ndarray, " n"]]


def sweep(
    scene: Machine | HasMachine | Problem,
    over: Over | None = None,
    quantities: Sequence[RequestedQuantity] | None = None,
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
            this order. Absent, samples of a `Problem` are drawn evenly within its ranges.
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
        as coordinates; a data variable for each quantity, NaN where a design failed, `ok`, and
        `status`, the code of how a design ended, whose attribute `flag_meanings` names the codes.
        Units are in the attributes. With `out` it is read from disk when it is used.

    Raises:
        BadInput: an unknown variable or quantity, a value out of bounds, an option that makes no
            sense, or a folder `out` that holds something else.
        ConnectionError: the scheduler of the cluster was lost.

    >>> from jaxcomp import load
    >>> grid = {"bore_at_displacement": [0.12, 0.13], "motor.mean_speed": [80.0, 100.0, 120.0]}  # SI
    >>> designs = sweep(load("mayekawa-wbhe"), grid, ["mechanical_efficiency"], progress=False)
    >>> print((100 * designs.mechanical_efficiency.values).round(1))
    [[92.5 91.3 89.7]
     [92.4 91.4 90.2]]
    """
    if over is None and samples is not None and isinstance(scene, Problem):
        over = {variable.name: _within_range(variable) for variable in scene.variables}
    by_names("over", over, '{"mechanism.bore": [0.12, 0.13]}')
    if over and not isinstance(scene, Problem):
        over = by_name(machine_of(scene), over)
    points = _points(over, samples, sampling, seed)
    problem = problem_of(scene, "over", tuple(points.axes), quantities, options)
    _check(problem, points)
    header = None
    if out is not None:
        header = stored_header(Path(out))
    local = chosen_devices(devices)
    layout, width = _layout(problem, points, batch, width, local, header)
    about = {
        "made_with": f"jaxcomp {version('jaxcomp')}, jax {jax.__version__}",
        "made_on": f"{local[0].device_kind}, {platform.machine()}",
    }
    with_status = header is None or STATUS in header["columns"]
    marks = fingerprint(problem, points)
    plan = Plan(points, layout, width, *_headings(problem), marks, about, with_status)
    store = _store(plan, out)
    unsolved = [number for number in range(layout.number) if not store.has(number)]
    total = int(np.prod(layout.shape))
    solved = total
    for number in unsolved:
        solved -= int(np.prod(extent(layout.place(number))))
    blocks = _blocks(points, layout, unsolved)
    # The fingerprint is that of the problem as it was given; solving may prepare its rotor.
    with progress_of("Sweeping", total, solved, "designs", progress) as shown:
        for block in solved_blocks(prepared(problem), width, local, client, blocks):
            store.write(*block)
            solved += len(block[1])
            shown.at(solved)
    return store.dataset()


def sweep_machines(
    machines: Mapping[str, Machine | HasMachine],
    over: Over,
    quantities: Sequence[RequestedQuantity],
    *,
    dimension: str = "machine",
    out: str | Path | None = None,
    **options,
) -> "xarray.Dataset":
    """All designs of a sweep for every one of several machines that differ by more than numbers.

    Args:
        machines: scenes or machines by name.
        over: values of other variables as for `sweep`; empty for the machines alone.
        quantities: as for `sweep`.
        dimension: name of the dimension along which the machines stand.
        out: folder in which every machine has the zarr store of its name; in memory alone if absent.
        options: other arguments of `sweep`.

    Returns:
        The machines along the first dimension.

    Raises:
        BadInput: no machine; or as `sweep`.
    """
    import xarray

    if not machines:
        raise BadInput("machines", "none", "at least one")
    datasets = []
    for name, machine in machines.items():
        design = machine_of(machine)
        held = {_HELD: [float(find_variable(design, _HELD).current(design))]}
        store = None
        if out is not None:
            store = Path(out) / name
        dataset = sweep(machine, over or held, quantities, out=store, **options)
        if not over:
            dataset = dataset.isel({_HELD: 0}, drop=True)
        datasets.append(dataset)
    return xarray.concat(datasets, xarray.Variable(dimension, list(machines)))  # pyright: ignore


def _within_range(variable: Variable) -> Distribution:
    """Every value of the range of a variable, as likely as any other."""
    if not np.isfinite([variable.low, variable.high]).all():
        raise BadInput(
            variable.name, "without a range", "given one, (low, high), for samples within"
        )
    return uniform(variable.low, variable.high)


def _store(plan: Plan, out: str | Path | None) -> InMemory | OnDisk:
    if out is None:
        return InMemory(plan)
    return OnDisk(Path(out), plan)


def _blocks(
    points: GridPoints | SamplePoints, layout: Blocks, numbers: Sequence[int]
) -> Iterator[tuple[int, Rows]]:
    """Blocks by number with their designs, which are made when a block is needed."""
    for number in numbers:
        yield number, points.rows(layout.place(number))


def _points(over, samples, sampling, seed) -> GridPoints | SamplePoints:
    if not over:
        raise BadInput("over", "none", "at least one variable")
    scattered = {name: axis for name, axis in over.items() if isinstance(axis, Distribution)}
    if samples is None:
        if scattered:
            name = next(iter(scattered))
            raise BadInput(name, "a distribution", "a list of values, or go with `samples`")
        return GridPoints(over)
    if len(scattered) < len(over):
        name = next(name for name in over if name not in scattered)
        values = np.asarray(over[name]).ravel()
        ends = "low, high"
        if values.size:
            ends = f"{values.min():.6g}, {values.max():.6g}"
        form = f"jaxcomp.uniform({ends}), or log_uniform or normal, where `samples` is given"
        raise BadInput(name, "a list of values", form)
    return SamplePoints(scattered, samples, sampling, seed)


def _check(problem: Problem, points: GridPoints | SamplePoints) -> None:
    """Refuse values out of bounds, and a name that stands for two columns."""
    for variable in problem.variables:
        for end in points.ends[variable.name]:
            if not bool(variable.bound.holds(end)):
                raise BadInput(variable.name, end, f"{variable.bound} {variable.unit}".rstrip())
    names = [*{*points.dims, *points.axes}, *problem.names, STATUS, OK]
    for name in names:
        if names.count(name) > 1:
            raise BadInput("quantities", name, "a name that nothing else in the sweep has")


def _headings(problem: Problem) -> tuple[Headings, Headings]:
    """Headings of variables and of quantities."""
    variables = {}
    for variable in problem.variables:
        variables[variable.name] = heading(variable.unit, variable.name)
    registered = {}
    for requested in problem.quantities:
        if isinstance(requested, str):
            registered[requested] = quantity_named(requested)
    quantities = {}
    for name in problem.names:
        quantities[name] = heading("", name)
        if name in registered:
            quantity = registered[name]
            quantities[name] = heading(quantity.unit, quantity.doc, quantity.better)
    return variables, quantities


def _layout(problem, points, batch, width, devices, header) -> tuple[Blocks, int]:
    """Blocks, and designs that a device computes in step: those of a store, if there is one."""
    for name, count in {"batch": batch, "width": width}.items():
        if count is not None and count < 1:
            raise BadInput(name, count, ">= 1")
    if header is None:
        return Blocks.of(points.shape, batch or BATCH), width or default_width(problem, devices)
    layout = Blocks(points.shape, tuple(header["block"]))
    stored = header["width"]
    if batch is not None and Blocks.of(points.shape, batch) != layout:
        bound = f"as in the store, whose blocks have shape {layout.block}"
        raise BadInput("batch", batch, bound)
    if width not in (None, stored):
        raise BadInput("width", width, f"{stored}, as in the store")
    return layout, stored
