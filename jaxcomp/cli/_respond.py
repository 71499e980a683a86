"""`jaxcomp respond`: harmonic response of rotor, crankcase and housing to unbalances and forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jaxcomp as jc

from .._core.declared import tree_of
from .._core.display import RPM
from . import _options as opt
from ._output import Output, header
from ._rotor import chosen_excitation, points_and_range, pull_row, rotor_of, whirl
from ._start import CommandError, refuse_unknown, waiting
from ._tables import number_heads, row_table

# Orders of the crank's forces that are shown if none are named; those above are small.
_OF_CRANK = (1, 2, 3, 4)
_EXCITED = {
    "file": "unbalances and forces of the machine",
    "crank": "unbalances and the crank's periodic state at each speed",
}


def respond(
    *,
    case: opt.Case,
    speed: opt.Speed = None,
    speeds: opt.Speeds = None,
    orders: str | None = None,
    node: list[str] | None = None,
    excitation: opt.ExcitationOption = None,
    solver: opt.Solver = "collocation",
    output: Output,
) -> None:
    """Find the vibration of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp respond hermetic-68cc --speed 3000rpm --speeds 300rpm:6000rpm:200 --out
    result[/bold]

    Args:
        orders (N,N,...): Orders of the speed; all that are loaded if absent.
        node: Node to report; the target planes (or all) if absent. Repeatable.
    """
    scene = case.scene(once=True)
    from ..rotor._nodes import node_names
    from ..rotor._response import SingularResponse

    names = set(map(str, node_names(rotor_of(scene))))
    for name in node or ():
        refuse_unknown(f"--node {name}", name, names, "node")
    loads = scene.parts.get("loads")
    shaken_by = chosen_excitation(scene, excitation)
    by_crank = shaken_by == "crank"
    if not isinstance(loads, jc.rotor.LoadCase) or not (loads.loads or by_crank):
        raise CommandError(f"{scene.file}: loads: is missing; nothing excites this rotor")
    shown_orders = whole_orders(orders, None if by_crank else loads.loads)
    points, range_ = points_and_range(scene, speed, speeds)
    crank_solver = opt.chosen_solver(solver, scene)
    with waiting():
        try:
            motion = jc.vibration.rotor_motion(
                scene,
                points,
                shown_orders,
                nodes=node or (),
                over=range_,
                excitation=shaken_by,
                crank_solver=crank_solver,
            )
        except SingularResponse as error:
            raise CommandError(f"{scene.file}: {error}") from None
    curves = {"response": motion.columns}
    over = motion.curves
    if over is not None:
        curves["curves"] = lambda: tree_of(over.columns())

    def pictures():
        from ..plot._rotor import rotor_motion_figures

        return rotor_motion_figures(motion)

    output.emit(
        motion,
        response_tables,
        pictures,
        scene,
        curves,
        metadata={**header(scene), "excitation": shaken_by, **case.changes},
    )


def whole_orders(text: str | None, loads: Sequence | None) -> tuple[int, ...]:
    """The orders of `--orders`, all that are loaded but the mean, or without loads those of the crank."""
    if text is None:
        if loads is None:
            return _OF_CRANK
        from ..vibration._machine import excited_orders

        return excited_orders(tuple(loads))
    orders = []
    for word in map(str.strip, text.split(",")):
        if not word.isdigit() or int(word) == 0:
            raise CommandError(f'--orders {text}: must be whole numbers above zero, such as "1,2"')
        orders.append(int(word))
    return tuple(dict.fromkeys(orders))


def response_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Orbits of the watched nodes, mount forces, peaks of the curves, convergence."""
    for place in range(len(result["speeds"])):
        yield _orbits(result, place)
    rows = []
    for begin, axes, n, s in _each(result, result["links"]):
        row = [*begin]
        for axis in result["axes"]:
            # a link has forces along its own axes alone
            row.append(axes[axis][n][s] if axis in axes else None)
        rows.append(row)
    heads = ("Link, N and N m", "n", "rpm", *number_heads(".4g", *result["axes"]))
    yield row_table(None, heads, rows, unbroken=(0,))
    if "linearised" in result:
        yield from _linearised(result, result["linearised"])
    if "curves" in result:
        yield _peaks(result)
    solver = ("Solver", result["status"], f"last correction {result['correction']:.1e}")
    shaken = ("Excitation", result["excitation"], _EXCITED[result["excitation"]])
    yield row_table(None, ("Convergence", "", ""), [shaken, solver, *pull_row(result)], texts=3)


