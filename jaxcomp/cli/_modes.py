"""`jaxcomp modes`: natural frequencies, damping, critical speeds and the Campbell diagram."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

import jaxcomp as jc

from .._shown import RPM, rounded
from ._arguments import assignments, changed_scene
from ._errors import CommandError, reports_errors
from ._json import plain
from ._options import AsJson, Machine, Out, Sets
from ._output import hand_out
from ._rotor import Speed, Speeds, header, points_and_range, pull_row, rotor_of, whirl
from ._start import start_jax
from ._tables import row_table

if TYPE_CHECKING:
    import numpy as np

    from ..rotor import DampedModes, RotorModel
    from ..scene import Scene

# Damping above which no response has a peak.
_NO_PEAK = math.sqrt(0.5)


@reports_errors
def modes(
    machine: Machine,
    sets: Sets = None,
    speed: Speed = None,
    speeds: Speeds = None,
    count: Annotated[int, typer.Option(help="Number of modes.")] = 12,
    free: Annotated[
        bool,
        typer.Option("--free", help="Without bearings, mounts and magnetic pull (free-free)."),
    ] = False,
    overdamped: Annotated[
        bool,
        typer.Option("--overdamped", help="Show modes with a damping above 70 % as well."),
    ] = False,
    undamped: Annotated[bool, typer.Option("--undamped", help="Without damping.")] = False,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Find the modes of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp modes hermetic-68cc --speeds 300rpm:6000rpm:60 --out result[/bold]
    """
    from .._waits import spinner

    if free and ":" in (speeds or ""):
        raise CommandError("--free: has no Campbell diagram here; leave out --speeds")
    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    points, range_ = points_and_range(scene, speed, speeds)
    model = rotor_of(scene, *(() if free else (points, range_)))
    with spinner("Solving (the first time it is compiled as well) ..."):
        result, found = modes_result(scene, model, points, count, free, not undamped)
        if range_ is not None:
            result["campbell"] = campbell_result(model, range_, count, not undamped)
    result["set"] = assignments(sets or (), "--set")

    def figures():
        shapes = jc.plot.mode_shapes(model, found[0], result)
        drawn = {"rotor": jc.plot.rotor_drawing(model), "modes": shapes}
        if "campbell" in result:
            drawn["campbell"] = jc.plot.campbell_diagram(result["campbell"])
        return drawn

    curves = modes_columns(result)
    hand_out(result, modes_tables(result, overdamped), as_json, out, figures, scene, curves)


def modes_result(
    scene: "Scene", model: "RotorModel", speeds: "np.ndarray", count: int, free: bool, damping: bool
) -> tuple[dict[str, Any], list["DampedModes"]]:
    """Modes at single speeds."""
    import numpy as np

    found = [jc.rotor.damped_modes(model, s, count, free=free, damping=damping) for s in speeds]
    tables = []
    for one in found:
        subsets = _leading_subset(model, one)
        tables.append(
            [
                {
                    "frequency": one.frequency[i],
                    "damping_ratio": one.damping_ratio[i],
                    "growth": one.eigenvalue[i].real,
                    "whirl": one.whirl[i],
                    "subset": subsets[i],
                }
                for i in np.flatnonzero(np.isfinite(np.asarray(one.eigenvalue)))
            ]
        )
    result = {
        **header(scene, model, free),
        "speeds": speeds,
        "free": free,
        "damping": damping,
        "modes": tables,
        "stable": [bool(one.stable) for one in found],
        "growth": [one.growth for one in found],
    }
    return plain(result), found


def campbell_result(
    model: "RotorModel", speeds: "np.ndarray", count: int, damping: bool
) -> dict[str, Any]:
    """Frequencies over the spin speed, and where they meet the speed itself."""
    found = jc.rotor.campbell(model, speeds, count, damping=damping)
    critical = jc.rotor.critical_speeds_between(model, speeds, count, damping=damping)
    return plain(
        {
            "speeds": speeds,
            "frequency": found.frequency,
            "damping_ratio": found.damping_ratio,
            "whirl": found.whirl,
            "critical_speeds": [
                {"speed": w, "growth": g, "damping_ratio": -g / math.hypot(g, w)}
                for w, g in zip(critical.speed, critical.growth, strict=True)
            ],
        }
    )


