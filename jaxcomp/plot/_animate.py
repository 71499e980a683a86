"""The mechanism over one revolution, with its forces as arrows, for both drives.

Drawn to scale: crank circle, rod or link, bore and, with a polytropic cycle, the clearance. Assumed
is what no model has: the length of the piston, the size of pins. The frames are even in time, so that
the crank hurries and lags as it does. All arrows of a picture have the same scale; they are the forces
of gas and wall on the piston, of the piston and the crank on the rod, of the bearings on the crank,
and of the slider on its link.
"""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from .._shown import RPM
from ..compressor import Compressor
from ..crank import Orbit
from ..mechanism import SliderCrank, SliderLink
from ._fine import FineTurn, fine_turn
from ._motion import Motion
from ._several import cylinders_motion
from ._style import INK, colour, crank_axis, legend_above, new_figure, over_turn, words, ylabel

_CRANK, _ROD, _WALL = "#444444", "#7A8B9C", "#888888"
_GAS_ARROW = "gas"
_GAS_TINT = "#B8860B"  # its own colour here, because the wall has that of the gas elsewhere


class Arrow(NamedTuple):
    """A force at a place.

    Attributes:
        place: [m] (2,) of its foot.
        force: [N] (2,)
    """

    place: np.ndarray
    force: np.ndarray


class Sketch(NamedTuple):
    """The mechanism at one instant.

    Attributes:
        lines: [m] (2, n) polygons and lines by name.
        arrows: forces by name.
    """

    lines: dict[str, np.ndarray]
    arrows: dict[str, Arrow]


