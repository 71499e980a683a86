"""Tables of `jaxcomp respond` and `jaxcomp modes`."""

import math
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from .._shown import rounded
from ._tables import _table

_RPM = 30 / math.pi
# Below this share of backward or forward motion an orbit is called a line.
_LINE = 0.05
# Damping above which no response has a peak.
_NO_PEAK = math.sqrt(0.5)


def response_tables(result: dict[str, Any]) -> list[Table]:
    """Orbits of the watched nodes, mount forces, peaks of the curves, evidence."""
    tables = [_orbits(result, s) for s in range(len(result["speeds"]))]
    tables.append(_links(result))
    if "curves" in result:
        tables.append(_peaks(result))
    table = _table(None, "Evidence", "", "")
    table.add_row("Solver", result["status"], f"last correction {result['correction']:.1e}")
    _side_pull(table, result)
    return [*tables, table]


def modes_tables(result: dict[str, Any], overdamped: bool = False) -> list[Table]:
    """Modes at each speed, critical speeds, stability; strongly damped modes where they are asked for."""
    tables = [_modes(result, s, overdamped) for s in range(len(result["speeds"]))]
    if "campbell" in result:
        tables.append(_critical(result))
    table = _table(None, "Evidence", "", "")
    for speed, stable, growth in zip(
        result["speeds"], result["stable"], result["growth"], strict=True
    ):
        word = "stable" if stable else "[bold red]unstable"
        table.add_row(
            f"At {speed * _RPM:.5g} rpm", word, f"largest real part {growth:.3g} 1/s"
        )  # fmt: skip
    _side_pull(table, result)
    return [*tables, table]


def _orbits(result, s):
    rpm = result["speeds"][s] * _RPM
    title = f"{result['machine']} at {rpm:.5g} rpm: amplitudes and half axes in µm, velocity in mm/s rms"
    columns = ("Node", "n", "x", "y", "Major", "Minor", "Whirl", "mm/s")
    table = _table(escape(title), *columns, numbers=True)
    table.columns[0].no_wrap = table.columns[6].no_wrap = True
    table.columns[6].min_width = len("backward")
    for name, motion in result["nodes"].items():
        for n, order in enumerate(result["orders"]):
            x, y = (motion["amplitude"][a][n][s] for a in ("ux", "uy"))
            major, minor = motion["major_axis"][n][s], motion["minor_axis"][n][s]
            w = order * result["speeds"][s]
            table.add_row(
                escape(name) if n == 0 else "",
                str(order),
                *(_short(v * 1e6) for v in (x, y, major, abs(minor))),
                _whirl(minor / major if major else 0.0),
                _short(1e3 * w * math.hypot(x, y) / math.sqrt(2)),
            )
    return table


def _short(value: float) -> str:
    """Three digits in five characters, so that the table fits a narrow terminal; JSON has all."""
    if not value >= 0.01:
        return "<0.01" if value > 0 else "0"
    return f"{value:.3g}" if value >= 0.1 else f"{value:.3f}"


def _links(result):
    table = _table(None, "Link, N and N m", "n", "rpm", *result["axes"], numbers=True)
    table.columns[0].no_wrap = True
    for name, axes in result["links"].items():
        for n, order in enumerate(result["orders"]):
            for s, speed in enumerate(result["speeds"]):
                values = [f"{axes[a][n][s]:.4g}" if a in axes else "" for a in result["axes"]]
                first = escape(name) if n == s == 0 else ""
                table.add_row(first, str(order), f"{speed * _RPM:.5g}", *values)
    return table


def _peaks(result):
    curves = result["curves"]
    rpm = np.array(curves["speeds"]) * _RPM
    title = f"Largest major axis from {rpm[0]:.5g} to {rpm[-1]:.5g} rpm"
    table = _table(title, "Node", "n", "µm", "at rpm", numbers=True)
    table.columns[0].no_wrap = True
    for name, orders in curves["major_axis"].items():
        for n, order in enumerate(result["orders"]):
            values = np.array([np.nan if v is None else v for v in orders[n]])
            if np.all(np.isnan(values)):
                continue
            at = int(np.nanargmax(values))
            first = escape(name) if n == 0 else ""
            table.add_row(first, str(order), f"{values[at] * 1e6:.4g}", f"{rpm[at]:.5g}")
    return table


def _modes(result, s, overdamped):
    where = "without links" if result["free"] else f"at {result['speeds'][s] * _RPM:.5g} rpm"
    columns = ("Mode", "Hz", "rpm", "Damping, %", "Whirl", "Moves most")
    table = _table(escape(f"{result['machine']}: modes {where}"), *columns, numbers=True)
    hidden = 0
    for i, mode in enumerate(result["modes"][s]):
        w = mode["frequency"]
        if mode["damping_ratio"] > _NO_PEAK and not overdamped:
            hidden += 1
            continue
        table.add_row(
            str(i + 1),
            f"{w / (2 * math.pi):.5g}",
            rounded(w * _RPM, 5),
            f"{100 * mode['damping_ratio']:.3g}",
            _whirl(mode["whirl"]),
            escape(mode["subset"]),
        )
    if hidden:
        table.caption = f"{hidden} more with a damping above 70 % (--overdamped shows them)"
    return table


def _critical(result):
    table = _table("Critical speeds", "rpm", "Hz", "Damping, %", numbers=True)
    hidden = 0
    for one in result["campbell"]["critical_speeds"]:
        if one["damping_ratio"] > _NO_PEAK:
            hidden += 1  # no response has a peak there
            continue
        w = one["speed"]
        cells = (
            rounded(w * _RPM, 5),
            f"{w / (2 * math.pi):.5g}",
            f"{100 * one['damping_ratio']:.3g}",
        )
        table.add_row(*cells)
    if hidden:
        table.caption = f"{hidden} more with a damping above 70 %, which gives no peak"
    return table


def _side_pull(table, result):
    if result["side_pull_limit"] is not None:
        table.add_row("Side pull", f"{result['side_pull_limit']:.4g}", "times it is unstable")


def _whirl(share: float) -> str:
    if abs(share) < _LINE:
        return "plane"
    return "forward" if share > 0 else "backward"
