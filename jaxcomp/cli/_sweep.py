"""`jaxcomp sweep`: efficiency and other quantities over grids and samples of any numbers."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
import typer

import jaxcomp as jc

from .._core.declared import QUANTITY, Record, reading
from .._core.interrupts import words_when_stopped
from . import _options as opt
from ._arguments import assignments, si, split_at, with_one_unit
from ._output import Output
from ._start import CommandError, cluster, refuse
from ._tables import row_table

# Designs up to which a table has a row each.
_ROWS = 40
# Failed designs that are listed.
_FAILED = 10
# A word and no number: a sweep of its own for each of its values.
_LAYOUT = "crankshaft.layout"


def sweep(
    *,
    over: Annotated[list[str], typer.Option(autocompletion=opt.complete_variable)],
    quantity: opt.Quantities = None,
    case: opt.DesignCase,
    samples: int | None = None,
    sampling: opt.Sampling = "sobol",
    seed: int = 0,
    analysis: opt.Analysis,
    batch: int | None = None,
    devices: int | None = None,
    dask: opt.Dask = None,
    output: Output,
) -> None:
    """Solve all designs of a grid, or samples, and show the best ones.

    With --out everything is kept in OUT/sweep.zarr while it is found. The same command goes on where
    a stopped one ended.

    Example: [bold]jaxcomp sweep mayekawa-wbhe --over bore_at_displacement=100mm:150mm:51 --over
    motor.mean_speed=600rpm:1400rpm:33 --out result[/bold]

    Args:
        over (NAME=VALUES): Variable and its values: FROM:TO:COUNT, log:FROM:TO:COUNT or A,B,C; with
            --samples FROM:TO, log:FROM:TO or normal:MEAN:DEVIATION. Repeatable; set in this order.
            crankshaft.layout=V90,W60 sweeps the layout.
        quantity (NAME): Quantity of each design, e.g. motor_power or loss_power.wall;
            mechanical_efficiency if absent. Repeatable.
        samples (N): Draw N designs instead of a grid.
        sampling: How samples are drawn.
        seed: Seed of the samples.
        batch: Designs that are solved and written at a time.
        devices: Cores (or other devices) to use; all if absent.
    """
    if samples is not None:
        refuse(samples < 1, f"--samples {samples}: must be >= 1")
    elif sampling != "sobol":
        raise CommandError(f"--sampling {sampling}: has no meaning without --samples")
    start_devices(devices)
    scene = case.scene(varied=over)
    layouts, ranges = _layouts_and_ranges(over)
    axes = axes_of(scene, ranges, samples is not None)
    quantities = quantity or default_quantities(scene)
    layout_scenes = {}
    if layouts:
        layout_scenes = _with_layouts(scene, assignments(layouts, "--over")[_LAYOUT])
    store = None
    resumption = "nothing was kept; with --out FOLDER a stopped sweep goes on"
    if output.out is not None:
        store = output.out / "sweep.zarr"
        resumption = f"{store} is kept; go on with the same command"
    words_when_stopped(f"stopped; {resumption}")
    options: dict[str, Any] = {
        "samples": samples if axes else None,
        "sampling": sampling.replace("-", "_"),
        "seed": seed,
        "out": store,
        "batch": batch,
        "devices": devices,
    }
    from ..study.sweep._run import sweep_machines
    from ..study.sweep._summary import columns, summary

    with cluster(dask) as client:
        options |= {"options": analysis.options(scene), "client": client}
        if layout_scenes:
            options["dimension"] = _LAYOUT
            dataset = sweep_machines(layout_scenes, axes, quantities, **options)
        else:
            dataset = jc.study.sweep.sweep(scene, axes, quantities, **options)
    if layout_scenes:
        answer = LayoutSweep(_values_of_each(dataset))
        tables = partial(layouts_tables, dataset)
    else:
        answer = summary(dataset)
        tables = partial(sweep_tables, dataset)

    def pictures():
        from ..plot._sweep import machine_figures, sweep_figures

        if layout_scenes:
            return machine_figures(dataset, scene.name, _LAYOUT)
        return sweep_figures(dataset, scene.name)

    output.emit(
        answer,
        tables,
        pictures,
        scene,
        {"designs": lambda: columns(dataset)},
        metadata={"scene": scene.name, "store": store and str(store)},
    )


@dataclass(frozen=True)
class LayoutSweep(Record):
    """Quantities [SI] of all designs of each layout, by name, and how each design ended."""

    layouts: dict[str, dict[str, Any]] = reading(QUANTITY)


def _layouts_and_ranges(texts: Sequence[str]) -> tuple[list[str], list[str]]:
    """The texts of `--over` that name layouts, and those with values of numbers."""
    layouts = []
    ranges = []
    for text in texts:
        if split_at("=", text)[0] == _LAYOUT:
            layouts.append(text)
        else:
            ranges.append(text)
    return layouts, ranges


def _with_layouts(scene: jc.scene.Scene, names: str) -> dict[str, jc.scene.Scene]:
    """The scene with every layout of the cylinders, by its name."""
    refuse(scene.compressor is None, f"--over {_LAYOUT}: {scene.name} has no crankshaft")
    changes = {_LAYOUT: None, "crankshaft.throws": None}
    scenes = {}
    for name in map(str.strip, names.split(",")):
        if name not in scenes:
            scenes[name] = jc.scene.with_values(scene, changes | {_LAYOUT: name})
    return scenes


def _values_of_each(dataset) -> dict[str, dict[str, Any]]:
    """The quantities of all designs of each layout, and how each ended."""
    from ..study.sweep._store import quantity_names, status_words
    from ..study.sweep._summary import machine_parts

    values = {}
    for name, part in machine_parts(dataset, _LAYOUT).items():
        columns = {}
        for quantity in (*quantity_names(part), "ok"):
            columns[quantity] = part[quantity].values
        values[name] = columns | {"status": status_words(part)}
    return values


def layouts_tables(dataset, result: dict[str, Any]) -> Iterator[Any]:
    """Best and worst designs of each layout."""
    from ..study.sweep._best import shown_column
    from ..study.sweep._store import quantity_names
    from ..study.sweep._summary import machine_parts

    rows = []
    parts = machine_parts(dataset, _LAYOUT)
    for name, part in parts.items():
        failed = int(part["ok"].size - part["ok"].sum())
        for quantity in quantity_names(part):
            look = shown_column(dataset, quantity)
            lowest = _cell(look, float(part[quantity].min()))
            highest = _cell(look, float(part[quantity].max()))
            rows.append((name, look.label, lowest, highest, failed or ""))
    heads = ("Layout", "Quantity", "Lowest", "Highest", "Failed")
    yield row_table(f"{result['scene']}: {len(parts)} layouts", heads, rows, texts=2)


def start_devices(count: int | None) -> None:
    """Let JAX see as many devices as this process may use cores; before its first operation."""
    import jax

    refuse(count is not None and count < 1, f"--devices {count}: must be >= 1")
    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", count or len(os.sched_getaffinity(0)))
    except RuntimeError:  # JAX runs already, with the devices it has
        return


def default_quantities(scene: jc.scene.Scene) -> list[str]:
    """Quantities if none are named."""
    if scene.compressor is None:
        return ["vibration"]
    return ["mechanical_efficiency"]


def axes_of(scene: jc.scene.Scene, texts: Sequence[str], sampled: bool) -> dict[str, Any]:
    """Values or distributions of the variables, in SI units."""
    from ..study._variables import by_name

    design = jc.machine.machine_of(scene)
    axes = {}
    for name, text in by_name(design, assignments(texts, "--over")).items():
        option = f"--over {name}={text}"
        variable = jc.study.variable(design, name)
        axes[name] = axis_values(text, variable.unit, option, sampled)
        values = axes[name]
        ends = values.ends if sampled else (min(values), max(values))
        for end in ends:
            if not bool(variable.bound.holds(float(end))):
                raise CommandError(f"{option}: must be {variable.bound} {variable.unit}".rstrip())
    return axes


def axis_values(text: str, unit: str, option: str, sampled: bool, default_unit: str | None = None):
    """Values of a grid [SI], or the distribution of samples; bare numbers have the default unit."""
    kind, colon, range_text = split_at(":", text)
    if colon and kind in ("log", "normal"):
        text = range_text
    else:
        kind = ""
    parts = list(map(str.strip, text.split(":")))

    def numbers(texts):
        values = []
        for place, number in enumerate(with_one_unit(texts)):
            # the second number of a normal distribution, its deviation, is a difference
            difference = kind == "normal" and place == 1
            values.append(si(number, unit, option, difference, default_unit))
        return values

    if sampled:
        forms = "from:to, log:from:to or normal:mean:deviation with --samples"
        refuse(len(parts) != 2, f"{option}: must have the form {forms}")
        distribution = {
            "": jc.study.sweep.uniform,
            "log": jc.study.sweep.log_uniform,
            "normal": jc.study.sweep.normal,
        }[kind]
        return _call_checked(distribution, option, *numbers(parts))
    refuse(kind == "normal", f"{option}: needs --samples")
    if len(parts) == 1 and not kind:
        values = numbers(text.split(","))
        refuse(len(set(values)) < len(values), f"{option}: must not repeat a value")
        return values
    forms = "from:to:count, log:from:to:count or a,b,c"
    problem = text
    if len(parts) == 2:
        problem = f"{text} lacks a count, as in {text}:5;"
    counted = len(parts) == 3 and parts[2].isdigit()
    refuse(not counted, f"{option}: {problem} must have the form {forms}")
    grid = jc.study.sweep.log_grid if kind else jc.study.sweep.grid
    return _call_checked(grid, option, *numbers(parts[:2]), int(parts[2]))


def _call_checked(function, option, *numbers):
    try:
        return function(*numbers)
    except ValueError as error:
        raise CommandError(f"{option}: {error}") from None


def sweep_tables(dataset, result: dict[str, Any]):
    """Ranges and best designs of the quantities, and the curve or the best curve where there is one."""
    from ..study.sweep._best import shown_column

    title = f"{result['scene']}: {result['designs']:,} designs"
    if result["failed"]:
        title += f", {result['failed']:,} failed"
    yield _summary(dataset, result, title)
    if result["failed_by_status"]:
        yield _failed_table(dataset, result)
    if result["failed"] == result["designs"]:
        yield f"No design has a result; `jaxcomp run {result['scene']}` states why one fails.\n"
        return
    dims = dataset["ok"].dims
    if len(dims) == 1 and dims[0] != "sample" and dataset["ok"].size <= _ROWS:
        looks = []
        columns = []
        for name in (*result["variables"], *result["quantities"]):
            look = shown_column(dataset, name)
            looks.append(look)
            columns.append([_cell(look, value) for value in dataset[name].values.tolist()])
        yield _numbers("Designs", looks, zip(*columns, strict=True))
    for name, entry in result["quantities"].items():
        if entry["best_curve"] is not None and len(entry["best_curve"]["points"]) <= _ROWS:
            yield _curve_table(dataset, name, entry["best_curve"])


def _summary(dataset, result, title):
    from ..study.sweep._best import shown_column

    names = (*result["variables"], *result["quantities"])
    looks = {name: shown_column(dataset, name) for name in names}
    rows = []
    for name, entry in result["quantities"].items():
        middle = entry["percentiles"] and entry["percentiles"]["50"]
        best = entry["best"] or {}
        places = []
        for variable in result["variables"]:
            if variable in best:
                look = looks[variable]
                places.append(f"{look.words.lower()} {look.text(best[variable])}")
        look = looks[name]
        lowest = _cell(look, entry["lowest"])
        highest = _cell(look, entry["highest"])
        rows.append((look.label, lowest, _cell(look, middle), highest, ", ".join(places)))
    table = row_table(title, ("Quantity", "Lowest", "Median", "Highest", "Best at"), rows)
    table.columns[-1].justify = "left"
    return table


def _failed_table(dataset, result):
    """The first of the designs that failed, each with its status, and what the statuses mean."""
    from .._core.status import status_meaning
    from ..study.sweep._best import shown_column
    from ..study.sweep._store import status_words

    failed = ~dataset["ok"].values.ravel()
    looks = []
    columns = []
    for name in result["variables"]:
        looks.append(shown_column(dataset, name))
        axis = dataset[name].broadcast_like(dataset["ok"]).transpose(*dataset["ok"].dims)
        columns.append(axis.values.ravel()[failed][:_FAILED])
    statuses = np.asarray(status_words(dataset)).ravel()[failed][:_FAILED]
    rows = []
    for *values, status in zip(*columns, statuses, strict=True):
        rows.append((*map(_cell, looks, values), str(status).replace("_", " ")))
    notes = []
    for status, count in result["failed_by_status"].items():
        notes.append(f"{status.replace('_', ' ')} ({count:,}): {status_meaning(status)}")
    if result["failed"] > _FAILED:
        notes.append(f"{result['failed'] - _FAILED:,} more are in designs.csv of --out FOLDER")
    heads = [*(look.label for look in looks), "Status"]
    table = row_table("Designs that failed", heads, rows, caption="\n".join(notes))
    table.columns[0].justify = "right"
    table.columns[-1].justify = "left"
    return table


def _curve_table(dataset, name, curve):
    from ..study.sweep._best import shown_column

    abscissa = shown_column(dataset, curve["across"])
    varied = shown_column(dataset, curve["along"])
    value = shown_column(dataset, name)
    tried = dataset[curve["along"]].values
    ends = (tried.min(), tried.max())
    rows = []
    for point in curve["points"]:
        best = _cell(varied, point["best"])
        if point["best"] in ends:
            best += " (end of the range)"
        rows.append((_cell(abscissa, point["across"]), best, _cell(value, point["value"])))
    best = varied._replace(words=f"Best {varied.words[:1].lower()}{varied.words[1:]}")
    title = f"{best.words}, by {abscissa.words[:1].lower()}{abscissa.words[1:]}"
    return _numbers(title, (abscissa, best, value), rows)


def _numbers(title: str, looks, rows):
    table = row_table(title, [look.label for look in looks], map(tuple, rows))
    table.columns[0].justify = "right"
    return table


def _cell(look, value) -> str:
    if value is None or not math.isfinite(value):
        return "failed"
    return look.number(value)