def mechanism_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of the periodic state: mechanism and forces above, magnitudes below.

    Args:
        compressor: with a slider-crank or a slider-link.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.

    Several cylinders are shown from the front and the side, see `cylinders_motion`.
    """
    if compressor.cylinders is not None:
        return cylinders_motion(compressor, orbit, frames)
    turn = fine_turn(compressor, orbit)
    angles = _even_in_time(turn, frames)
    sketches = [sketch(compressor, turn, angle) for angle in angles]
    largest = max(float(np.hypot(*a.force)) for s in sketches for a in s.arrows.values())
    mechanism: Any = compressor.mechanism
    reach = 2.2 * float(mechanism.crank_radius)  # [m] of the largest arrow
    unit, scale = ("kN", 1e3) if largest >= 1e3 else ("N", 1.0)

    figure, axes = new_figure(2, 1, (8.0, 6.0), "One revolution with its forces", share=False)
    above, below = axes[:, 0]
    above.set_aspect("equal")
    above.set_axis_off()
    drawn = {name: above.plot(*line, **_look(name))[0] for name, line in sketches[0].lines.items()}
    tips = {
        name: above.annotate("", (0, 0), (0, 0), zorder=6, arrowprops={
            "arrowstyle": "-|>", "color": _tint(name, i), "linewidth": 2.2, "shrinkA": 0, "shrinkB": 0,
        })
        for i, name in enumerate(sketches[0].arrows)
    }  # fmt: skip
    _limits(above, sketches, reach)
    told = above.text(0.0, 1.0, "", transform=above.transAxes, fontsize=9, color=INK, va="top")
    mark = _magnitudes(below, turn, compressor, tips, scale, unit)

    def show(frame: int) -> None:
        now = sketches[frame % frames]
        for name, line in now.lines.items():
            drawn[name].set_data(*line)
        for name, arrow in now.arrows.items():
            tip = arrow.place + reach / largest * arrow.force
            tips[name].set_position(tuple(arrow.place))
            tips[name].xy = tuple(tip)
            small = np.hypot(*arrow.force) < 0.01 * largest
            tips[name].set_visible(not small)
        degrees = (np.rad2deg(angles[frame % frames]) + 180) % 360 - 180
        speed = np.interp(angles[frame % frames], turn.state.angle, turn.state.speed)
        told.set_text(
            f"{round(degrees):d}° from top dead centre, {speed * RPM:.0f} rpm; "
            f"the longest arrow is {largest / scale:.3g} {unit}"
        )
        mark.set_xdata([degrees, degrees])

    show(0)
    return Motion(figure, show, frames)


def sketch(compressor: Compressor, turn: FineTurn, angle: float) -> Sketch:
    """The mechanism at a crank angle [rad], with the forces of the revolution there.

    Raises:
        TypeError: a mechanism that nobody has drawn yet.
    """
    forces = {
        name: np.array([np.interp(angle, turn.state.angle, component) for component in force])
        for name, force in turn.loads.forces.items()
    }
    mechanism = compressor.mechanism
    position = float(mechanism.piston(np.asarray(angle))[0])
    gas = np.zeros(2)
    if compressor.gas is not None and turn.pressure is not None:
        excess = np.interp(angle, turn.state.angle, turn.pressure)
        excess = excess - float(compressor.gas.behind_piston)
        gas[0] = -excess * float(mechanism.piston_area)
    if isinstance(mechanism, SliderCrank):
        return _slider_crank(mechanism, angle, position, forces, gas)
    if isinstance(mechanism, SliderLink):
        return _slider_link(mechanism, angle, position, forces, gas)
    raise TypeError(f"There is no drawing of a mechanism of type {type(mechanism).__name__}.")


def _slider_crank(m: SliderCrank, angle, position, forces, gas) -> Sketch:
    radius, bore, e = float(m.crank_radius), float(m.bore), float(m.offset)
    pin = radius * np.array([np.cos(angle), np.sin(angle)])
    piston = np.array([position, e])
    top, bottom = (float(x) for x in m.piston_extremes())
    crown, skirt = 0.45 * bore, 0.4 * bore  # from the piston pin; assumed
    lines = {
        "cylinder": _cylinder(bottom - skirt, top + crown, bore, e),
        "circle": _circle(radius),
        "piston": _box(position - skirt, position + crown, bore, e),
        "crank": np.stack([np.zeros(2), pin], 1),
        "rod": np.stack([pin, piston], 1),
        "pins": np.stack([np.zeros(2), pin, piston], 1),
    }
    return Sketch(lines, {
        _GAS_ARROW: Arrow(np.array([position + crown, e]), gas),
        "wall": Arrow(piston, forces["wall"]),
        "piston_pin": Arrow(piston, forces["piston_pin"]),
        "crank_pin": Arrow(pin, forces["crank_pin"]),
        "main_journal": Arrow(np.zeros(2), forces["main_journal"]),
    })  # fmt: skip


def _slider_link(m: SliderLink, angle, position, forces, gas) -> Sketch:
    radius, bore, e = float(m.crank_radius), float(m.bore), -float(m.offset)
    pin = radius * np.array([np.cos(angle), np.sin(angle)])
    top, _ = (float(x) for x in m.piston_extremes())
    edge = top - float(m.cylinder_length)
    size = float(m.slider_diameter) or 0.5 * radius
    lines = {
        "cylinder": _cylinder(edge, top, bore, -e),
        "circle": _circle(radius),
        "piston": _box(pin[0] + 0.8 * size, position, bore, -e),
        "link": _box(pin[0] - 0.65 * size, pin[0] + 0.65 * size, 2 * radius + 2.4 * size, 0.0),
        "slider": np.array([pin[0], pin[1]])[:, None] + _box(-size / 2, size / 2, size, 0.0),
        "stem": np.array([[pin[0] + 0.65 * size, pin[0] + 0.8 * size], [-e, -e]]),
        "crank": np.stack([np.zeros(2), pin], 1),
        "pins": np.stack([np.zeros(2), pin], 1),
    }
    return Sketch(lines, {
        _GAS_ARROW: Arrow(np.array([position, -e]), gas),
        "wall_crown": Arrow(np.array([position, -e]), forces["wall_crown"]),
        "wall_edge": Arrow(np.array([edge, -e]), forces["wall_edge"]),
        "link_slider": Arrow(pin, forces["link_slider"]),
        "upper_bearing": Arrow(np.zeros(2), forces["upper_bearing"]),
        "lower_bearing": Arrow(np.zeros(2), forces["lower_bearing"]),
    })  # fmt: skip


def _even_in_time(turn: FineTurn, frames: int) -> np.ndarray:
    """[rad] Crank angles at even times from the top dead centre."""
    angle, speed = np.asarray(turn.state.angle), np.asarray(turn.state.speed)
    time = np.concatenate([[0.0], np.cumsum(np.diff(angle) * (1 / speed[1:] + 1 / speed[:-1]) / 2)])
    return np.interp(time[-1] * np.arange(frames) / frames, time, angle)


def _magnitudes(ax: Axes, turn: FineTurn, compressor, tips, scale, unit):
    """Magnitudes over the revolution, in the colours of the arrows; returns the mark of the instant."""
    forces = {name: np.hypot(*np.asarray(force)) for name, force in turn.loads.forces.items()}
    if compressor.gas is not None and turn.pressure is not None:
        excess = np.asarray(turn.pressure) - float(compressor.gas.behind_piston)
        forces[_GAS_ARROW] = np.abs(excess) * float(compressor.mechanism.piston_area)
    for place, name in enumerate(tips):
        if name in forces:
            degrees, size = over_turn(turn.state.angle, forces[name] / scale)
            ax.plot(degrees, size, color=_tint(name, place), linewidth=1.5, label=words(name))
    ylabel(ax, f"Force, {unit}")
    ax.set_ylim(0, None)
    crank_axis(ax)
    legend_above(ax)
    return ax.axvline(0, color=INK, linewidth=1.2)


def _limits(ax: Axes, sketches: list[Sketch], reach: float) -> None:
    points = np.concatenate([line for s in sketches for line in s.lines.values()], axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    low, high = points.min(axis=1), points.max(axis=1)
    ax.set_xlim(low[0] - 0.7 * reach, high[0] + 1.1 * reach)
    ax.set_ylim(min(low[1], -0.6 * reach) - 0.1 * reach, max(high[1], 0.6 * reach) + 0.25 * reach)


def _look(name: str) -> dict[str, Any]:
    if name == "pins":
        return {"marker": "o", "linestyle": "none", "color": INK, "markersize": 6, "zorder": 5}
    thick = {"crank": 6, "rod": 5, "cylinder": 3, "stem": 4, "circle": 0.8}.get(name, 1.6)
    tint = {"crank": _CRANK, "rod": _ROD, "cylinder": _WALL, "circle": "#BBBBBB"}.get(name, INK)
    dash = ":" if name == "circle" else "-"
    return {"color": tint, "linewidth": thick, "linestyle": dash, "solid_capstyle": "round"}


def _tint(name: str, place: int) -> str:
    return _GAS_TINT if name == _GAS_ARROW else colour(name, place)


def _box(left: float, right: float, height: float, y: float) -> np.ndarray:
    x = [left, right, right, left, left]
    half = height / 2
    return np.array([x, [y - half, y - half, y + half, y + half, y - half]])


def _cylinder(left: float, right: float, bore: float, y: float) -> np.ndarray:
    """Both walls and the head, open towards the crank."""
    half = 0.51 * bore
    return np.array([[left, right, right, left], [y - half, y - half, y + half, y + half]])


def _circle(radius: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 73)
    return radius * np.stack([np.cos(angle), np.sin(angle)])