def _each(result: dict[str, Any], by_name: Mapping[str, Any]) -> Iterator[Any]:
    """((name, order, rpm) as cells, value, place of the order, of the speed) of every row."""
    for name, value in by_name.items():
        for n, order in enumerate(result["orders"]):
            for s, speed in enumerate(result["speeds"]):
                first = name if n == s == 0 else ""
                yield (first, order, f"{speed * RPM:.5g}"), value, n, s


def _orbits(result, s):
    speed = result["speeds"][s]
    rows = []
    for name, motion in result["nodes"].items():
        for n, order in enumerate(result["orders"]):
            x = motion["amplitude"]["ux"][n][s]
            y = motion["amplitude"]["uy"][n][s]
            major = motion["major_axis"][n][s]
            minor = motion["minor_axis"][n][s]
            velocity = order * speed * math.hypot(x, y) / math.sqrt(2)
            micrometres = (_short(size * 1e6) for size in (x, y, major, abs(minor)))
            direction = whirl(0.0)
            if major:
                direction = whirl(minor / major)
            first = name if n == 0 else ""
            rows.append((first, order, *micrometres, direction, _short(1e3 * velocity)))
    title = (
        f"{result['machine']} at {speed * RPM:.5g} rpm: amplitudes and half axes in µm, velocity in "
        "mm/s rms"
    )
    heads = ("Node", "n", "x", "y", "Major", "Minor", "Whirl", "mm/s")
    table = row_table(title, heads, rows, unbroken=(0, 6))
    table.columns[6].min_width = len("backward")
    return table


def _short(value: float) -> str:
    """Three digits in five characters, so that the table fits a narrow terminal; JSON has all."""
    if value >= 0.1:
        return f"{value:.3g}"
    if value >= 0.01:
        return f"{value:.3f}"
    if value > 0:
        return "<0.01"
    return "0"


def _linearised(result, linearisations):
    """Vibration and films with the films linearised at their mean load and along the orbits."""
    rows = []
    names = result["nodes"]
    for begin, name, n, s in _each(result, dict(zip(names, names, strict=True))):
        at_mean = linearisations["mean_load"]["major_axis"][name][n][s]
        on_orbit = linearisations["orbit"]["major_axis"][name][n][s]
        change = ""
        if at_mean:
            change = f"{100 * (on_orbit / at_mean - 1):+.2g}"
        rows.append((*begin, _short(1e6 * at_mean), _short(1e6 * on_orbit), change))
    title = "Major axis in µm with the films linearised at their mean load, or along their orbits"
    heads = ("Node", "n", "rpm", "Mean load", "Orbit", "Change, %")
    yield row_table(title, heads, rows, unbroken=(0,))
    rows = []
    for name in linearisations["orbit"]["films"]:
        for place, words in (("mean_load", "mean load"), ("orbit", "orbit")):
            film = linearisations[place]["films"][name]
            (kxx, kxy), (kyx, kyy) = film["stiffness"][0]
            (cxx, _), (_, cyy) = film["damping"][0]
            stiffness = (1e-6 * k for k in (kxx, kxy, kyx, kyy))
            first = name if place == "mean_load" else ""
            rows.append((first, words, *stiffness, 1e-3 * cxx, 1e-3 * cyy))
    numbers = number_heads(".3g", "kxx", "kxy", "kyx", "kyy", "cxx", "cyy")
    yield row_table(None, ("Film, MN/m, kN s/m", "At", *numbers), rows, texts=2)


def _peaks(result):
    speeds = result["curves"]["speeds"]
    rows = []
    for name, orders in result["curves"]["major_axis"].items():
        for n, order in enumerate(result["orders"]):
            solved = []
            for major, speed in zip(orders[n], speeds, strict=True):
                if major is not None:  # where there is a response
                    solved.append((major, speed))
            if solved:
                largest, at = max(solved)
                rows.append((name if n == 0 else "", order, largest * 1e6, at * RPM))
    title = f"Largest major axis from {speeds[0] * RPM:.5g} to {speeds[-1] * RPM:.5g} rpm"
    return row_table(title, ("Node", "n", ("µm", ".4g"), ("at rpm", ".5g")), rows, unbroken=(0,))