def modes_columns(result: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Modes at the single speeds, and along the range of a Campbell diagram, a row for each mode."""
    keys = ("frequency", "damping_ratio", "whirl")
    rows = {
        "modes": [
            (speed, number, *(mode[key] for key in keys))
            for speed, modes in zip(result["speeds"], result["modes"], strict=True)
            for number, mode in enumerate(modes, 1)
        ]
    }
    if "campbell" in result:
        found = result["campbell"]
        rows["campbell"] = [
            (speed, number, *values)
            for speed, *lists in zip(*(found[key] for key in ("speeds", *keys)), strict=True)
            for number, values in enumerate(zip(*lists, strict=True), 1)
        ]
    names = ("speed [rad/s]", "mode", "frequency [rad/s]", "damping_ratio", "whirl")
    return {
        file: dict(zip(names, zip(*table, strict=True) if table else [()] * 5, strict=True))
        for file, table in rows.items()
    }


def modes_tables(result: dict[str, Any], overdamped: bool = False) -> Iterator[Any]:
    """Modes at each speed, critical speeds, stability; strongly damped modes only on request."""
    for place in range(len(result["speeds"])):
        yield _modes(result, place, overdamped)
    if "campbell" in result:
        yield _critical(result)
    rows = [
        (
            f"At {speed * RPM:.5g} rpm",
            "stable" if stable else "[bold red]unstable",
            f"largest real part {growth:.3g} 1/s",
        )
        for speed, stable, growth in zip(
            result["speeds"], result["stable"], result["growth"], strict=True
        )
    ]
    yield row_table(None, ("Stability", "", ""), [*rows, *pull_row(result)], texts=3)


def _modes(result, s, overdamped):
    where = "without links" if result["free"] else f"at {result['speeds'][s] * RPM:.5g} rpm"
    listed = [
        (number, mode)
        for number, mode in enumerate(result["modes"][s], 1)
        if overdamped or not mode["damping_ratio"] > _NO_PEAK
    ]
    table = row_table(
        f"{result['machine']}: modes {where}",
        ("Mode", "Hz", "rpm", "Damping, %", "Whirl", "Moves most"),
        (
            (
                number,
                *_frequency(mode["frequency"]),
                f"{100 * mode['damping_ratio']:.3g}",
                whirl(mode["whirl"]),
                escape(mode["subset"]),
            )
            for number, mode in listed
        ),
    )
    hidden = len(result["modes"][s]) - len(listed)
    if hidden:
        table.caption = f"{hidden} more with a damping above 70 % (--overdamped shows them)"
    return table


def _critical(result):
    every = result["campbell"]["critical_speeds"]
    listed = [one for one in every if not one["damping_ratio"] > _NO_PEAK]
    rows = []
    for one in listed:
        hertz, rpm = _frequency(one["speed"])
        rows.append((rpm, hertz, f"{100 * one['damping_ratio']:.3g}"))
    table = row_table("Critical speeds", ("rpm", "Hz", "Damping, %"), rows)
    if len(listed) < len(every):
        hidden = len(every) - len(listed)
        table.caption = f"{hidden} more with a damping above 70 %, which gives no peak"
    return table


def _frequency(value: float) -> tuple[str, str]:
    """In Hz and in rpm."""
    return f"{value / (2 * math.pi):.5g}", rounded(value * RPM, 5)


def _leading_subset(model, modes):
    """Name of the subset that moves most."""
    import numpy as np

    names, words = jc.rotor.node_names(model), jc.rotor.subset_names(model)
    groups = [np.array([names.index(n) for n in group]) for group in jc.rotor.subsets(model)]
    size = np.abs(np.asarray(modes.shape))[..., :2].max(-1)
    return [
        words[int(np.argmax([mode[g].max() for g in groups]))] if np.all(np.isfinite(mode)) else ""
        for mode in size
    ]
