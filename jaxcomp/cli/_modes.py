"""`jaxcomp modes` and `update`: natural frequencies of a rotor, and its numbers fitted to some."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

import jaxcomp as jc

from .._core.display import RPM, rounded
from .._core.nested import plain
from . import _options as opt
from ._output import Output, header
from ._rotor import points_and_range, pull_row, rotor_of, whirl
from ._start import CommandError, refuse, waiting
from ._tables import Markup, row_table

_HERTZ = 1 / (2 * math.pi)
# Damping above which no response has a peak.
_NO_PEAK = math.sqrt(0.5)


def modes(
    *,
    case: opt.Case,
    speed: opt.Speed = None,
    speeds: opt.Speeds = None,
    count: int = 12,
    free: bool = False,
    overdamped: bool = False,
    undamped: bool = False,
    output: Output,
) -> None:
    """Find the modes of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp modes hermetic-68cc --speeds 300rpm:6000rpm:60 --out result[/bold]

    Args:
        count: Number of modes.
        free: Without bearings, mounts and magnetic pull (free-free).
        overdamped: Show modes with a damping above 70 % as well.
        undamped: Without damping.
    """
    if free and ":" in (speeds or ""):
        raise CommandError("--free: has no Campbell diagram here; leave out --speeds")
    scene = case.scene(once=True)
    points, range_ = points_and_range(scene, speed, speeds)
    model = rotor_of(scene, *(() if free else (points, range_)))
    with waiting():
        rotor_modes = jc.vibration.rotor_modes(
            model, points, count, over=range_, free=free, damping=not undamped
        )
    curves = {"modes": rotor_modes.columns}
    diagram = rotor_modes.campbell
    if diagram is not None:
        curves["campbell"] = lambda: plain(diagram.columns())
    output.emit(
        rotor_modes,
        lambda result: modes_tables(result, overdamped),
        lambda: jc.plot.interface.rotor_modes_figures(rotor_modes),
        scene,
        curves,
        metadata=header(scene) | case.changes,
    )


def modes_tables(result: dict[str, Any], overdamped: bool = False) -> Iterator[Any]:
    """Modes at each speed, critical speeds, stability; strongly damped modes only on request."""
    for speed, speed_modes in zip(result["speeds"], result["modes"], strict=True):
        yield _modes(result, speed, speed_modes, overdamped)
    if "campbell" in result:
        yield _critical(result["campbell"]["critical_speeds"])
    rows = []
    by_speed = zip(result["speeds"], result["stable"], result["growth"], strict=True)
    for speed, stable, growth in by_speed:
        verdict = "stable" if stable else Markup("[bold red]unstable")
        growth_text = f"largest real part {growth:.3g} 1/s"
        rows.append((f"At {speed * RPM:.5g} rpm", verdict, growth_text))
    yield row_table(None, ("Stability", "", ""), [*rows, *pull_row(result)], texts=3)


def _modes(result, speed, speed_modes, overdamped):
    where = "without links" if result["free"] else f"at {speed * RPM:.5g} rpm"
    rows = [
        (
            number,
            mode["frequency"] * _HERTZ,
            rounded(mode["frequency"] * RPM, 5),
            100 * mode["damping_ratio"],
            whirl(mode["whirl"]),
            mode["subset"],
        )
        for number, mode in enumerate(speed_modes, 1)
        if overdamped or not mode["damping_ratio"] > _NO_PEAK
    ]
    hidden = len(speed_modes) - len(rows)
    hidden_text = f"{hidden} more with a damping above 70 % (--overdamped shows them)"
    heads = ("Mode", ("Hz", ".5g"), "rpm", ("Damping, %", ".3g"), "Whirl", "Moves most")
    title = f"{result['machine']}: modes {where}"
    return row_table(title, heads, rows, caption=hidden_text if hidden else None)


def _critical(crossings):
    rows = [
        (
            rounded(crossing["speed"] * RPM, 5),
            crossing["speed"] * _HERTZ,
            100 * crossing["damping_ratio"],
        )
        for crossing in crossings
        if not crossing["damping_ratio"] > _NO_PEAK
    ]
    hidden = len(crossings) - len(rows)
    hidden_text = f"{hidden} more with a damping above 70 %, which gives no peak"
    heads = ("rpm", ("Hz", ".5g"), ("Damping, %", ".3g"))
    return row_table("Critical speeds", heads, rows, caption=hidden_text if hidden else None)


# ------------------------------------------------------------------- update
def update(
    *,
    machine: opt.Machine,
    measured: Path,
    variable: Annotated[list[str], typer.Option()],
    sets: opt.Sets = None,
    within: Annotated[str, typer.Option("--range")] = "0.5:2",
    held: bool = False,
    regularisation: float = 0.0,
    output: Output,
) -> None:
    """Fit numbers of a rotor to a modal test; `identify` does it with any other measurements as well.

    Example: [bold]jaxcomp update hermetic-68cc modes.csv --variable rotor.shafts.5.outer_diameter
    [/bold]

    Args:
        measured: CSV with a column "frequency [Hz]" and, where not the lowest ones were measured,
            "mode", counted from 1 with every pair of equal frequencies as one; or UFF with data set 55.
        variable (PATH): Numbers that get one common factor, e.g. rotor.shafts.5.young_modulus, or one
            of a list, e.g. rotor.shafts.5.outer_diameter.0. Repeatable.
        within (LOW:HIGH): Bounds of every factor.
        held: Measured in its bearings, not hanging free.
        regularisation: Penalty on the distance from the machine's values, 0 for none.
    """
    try:
        low, high = (float(part) for part in within.split(":"))
    except ValueError:
        raise CommandError(f"--range {within}: must have the form low:high") from None
    if not 0 < low < 1 < high < float("inf"):
        raise CommandError(f"--range {within}: must be positive and hold the factor 1")
    from ..scene.measured import read_measurement
    from ..scene.readings import identified_scene
    from ..study import ModalTest

    case = opt.Case(machine, sets)
    scene = case.scene(once=True)
    rotor_of(scene)
    test = read_measurement(measured, scene.machine)
    if not isinstance(test, ModalTest):
        raise CommandError(f'{measured}: must have a column "frequency [Hz]" and a line below it')
    for path in variable:
        problem = f"--variable {path}: must begin with rotor, such as rotor.shafts.0.length"
        refuse(not path.startswith("rotor."), problem)
    test = dataclasses.replace(test, free=test.free and not held)
    with waiting("Fitting (the first time it is compiled as well) ..."):
        fit = jc.study.update_rotor(scene, test, variable, (low, high), regularisation)
    fitted = identified_scene(scene, fit.identification)
    output.emit(
        fit,
        update_tables,
        lambda: {"rotor": jc.plot.interface.rotor_drawing(rotor_of(fitted))},
        fitted,
        metadata=header(scene) | case.changes,
    )


def update_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Frequencies before and after, and the fitted numbers."""
    rows = []
    for mode in result["modes"]:
        hertz = (mode[key] * _HERTZ for key in ("measured", "before", "after"))
        rows.append((mode["mode"], *hertz, f"{100 * mode['error']:.2g} %"))
    heads = ("Mode", ("Measured", ".5g"), ("Before", ".5g"), ("After", ".5g"), "Error")
    yield row_table(f"{result['machine']}: natural frequencies in Hz", heads, rows)
    fitted = [
        (row["path"], f"{row['factor']:.5g}", row["at_bound"] and "at its bound")
        for row in result["variables"]
    ]
    status = "converged" if result["converged"] else Markup("[bold red]not converged")
    solver = ("Solver", status, f"{result['steps']} steps")
    yield row_table(None, ("Fitted", "Factor", ""), [*fitted, solver], texts=3)
