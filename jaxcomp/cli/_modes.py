"""`jaxcomp modes`: natural frequencies of a rotor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import jaxcomp as jc

from .._core.declared import tree_of
from .._core.display import RPM, rounded
from . import _options as opt
from ._output import Output, header
from ._rotor import points_and_range, pull_row, rotor_of, whirl
from ._start import CommandError, waiting
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
    film_speeds = () if free else (points, range_)
    model = rotor_of(scene, *film_speeds)
    with waiting():
        rotor_modes = jc.vibration.rotor_modes(
            model, points, count, over=range_, free=free, damping=not undamped
        )
    curves = {"modes": rotor_modes.columns}
    diagram = rotor_modes.campbell
    if diagram is not None:
        curves["campbell"] = lambda: tree_of(diagram.columns())

    def pictures():
        from ..plot._rotor import rotor_modes_figures

        return rotor_modes_figures(rotor_modes)

    output.emit(
        rotor_modes,
        lambda result: modes_tables(result, overdamped),
        pictures,
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
    rows = []
    hidden = 0
    for number, mode in enumerate(speed_modes, 1):
        if mode["damping_ratio"] > _NO_PEAK and not overdamped:
            hidden += 1
            continue
        rows.append(
            (
                number,
                mode["frequency"] * _HERTZ,
                rounded(mode["frequency"] * RPM, 5),
                100 * mode["damping_ratio"],
                whirl(mode["whirl"]),
                mode["subset"],
            )
        )
    caption = None
    if hidden:
        caption = f"{hidden} more with a damping above 70 % (--overdamped shows them)"
    heads = ("Mode", ("Hz", ".5g"), "rpm", ("Damping, %", ".3g"), "Whirl", "Moves most")
    return row_table(f"{result['machine']}: modes {where}", heads, rows, caption=caption)


def _critical(crossings):
    rows = []
    hidden = 0
    for crossing in crossings:
        if crossing["damping_ratio"] > _NO_PEAK:
            hidden += 1
            continue
        speed = crossing["speed"]
        rows.append((rounded(speed * RPM, 5), speed * _HERTZ, 100 * crossing["damping_ratio"]))
    caption = None
    if hidden:
        caption = f"{hidden} more with a damping above 70 %, which gives no peak"
    heads = ("rpm", ("Hz", ".5g"), ("Damping, %", ".3g"))
    return row_table("Critical speeds", heads, rows, caption=caption)
