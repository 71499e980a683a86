"""`jaxcomp sweep`: efficiency and other quantities over grids and samples of any numbers."""

from __future__ import annotations

import enum
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import jaxcomp as jc

from ._arguments import assignments, changed_scene, with_one_unit
from ._completion import complete_quantity, complete_variable
from ._errors import STOPPED, CommandError, reports_errors
from ._json import plain
from ._options import (
    Accuracy,
    AccuracyOption,
    AsJson,
    Dask,
    Designs,
    Machine,
    Out,
    Sets,
    analysis_solver,
)
from ._output import hand_out
from ._start import cluster, start_jax
from ._tables import row_table


class Sampling(enum.StrEnum):
    """How samples are drawn."""

    sobol = "sobol"
    latin_hypercube = "latin-hypercube"
    random = "random"


# A word and no number: a sweep of its own for each of its values.
_LAYOUT = "cylinders.layout"


@reports_errors
def sweep(
    machine: Machine,
    over: Annotated[
        list[str],
        typer.Option(
            "--over",
            metavar="NAME=VALUES",
            help="Variable and its values: FROM:TO:COUNT, log:FROM:TO:COUNT or A,B,C; with --samples "
            "FROM:TO, log:FROM:TO or normal:MEAN:DEVIATION. Repeatable; set in this order. "
            "cylinders.layout=V90,W60 sweeps the layout.",
            autocompletion=complete_variable,
        ),
    ],
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            "--quantity",
            metavar="NAME",
            help="Quantity of each design, e.g. motor_power or loss_power.wall; "
            "mechanical_efficiency if absent. Repeatable.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    sets: Sets = None,
    designs: Designs = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="Draw N designs instead of a grid.")
    ] = None,
    sampling: Annotated[Sampling, typer.Option(help="How samples are drawn.")] = Sampling.sobol,
    seed: Annotated[int, typer.Option(help="Seed of the samples.")] = 0,
    accuracy: AccuracyOption = Accuracy.fine,
    batch: Annotated[
        int | None, typer.Option(help="Designs that are solved and written at a time.")
    ] = None,
    devices: Annotated[
        int | None, typer.Option(help="Cores (or other devices) to use; all if absent.")
    ] = None,
    dask: Dask = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Solve all designs of a grid, or samples, and show the best ones.

    With --out everything is kept in OUT/sweep.zarr while it is found. The same command goes on where
    a stopped one ended.

    Example: [bold]jaxcomp sweep mayekawa-wbhe --over bore=100mm:150mm:51 --over
    motor.mean_speed=600rpm:1400rpm:33 --out result[/bold]
    """
    _check(sampling, samples)
    start_devices(devices)
    start_jax()
    scene = changed_scene(machine, sets or (), designs or (), over)
    layouts = [text for text in over if text.partition("=")[0].strip() == _LAYOUT]
    over = [text for text in over if text not in layouts]
    axes = axes_of(scene, over, samples is not None)
    asked = quantity or default_quantities(scene)
    several = _with_layouts(scene, assignments(layouts, "--over")[_LAYOUT]) if layouts else {}
    try:
        with cluster(dask) as client:
            options: dict[str, Any] = {
                "samples": samples if axes else None,
                "sampling": sampling.value.replace("-", "_"),
                "seed": seed,
                "options": jc.design.AnalysisOptions(analysis_solver(accuracy)),
                "out": None if out is None else out / "sweep.zarr",
                "batch": batch,
                "devices": devices,
                "client": client,
            }
            if several:
                found = jc.sweeping.sweep_machines(
                    several, axes, asked, dimension=_LAYOUT, **options
                )
            else:
                found = jc.sweeping.sweep(scene, axes, asked, **options)
    except KeyboardInterrupt:
        kept = (
            f"{out / 'sweep.zarr'} is kept; go on with the same command"
            if out
            else ("nothing was kept; with --out FOLDER a stopped sweep goes on")
        )
        typer.echo(f"stopped; {kept}", err=True)
        raise typer.Exit(STOPPED) from None
    if several:
        _hand_out_layouts(scene, found, as_json, out)
        return
    result = sweep_result(found, scene.name, out)

    def figures():
        return jc.plot.sweep_figures(found, scene.name)

    curves = None if out is None else {"designs": sweep_columns(found)}
    hand_out(result, sweep_tables(found, result), as_json, out, figures, scene, curves)


def _with_layouts(scene: jc.scene.Scene, names: str) -> dict[str, jc.scene.Scene]:
    """The scene with every layout of the cylinders, by its name."""
    if getattr(scene.compressor, "cylinders", None) is None:
        raise CommandError(f"--over {_LAYOUT}: {scene.name} has no section [cylinders]")
    changes = {_LAYOUT: None, "cylinders.throws": None}
    return {
        name: jc.scene.with_values(scene, changes | {_LAYOUT: name})
        for name in dict.fromkeys(name.strip() for name in names.split(","))
    }


def _hand_out_layouts(scene: jc.scene.Scene, found, as_json: bool, out: Path | None) -> None:
    """Best and worst designs of each layout of the cylinders."""
    names = [str(name) for name in found[_LAYOUT].values]
    parts = {name: found.sel({_LAYOUT: name}, drop=True) for name in names}
    rows = []
    for name, part in parts.items():
        for asked in (str(one) for one in part.data_vars if one != "ok"):
            look = jc.sweeping.shown_column(found, asked)
            ends = (float(part[asked].min()), float(part[asked].max()))
            failed = int(part["ok"].size - part["ok"].sum())
            rows.append((name, look.label, *(_cell(look, end) for end in ends), failed or ""))
    result = plain(
        {
            "scene": scene.name,
            "layouts": {
                name: {q: part[q].values for q in map(str, part.data_vars)}
                for name, part in parts.items()
            },
            "store": None if out is None else str(out / "sweep.zarr"),
        }
    )

    def figures():
        drawn = jc.plot.machine_figures(found, scene.name, _LAYOUT)
        for name, part in parts.items():
            if part["ok"].dims:
                own = jc.plot.sweep_figures(part, f"{scene.name}, {name}")
                drawn |= {f"{name}-{figure}": one for figure, one in own.items()}
        return drawn

    heads = ("Layout", "Quantity", "Lowest", "Highest", "Failed")
    table = row_table(f"{scene.name}: {len(names)} layouts", heads, rows, texts=2)
    curves = None if out is None else {"designs": sweep_columns(found)}
    hand_out(result, [table], as_json, out, figures, scene, curves)


def _check(sampling, samples):
    if samples is None and sampling is not Sampling.sobol:
        raise CommandError(f"--sampling {sampling}: has no meaning without --samples")
    if samples is not None and samples < 1:
        raise CommandError(f"--samples {samples}: must be >= 1")


def start_devices(wanted: int | None) -> None:
    """Let JAX see as many devices as this process may use cores; before its first operation.

    Raises:
        CommandError: fewer than one.
    """
    import jax

    if wanted is not None and wanted < 1:
        raise CommandError(f"--devices {wanted}: must be >= 1")
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
    """Values or distributions of the variables, in SI units.

    Raises:
        CommandError, SceneError, BadInput: an unknown jc.design.variable, or values that cannot be read.
    """
    design, axes = jc.machine.machine_of(scene), {}
    for name, text in jc.design.by_name(design, assignments(texts, "--over")).items():
        option, one = f"--over {name}={text}", jc.design.variable(design, name)
        axes[name] = _axis(text, one.unit, option, sampled)
        ends = axes[name].ends if sampled else (float(min(axes[name])), float(max(axes[name])))
        for end in ends:
            if not bool(one.bound.holds(end)):
                raise CommandError(f"{option}: must be {one.bound} {one.unit}".rstrip())
    return axes


def _axis(text: str, unit: str, option: str, sampled: bool):
    kind, colon, rest = text.partition(":")
    kind = kind.strip()
    if colon and kind in ("log", "normal"):
        text = rest
    else:
        kind = ""
    parts = text.split(":")
    read = [part.strip() for part in parts]
    if sampled:
        if len(parts) != 2:
            raise CommandError(
                f"{option}: must have the form from:to, log:from:to or normal:mean:deviation with "
                "--samples"
            )
        made = {
            "": jc.sweeping.uniform,
            "log": jc.sweeping.log_uniform,
            "normal": jc.sweeping.normal,
        }[kind]
        return _made(made, option, *(_number(part, unit, option) for part in with_one_unit(read)))
    if kind == "normal":
        raise CommandError(f"{option}: needs --samples")
    if len(parts) == 1 and not kind:
        values = [_number(part, unit, option) for part in with_one_unit(text.split(","))]
        if len(set(values)) < len(values):
            raise CommandError(f"{option}: must not repeat a value")
        return values
    if len(parts) != 3 or not read[2].isdigit():
        raise CommandError(
            f"{option}: must have the form from:to:count, log:from:to:count or a,b,c"
        )
    ends = (_number(part, unit, option) for part in with_one_unit(read[:2]))
    return _made(jc.sweeping.log_grid if kind else jc.sweeping.grid, option, *ends, int(read[2]))


def _made(kind, option, *numbers):
    try:
        return kind(*numbers)
    except ValueError as error:
        raise CommandError(f"{option}: {error}") from None


def _number(text: str, unit: str, option: str) -> float:
    try:
        return float(jc.scene.to_si(float(text), unit, option))
    except ValueError:
        return float(jc.scene.to_si(text, unit, option))


# Designs up to which JSON has all of them; a table has a row each up to the second.
_IN_JSON = 10_000
_ROWS = 40
_SHARES = (5, 50, 95)


def sweep_result(found, scene: str, out: Path | None) -> dict[str, Any]:
    """The answer in SI units, with all designs if they are few."""
    ok = found["ok"].values
    few = ok.size <= _IN_JSON
    variables = [str(name) for name in found.coords if name != "sample"]
    quantities = [str(name) for name in found.data_vars if name != "ok"]

    def variable(values):
        low, high = values.values.min(), values.values.max()
        listed = values.values if few else None
        return {"unit": values.attrs["units"], "low": low, "high": high, "values": listed}

    return plain(
        {
            "scene": scene,
            "dimensions": list(map(str, found["ok"].dims)),
            "shape": ok.shape,
            "designs": ok.size,
            "failed": ok.size - ok.sum(),
            "variables": {name: variable(found[name]) for name in variables},
            "quantities": {name: _quantity(found, name, few) for name in quantities},
            "ok": ok if few else None,
            "store": None if out is None else str(out / "sweep.zarr"),
        }
    )


def _quantity(found, name: str, few: bool) -> dict[str, Any]:
    import numpy as np

    data, attributes = found[name].values, found[name].attrs
    good = data[np.isfinite(data)]
    ranked = attributes["better"] in ("more", "less")
    curve = None
    if ranked and data.ndim == 2 and found[name].dims != ("sample",):
        best = jc.sweeping.best_curve(found, name)
        rows = zip(best.across, best.along, best.between, best.value, strict=True)
        keys = ("across", "best", "between", "value")
        along, across = map(str, found[name].dims)
        points = [dict(zip(keys, row, strict=True)) for row in rows]
        curve = {"along": along, "across": across, "points": points}
    statistics: dict[str, Any] = dict.fromkeys(
        ("lowest", "highest", "mean", "deviation", "percentiles")
    )
    if good.size:
        levels = np.percentile(good, _SHARES)
        statistics = {
            "lowest": good.min(),
            "highest": good.max(),
            "mean": good.mean(),
            "deviation": good.std(),
            "percentiles": dict(zip(map(str, _SHARES), levels, strict=True)),
        }
    return {
        "unit": attributes["units"],
        "better": attributes["better"],
        **statistics,
        "best": jc.sweeping.best_design(found, name) if ranked else None,
        "best_curve": curve,
        "values": data if few else None,
    }


def sweep_columns(found) -> dict[str, Any]:
    """Every design with its quantities, by name and unit."""
    from .._results import with_unit

    columns = {}
    for name in (str(name) for name in (*found.coords, *found.data_vars)):
        whole = found[name].broadcast_like(found["ok"]).transpose(*found["ok"].dims)
        columns[with_unit(name, found[name].attrs.get("units", ""))] = whole.values.ravel()
    return columns


def sweep_tables(found, result: dict[str, Any]):
    """Ranges and best designs of the quantities, and the curve or the best curve where there is one."""
    failed = f", {result['failed']:,} failed" if result["failed"] else ""
    yield _summary(found, result, f"{result['scene']}: {result['designs']:,} designs{failed}")
    if result["failed"] == result["designs"]:
        yield f"No design has a result; `jaxcomp run {result['scene']}` states why one fails.\n"
        return
    dims = found["ok"].dims
    if len(dims) == 1 and dims[0] != "sample" and found["ok"].size <= _ROWS:
        names = [*result["variables"], *result["quantities"]]
        looks = [jc.sweeping.shown_column(found, name) for name in names]
        rows = zip(*(found[name].values.tolist() for name in names), strict=True)
        yield _numbers(looks, (map(_cell, looks, row) for row in rows))
    for name, entry in result["quantities"].items():
        if entry["best_curve"] is not None and len(entry["best_curve"]["points"]) <= _ROWS:
            yield _curve_table(found, name, entry["best_curve"])


def _summary(found, result, title):
    looks = {
        name: jc.sweeping.shown_column(found, name)
        for name in (*result["variables"], *result["quantities"])
    }
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


def _curve_table(found, name, curve):
    names = (curve["across"], curve["along"], name)
    across, along, value = (jc.sweeping.shown_column(found, name) for name in names)
    tried = found[curve["along"]].values
    ends = (tried.min(), tried.max())
    rows = []
    for point in curve["points"]:
        best = _cell(along, point["best"])
        best += " (end of the range)" if point["best"] in ends else ""
        rows.append((_cell(across, point["across"]), best, _cell(value, point["value"])))
    best = along._replace(words=f"Best {along.words[:1].lower()}{along.words[1:]}")
    return _numbers((across, best, value), rows)


def _numbers(looks, rows):
    table = row_table(None, [look.label for look in looks], map(tuple, rows))
    table.columns[0].justify = "right"
    return table


def _cell(look, value) -> str:
    known = value is not None and math.isfinite(value)
    return f"{value * look.factor:.5g}" if known else "failed"
