"""A mechanism to scale at a crank angle: its lines, and where the forces on its parts act.

Crank circle, rod or link, bore and, with a polytropic cycle, the clearance. Assumed is what no model has:
the length of the piston, the size of pins.
"""

from typing import Any, NamedTuple

import numpy as np

from .._core.each import of_cylinder
from ..compressor import Compressor
from ..crankshaft._bearings import bearing_names
from ..mechanism import SliderCrank, SliderLink
from . import _style as style
from ._fine import FineTurn


class Arrow(NamedTuple):
    """A force [N] (2,) at a place [m] (2,), that of its foot."""

    place: np.ndarray
    force: np.ndarray


class Sketch(NamedTuple):
    """The mechanism at one instant: polygons and lines [m] (2, n), and forces, by name."""

    lines: dict[str, np.ndarray]
    arrows: dict[str, Arrow]


def sketch(compressor: Compressor, turn: FineTurn, angle: float) -> Sketch:
    """The mechanism at a crank angle [rad], with the forces of the revolution there.

    Raises:
        TypeError: a mechanism that nobody has drawn yet.
    """
    forces = {"gas": np.zeros(2)}
    for name, (along, sideways) in forces_over(compressor, turn).items():
        x = np.interp(angle, turn.state.angle, along)
        y = np.interp(angle, turn.state.angle, sideways)
        forces[name] = np.array([x, y])
    lines, feet = _drawing(compressor.mechanism, angle)
    feet |= dict.fromkeys(bearing_names(compressor.crankshaft), np.zeros(2))
    arrows = {name: Arrow(place, forces[name]) for name, place in feet.items()}
    return Sketch(lines, arrows)


def front_view(compressor: Compressor, angle: float) -> dict[str, np.ndarray]:
    """The mechanisms of all cylinders as they are seen along the shaft.

    Args:
        compressor: with mechanisms that are drawn.
        angle: [rad] of the crank from the top dead centre of the first cylinder.

    Returns:
        Lines [m] (2, n) by part: y to the right and x upwards, NaN between two cylinders.

    Raises:
        TypeError: a mechanism that nobody has drawn yet.
    """
    parts: dict[str, list[np.ndarray]] = {}
    shaft = compressor.crankshaft
    banks = np.asarray(shaft.bank_angle)
    phases = np.asarray(shaft.phase)
    for number, (bank, phase) in enumerate(zip(banks, phases, strict=True), 1):
        lines, _ = _drawing(of_cylinder(compressor.mechanism, number), angle + phase)
        turn = np.array([[np.sin(bank), np.cos(bank)], [np.cos(bank), -np.sin(bank)]])
        for name, line in lines.items():
            parts.setdefault(name, []).extend([turn @ line, np.full((2, 1), np.nan)])
    return {name: np.concatenate(pieces[:-1], axis=1) for name, pieces in parts.items()}


def forces_over(compressor: Compressor, turn: FineTurn) -> dict[str, np.ndarray]:
    """[N] (2, n) Forces of the joints over the revolution, and that of the gas on the piston."""
    forces = {name: np.asarray(force) for name, force in turn.loads.forces.items()}
    if compressor.gas is not None and turn.pressure is not None:
        excess = np.asarray(turn.pressure[0]) - float(compressor.gas.behind_piston)
        push = -excess * float(compressor.mechanism.piston_area)
        forces["gas"] = np.stack([push, np.zeros_like(push)])
    return forces


def slider_crank_lines(m: SliderCrank, angle: float):
    """Lines of a mechanism, and where the forces on its parts act, [m]."""
    radius = float(m.crank_radius)
    bore = float(m.bore)
    e = float(m.offset)
    position = float(m.piston(np.asarray(angle))[0])
    centre = np.zeros(2)
    pin = radius * np.array([np.cos(angle), np.sin(angle)])
    piston = np.array([position, e])
    highest, lowest = m.piston_extremes()
    top = float(highest)
    bottom = float(lowest)
    # from the piston pin; assumed
    crown = 0.45 * bore
    skirt = 0.4 * bore
    lines = {
        "cylinder": _cylinder(bottom - skirt, top + crown, bore, e),
        "circle": _circle(radius),
        "piston": _box(position - skirt, position + crown, bore, e),
        "crank": np.stack([centre, pin], 1),
        "rod": np.stack([pin, piston], 1),
        "pins": np.stack([centre, pin, piston], 1),
    }
    feet = {
        "gas": np.array([position + crown, e]),
        "wall": piston,
        "piston_pin": piston,
        "crank_pin": pin,
    }
    return lines, feet


def slider_link_lines(m: SliderLink, angle: float):
    """Lines of a mechanism, and where the forces on its parts act, [m]."""
    radius = float(m.crank_radius)
    bore = float(m.bore)
    y = float(m.offset)
    position = float(m.piston(np.asarray(angle))[0])
    centre = np.zeros(2)
    pin = radius * np.array([np.cos(angle), np.sin(angle)])
    top = float(m.piston_extremes()[0])
    edge = top - float(m.cylinder_length)
    size = float(m.slider_diameter) or 0.5 * radius
    near = pin[0] + 0.65 * size
    far = pin[0] + 0.8 * size
    lines = {
        "cylinder": _cylinder(edge, top, bore, y),
        "circle": _circle(radius),
        "piston": _box(far, position, bore, y),
        "link": _box(pin[0] - 0.65 * size, near, 2 * radius + 2.4 * size, 0.0),
        "slider": pin[:, None] + _box(-size / 2, size / 2, size, 0.0),
        "stem": np.array([[near, far], [y, y]]),
        "crank": np.stack([centre, pin], 1),
        "pins": np.stack([centre, pin], 1),
    }
    feet = {
        "gas": np.array([position, y]),
        "wall_crown": np.array([position, y]),
        "wall_edge": np.array([edge, y]),
        "link_slider": pin,
    }
    return lines, feet


def _drawing(mechanism: Any, angle: float):
    """Lines of a mechanism, and where the forces on its parts act, [m]."""
    if isinstance(mechanism, SliderCrank):
        return slider_crank_lines(mechanism, angle)
    if isinstance(mechanism, SliderLink):
        return slider_link_lines(mechanism, angle)
    raise TypeError(f"There is no drawing of a mechanism of type {type(mechanism).__name__}.")


def line_look(name: str) -> dict[str, Any]:
    """Look of a part of a mechanism, as options of a line of matplotlib."""
    if name == "pins":
        return {"marker": "o", "linestyle": "", "color": style.INK, "markersize": 6, "zorder": 5}
    paint, thick = {
        "crank": ("#444444", 6),
        "rod": ("#7A8B9C", 5),
        "cylinder": (style.GREY, 3),
        "stem": (style.INK, 4),
        "circle": ("#BBBBBB", 0.8),
    }.get(name, (style.INK, 1.6))
    dash = ":" if name == "circle" else "-"
    return {"color": paint, "linewidth": thick, "linestyle": dash, "solid_capstyle": "round"}


def _box(x_low: float, x_high: float, height: float, y: float) -> np.ndarray:
    x = [x_low, x_high, x_high, x_low, x_low]
    half = height / 2
    return np.array([x, [y - half, y - half, y + half, y + half, y - half]])


def _cylinder(open_end: float, head: float, bore: float, y: float) -> np.ndarray:
    """Both walls and the head, open towards the crank."""
    half = 0.51 * bore
    return np.array([[open_end, head, head, open_end], [y - half, y - half, y + half, y + half]])


def _circle(radius: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 73)
    return radius * np.stack([np.cos(angle), np.sin(angle)])
