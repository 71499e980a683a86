"""`jaxcomp sweep`: efficiency and other quantities over grids and samples of any numbers."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np
import typer

import jaxcomp as jc

from .._core.interrupts import words_when_stopped
from . import _options as opt
from ._arguments import assignments, si, with_one_unit
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
    if samples is None:
        odd = sampling != "sobol"
        refuse(odd, f"--sampling {sampling}: has no meaning without --samples")
    else:
        refuse(samples < 1, f"--samples {samples}: must be >= 1")
    start_devices(devices)
    scene = case.scene(varied=over)
    layouts = [text for text in over if text.partition("=")[0].strip() == _LAYOUT]
    axes = axes_of(scene, [text for text in over if text not in layouts], samples is not None)
    asked = quantity or default_quantities(scene)
    several = _with_layouts(scene, assignments(layouts, "--over")[_LAYOUT]) if layouts else {}
    store = None if output.out is None else output.out / "sweep.zarr"
    kept = "nothing was kept; with --out FOLDER a stopped sweep goes on"
    if store:
        kept = f"{store} is kept; go on with the same command"
    words_when_stopped(f"stopped; {kept}")
    options: dict[str, Any] = {
        "samples": samples if axes else None,
        "sampling": sampling.replace("-", "_"),
        "seed": seed,
        "out": store,
        "batch": batch,
        "devices": devices,
    }
    of = jc.study.sweep
    with cluster(dask) as client:
        options |= {"options": analysis.options(scene), "client": client}
        if several:
            options["dimension"] = _LAYOUT
            found = of.interface.sweep_machines(several, axes, asked, **options)
        else:
            found = of.sweep(scene, axes, asked, **options)
    draw, drawn = jc.plot.interface.sweep_figures, (found, scene.name)
    if several:
        draw, drawn = jc.plot.interface.machine_figures, (*drawn, _LAYOUT)
    numbers = {"layouts": _values_of_each(found)} if several else of.interface.summary(found)
    output.emit(
        {"scene": scene.name, **numbers, "store": None if store is None else str(store)},
        lambda whole: (layouts_tables if several else sweep_tables)(found, whole),
        lambda: draw(*drawn),
        scene,
        {"designs": lambda: of.interface.columns(found)},
    )


def _with_layouts(scene: jc.scene.Scene, names: str) -> dict[str, jc.scene.Scene]:
    """The scene with every layout of the cylinders, by its name."""
    refuse(scene.compressor is None, f"--over {_LAYOUT}: {scene.name} has no crankshaft")
    changes = {_LAYOUT: None, "crankshaft.throws": None}
    return {
        name: jc.scene.with_values(scene, changes | {_LAYOUT: name})
        for name in dict.fromkeys(name.strip() for name in names.split(","))
    }


def _values_of_each(found) -> dict[str, dict[str, Any]]:
    """The quantities of all designs of each layout, and how each ended."""
    of = jc.study.sweep.interface
    values = {}
    for name, part in of.machine_parts(found, _LAYOUT).items():
        own = {asked: part[asked].values for asked in (*of.quantity_names(part), "ok")}
        values[name] = own | {"status": of.status_words(part)}
    return values


def layouts_tables(found, result: dict[str, Any]) -> Iterator[Any]:
    """Best and worst designs of each layout."""
    rows = []
    parts = jc.study.sweep.interface.machine_parts(found, _LAYOUT)
    for name, part in parts.items():
        failed = int(part["ok"].size - part["ok"].sum())
        for asked in jc.study.sweep.interface.quantity_names(part):
            look = jc.study.sweep.interface.shown_column(found, asked)
            ends = (_cell(look, float(end)) for end in (part[asked].min(), part[asked].max()))
            rows.append((name, look.label, *ends, failed or ""))
    heads = ("Layout", "Quantity", "Lowest", "Highest", "Failed")
    yield row_table(f"{result['scene']}: {len(parts)} layouts", heads, rows, texts=2)


def start_devices(wanted: int | None) -> None:
    """Let JAX see as many devices as this process may use cores; before its first operation."""
    import jax

    refuse(wanted is not None and wanted < 1, f"--devices {wanted}: must be >= 1")
    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", wanted or len(os.sched_getaffinity(0)))
    except RuntimeError:  # JAX runs already, with the devices it has
        return


def default_quantities(scene: jc.scene.Scene) -> list[str]:
    """Quantities if none are named."""
    return ["mechanical_efficiency"] if scene.compressor is not None else ["vibration"]


def axes_of(scene: jc.scene.Scene, texts: Sequence[str], sampled: bool) -> dict[str, Any]:
    """Values or distributions of the variables, in SI units."""
    design = jc.machine.machine_of(scene)
    axes = {}
    for name, text in jc.study.interface.by_name(design, assignments(texts, "--over")).items():
        option = f"--over {name}={text}"
        one = jc.study.variable(design, name)
        axes[name] = axis_values(text, one.unit, option, sampled)
        ends = axes[name].ends if sampled else (float(min(axes[name])), float(max(axes[name])))
        for end in ends:
            if not bool(one.bound.holds(end)):
                raise CommandError(f"{option}: must be {one.bound} {one.unit}".rstrip())
    return axes


def axis_values(text: str, unit: str, option: str, sampled: bool, default_unit: str | None = None):
    """Values of a grid [SI], or the distribution of samples; bare numbers have the default unit."""
    kind, colon, rest = (part.strip() for part in text.partition(":"))
    if colon and kind in ("log", "normal"):
        text = rest
    else:
        kind = ""
    parts = [part.strip() for part in text.split(":")]

    def numbers(texts):
        # a deviation is a difference
        return [
            si(one, unit, option, kind == "normal" and place == 1, default_unit)
            for place, one in enumerate(with_one_unit(texts))
        ]

    if sampled:
        forms = "from:to, log:from:to or normal:mean:deviation with --samples"
        refuse(len(parts) != 2, f"{option}: must have the form {forms}")
        of = jc.study.sweep
        made = {"": of.uniform, "log": of.log_uniform, "normal": of.normal}[kind]
        return _made(made, option, *numbers(parts))
    refuse(kind == "normal", f"{option}: needs --samples")
    if len(parts) == 1 and not kind:
        values = numbers(text.split(","))
        refuse(len(set(values)) < len(values), f"{option}: must not repeat a value")
        return values
    forms = "from:to:count, log:from:to:count or a,b,c"
    counted = len(parts) == 3 and parts[2].isdigit()
    given = text if len(parts) != 2 else f"{text} lacks a count, as in {text}:5;"
    refuse(not counted, f"{option}: {given} must have the form {forms}")
    made = jc.study.sweep.log_grid if kind else jc.study.sweep.grid
    return _made(made, option, *numbers(parts[:2]), int(parts[2]))


def _made(kind, option, *numbers):
    try:
        return kind(*numbers)
    except ValueError as error:
        raise CommandError(f"{option}: {error}") from None


def sweep_tables(found, result: dict[str, Any]):
    """Ranges and best designs of the quantities, and the curve or the best curve where there is one."""
    failed = f", {result['failed']:,} failed" if result["failed"] else ""
    yield _summary(found, result, f"{result['scene']}: {result['designs']:,} designs{failed}")
    if result["failed_by_status"]:
        yield _failed_table(found, result)
    if result["failed"] == result["designs"]:
        yield f"No design has a result; `jaxcomp run {result['scene']}` states why one fails.\n"
        return
    dims = found["ok"].dims
    if len(dims) == 1 and dims[0] != "sample" and found["ok"].size <= _ROWS:
        names = [*result["variables"], *result["quantities"]]
        looks = [jc.study.sweep.interface.shown_column(found, name) for name in names]
        rows = zip(*(found[name].values.tolist() for name in names), strict=True)
        yield _numbers("Designs", looks, (map(_cell, looks, row) for row in rows))
    for name, entry in result["quantities"].items():
        if entry["best_curve"] is not None and len(entry["best_curve"]["points"]) <= _ROWS:
            yield _curve_table(found, name, entry["best_curve"])


def _summary(found, result, title):
    names = (*result["variables"], *result["quantities"])
    looks = {name: jc.study.sweep.interface.shown_column(found, name) for name in names}
    rows = []
    for name, entry in result["quantities"].items():
        middle = entry["percentiles"] and entry["percentiles"]["50"]
        best = entry["best"] or {}
        place = ", ".join(
            f"{looks[variable].words.lower()} {looks[variable].text(best[variable])}"
            for variable in result["variables"]
            if variable in best
        )
        cells = (_cell(looks[name], x) for x in (entry["lowest"], middle, entry["highest"]))
        rows.append((looks[name].label, *cells, place))
    table = row_table(title, ("Quantity", "Lowest", "Median", "Highest", "Best at"), rows)
    table.columns[-1].justify = "left"
    return table


def _failed_table(found, result):
    """The first of the designs that failed, each with its status, and what the statuses mean."""
    from .._core.status import status_meaning

    of = jc.study.sweep.interface
    lost = ~found["ok"].values.ravel()
    looks = {name: of.shown_column(found, name) for name in result["variables"]}
    axes = {name: found[name].broadcast_like(found["ok"]) for name in looks}
    dims = found["ok"].dims
    columns = [axes[name].transpose(*dims).values.ravel()[lost][:_FAILED] for name in looks]
    ended = np.asarray(of.status_words(found)).ravel()[lost][:_FAILED]
    rows = [
        (*map(_cell, looks.values(), values), str(name).replace("_", " "))
        for *values, name in zip(*columns, ended, strict=True)
    ]
    counts = result["failed_by_status"].items()
    told = [
        f"{name.replace('_', ' ')} ({count:,}): {status_meaning(name)}" for name, count in counts
    ]
    if result["failed"] > _FAILED:
        told.append(f"{result['failed'] - _FAILED:,} more are in designs.csv of --out FOLDER")
    heads = [*(look.label for look in looks.values()), "Status"]
    table = row_table("Designs that failed", heads, rows, caption="\n".join(told))
    table.columns[0].justify = "right"
    table.columns[-1].justify = "left"
    return table


def _curve_table(found, name, curve):
    names = (curve["across"], curve["along"], name)
    across, along, value = (jc.study.sweep.interface.shown_column(found, name) for name in names)
    tried = found[curve["along"]].values
    ends = (tried.min(), tried.max())
    rows = []
    for point in curve["points"]:
        best = _cell(along, point["best"])
        best += " (end of the range)" if point["best"] in ends else ""
        rows.append((_cell(across, point["across"]), best, _cell(value, point["value"])))
    best = along._replace(words=f"Best {along.words[:1].lower()}{along.words[1:]}")
    title = f"{best.words}, by {across.words[:1].lower()}{across.words[1:]}"
    return _numbers(title, (across, best, value), rows)


def _numbers(title: str, looks, rows):
    table = row_table(title, [look.label for look in looks], map(tuple, rows))
    table.columns[0].justify = "right"
    return table


def _cell(look, value) -> str:
    known = value is not None and math.isfinite(value)
    return look.number(value) if known else "failed"
