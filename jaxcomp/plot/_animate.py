"""Moving pictures: the mechanism of one cylinder, several cylinders on one crank, and journals.

The frames are even in time, so that the crank hurries and lags as it does. All arrows of a picture have
the same scale; those of a mechanism are the forces of gas and wall on the piston, of the piston and the
crank on the rod, of the bearings on the crank, and of the slider on its link.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from .._core.display import RPM, axes_words, shown
from .._core.each import of_cylinder
from ..compressor import Compressor
from ..crank import Orbit, journal_films
from ..crankshaft import Crankshaft, MainBearings
from ..mechanism import SliderCrank
from . import _style as style
from ._bearings import in_clearance
from ._drawing import draws
from ._fine import FineTurn, fine_turn
from ._mechanism import Sketch, forces_over, line_look, sketch, slider_crank_lines

_GAS_TINT = "#B8860B"  # its own colour here, because the wall has that of the gas elsewhere


class Motion(NamedTuple):
    """A picture that moves, and comes back to its beginning.

    Attributes:
        figure: the figure, which shows the first frame.
        show: brings the figure to a frame.
        frames: how many there are.
        rate: [1/s] frames a second.
    """

    figure: Figure
    show: Callable[[int], None]
    frames: int
    rate: int = 20


def gif(motion: Motion, dpi: int = 80) -> bytes:
    """The frames as an endless GIF.

    Args:
        motion: as `mechanism_motion` or `balance_motion` draw it.
        dpi: [1/inch] resolution.
    """
    FigureCanvasAgg(motion.figure)
    writer = PillowWriter(fps=motion.rate)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "motion.gif"
        with writer.saving(motion.figure, str(file), dpi):
            for frame in range(motion.frames):
                motion.show(frame)
                writer.grab_frame()
        return file.read_bytes()


def _even_in_time(turn: FineTurn, frames: int) -> np.ndarray:
    """[rad] Crank angles at even times from the top dead centre."""
    angle = np.asarray(turn.state.angle)
    speed = np.asarray(turn.state.speed)
    # dt = dtheta / omega by trapezoids
    time = np.concatenate([[0.0], np.cumsum(np.diff(angle) * (1 / speed[1:] + 1 / speed[:-1]) / 2)])
    return np.interp(time[-1] * np.arange(frames) / frames, time, angle)


def _largest_force(sketches: list[Sketch]) -> float:
    """[N] The largest of all arrows."""
    sizes = []
    for picture in sketches:
        for arrow in picture.arrows.values():
            sizes.append(float(np.hypot(*arrow.force)))
    return max(sizes)


def _arrow(ax: Axes, paint: str, width: float) -> Annotation:
    look = {"arrowstyle": "-|>", "color": paint, "linewidth": width, "shrinkA": 0, "shrinkB": 0}
    return ax.annotate("", (0, 0), (0, 0), zorder=6, arrowprops=look)


def _point(arrow: Annotation, foot, reach) -> None:
    """Put an arrow at a place, with its tip at a distance (2,) from there."""
    arrow.set_position(tuple(foot))
    arrow.xy = tuple(np.add(foot, reach))


# ---------------------------------------------------------------- the mechanism of one cylinder


def mechanism_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of the periodic state: mechanism and forces above, magnitudes below.

    Args:
        compressor: with a slider-crank or a slider-link.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.

    Several cylinders are shown from the front and the side, see `cylinders_motion`.
    """
    if compressor.crankshaft.count > 1:
        return cylinders_motion(compressor, orbit, frames)
    turn = fine_turn(compressor, orbit)
    angles = _even_in_time(turn, frames)
    sketches = [sketch(compressor, turn, angle) for angle in angles]
    largest = _largest_force(sketches)
    mechanism: Any = compressor.mechanism
    reach = 2.2 * float(mechanism.crank_radius)  # [m] of the largest arrow
    look = shown("force", "N", largest)

    figure, axes = style.new_figure(2, 1, (8.0, 6.0), "One revolution with its forces", share=False)
    above, below = axes[:, 0]
    above.set_aspect("equal")
    above.set_axis_off()
    drawn = {}
    for name, line in sketches[0].lines.items():
        (drawn[name],) = above.plot(*line, **line_look(name))
    tips = {}
    for place, name in enumerate(sketches[0].arrows):
        tint = style.colour(name, place)
        if name == "gas":
            tint = _GAS_TINT
        tips[name] = _arrow(above, tint, 2.2)
    _limits(above, sketches, reach)
    caption = above.text(
        0.0, 1.0, "", transform=above.transAxes, fontsize=9, color=style.INK, va="top"
    )
    forces = forces_over(compressor, turn)
    sizes = {}
    for name in tips:
        if name in forces:
            sizes[name] = look.factor * np.hypot(*forces[name])
    gas = {"gas": {"color": _GAS_TINT}}
    style.turn_curves(below, turn.state.angle, sizes, f"Force, {look.unit}", zero=False, looks=gas)
    below.set_ylim(0, None)
    style.legend_above(below)
    mark = below.axvline(0, color=style.INK, linewidth=1.2)

    def show(frame: int) -> None:
        present = sketches[frame % frames]
        angle = angles[frame % frames]
        for name, line in present.lines.items():
            drawn[name].set_data(*line)
        for name, arrow in present.arrows.items():
            _point(tips[name], arrow.place, reach / largest * arrow.force)
            tips[name].set_visible(np.hypot(*arrow.force) >= 0.01 * largest)
        degrees = (np.rad2deg(angle) + 180) % 360 - 180
        speed = np.interp(angle, turn.state.angle, turn.state.speed)
        caption.set_text(
            f"{round(degrees):d}° from top dead centre, {speed * RPM:.0f} rpm; "
            f"the longest arrow is {look.text(largest, 3)}"
        )
        mark.set_xdata([degrees, degrees])

    show(0)
    return Motion(figure, show, frames)


def _limits(ax: Axes, sketches: list[Sketch], reach: float) -> None:
    lines: list[np.ndarray] = []
    for instant in sketches:
        lines += instant.lines.values()
    points = np.concatenate(lines, axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    low = points.min(axis=1)
    high = points.max(axis=1)
    ax.set_xlim(low[0] - 0.7 * reach, high[0] + 1.1 * reach)
    ax.set_ylim(min(low[1], -0.6 * reach) - 0.1 * reach, max(high[1], 0.6 * reach) + 0.25 * reach)


# ---------------------------------------------------------------- several cylinders


def cylinders_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of a machine with several cylinders, from the front and from the side.

    The arrows are the loads on the main bearings in machine axes; from the side, the crank in the plane
    of the first throw with rods, counterweights and bearings at their places.

    Args:
        compressor: with several cylinders.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.
    """
    cylinders = compressor.crankshaft
    turn = fine_turn(compressor, orbit)
    angles = _even_in_time(turn, frames)
    names, places = _main_bearings(compressor)
    at = np.asarray(turn.state.angle)
    forces = turn.loads.forces
    loads = {}
    for name in names:
        if name in forces:
            loads[name] = -np.asarray(forces[name])
    largest = max(float(np.hypot(*load).max()) for load in loads.values())
    figure, (front, side) = style.abreast(2, (9.6, 5.2), "Front and side")
    parts: list[Any] = [of_cylinder(compressor.mechanism, k + 1) for k in range(cylinders.count)]
    reach = max(float(m.piston_extremes()[0] + 0.5 * m.bore) for m in parts)
    # rod, piston and cylinder from the front, rod and piston from the side
    views = ((front, 1.8), (front, 1.8), (front, 0.9), (side, 1.8), (side, 1.8))
    lines = []
    for k in range(cylinders.count):
        look = {"color": style.tint(k), "solid_capstyle": "round"}
        of_one_cylinder = []
        for ax, wide in views:
            of_one_cylinder += ax.plot([], [], linewidth=wide, **look)
        lines.append(of_one_cylinder)
    style.note(figure, axes_words(cylinders.bank_angle))
    span = (-1.05 * reach, 1.05 * reach)
    front.set(xlim=span, ylim=span, aspect="equal", xlabel="y, m", ylabel="x, m")
    ends = np.concatenate([np.asarray(cylinders.position), places])
    margin = 0.15 * max(np.ptp(ends), 2 * float(parts[0].bore))
    low = ends.min() - margin
    high = ends.max() + margin
    side.set(xlim=(low, high), ylim=span, xlabel="z, m", ylabel="x, m")
    side.plot(
        places, np.zeros_like(places), "^", color=style.INK, markersize=9, label="Main bearings"
    )
    (shaft,) = side.plot([], [], "-", color=style.INK, linewidth=2.5)
    (weights,) = side.plot([], [], "s", color=style.GREY, markersize=8, label="Counterweights")
    style.legend(side, loc="lower right")
    tips = [_arrow(front, style.INK, 1.6) for _ in loads]
    caption = front.text(0.0, 1.01, "", transform=front.transAxes, fontsize=8.5, color=style.INK)
    radius = float(parts[0].crank_radius)
    throws, stands, heavy = _counterweights(cylinders, parts[0])

    def show(frame: int) -> None:
        angle = angles[frame % frames]
        for number, (single, drawn) in enumerate(zip(parts, lines, strict=True)):
            _draw(cylinders, number, single, angle, drawn)
        z, x = _crank_line(cylinders, radius, angle)
        shaft.set_data([low, *z, high], [0.0, *x, 0.0])
        weights.set_data(stands, heavy * np.cos(angle + throws))
        for tip, load in zip(tips, loads.values(), strict=True):
            # x of the machine points upwards in this view
            sideways = np.interp(angle, at, load[1])
            upwards = np.interp(angle, at, load[0])
            _point(tip, (0, 0), 0.6 * reach / largest * np.array([sideways, upwards]))
        speed = RPM * np.interp(angle, at, turn.state.speed)
        shown = round(np.rad2deg(angle)) % 360
        caption.set_text(f"{shown}°, {speed:.1f} rpm; longest arrow {largest / 1e3:.3g} kN")

    show(0)
    return Motion(figure, show, frames)


@draws(orbit=Orbit)
def machine_views(compressor: Compressor, orbit: Orbit) -> Figure:
    """Front and side of the machine at the first top dead centre.

    Args:
        compressor: whose orbit it is.
        orbit: of `solve_orbit`.
    """
    return cylinders_motion(compressor, orbit, 1).figure


def _main_bearings(compressor: Compressor) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the main bearings and their places [m] along the shaft."""
    support = compressor.crankshaft.main_journal
    if not isinstance(support, MainBearings):
        return ("main_journal",), np.zeros(1)
    places = np.zeros(1)
    if support.position is not None:
        places = np.asarray(support.position)
    return support.names or (), places


def _counterweights(cylinders: Crankshaft, mechanism: SliderCrank):
    """Angles [rad] of the throws with counterweights, their places [m], and where these hang [m]."""
    radius = float(mechanism.crank_radius)
    throws = []
    stands = []
    heavy = []
    for throw, unbalance in zip(cylinders.rows, cylinders.unbalances(mechanism), strict=True):
        if float(unbalance):
            throws.append(float(throw.angle))
            stands.append(float(throw.position))
            heavy.append(radius * np.sign(float(unbalance)))
    return np.array(throws), np.array(stands), np.array(heavy)


def _draw(cylinders: Crankshaft, number: int, single: SliderCrank, angle: float, drawn) -> None:
    """Crank and rod, piston and cylinder from the front; rod and piston from the side."""
    bank = float(cylinders.bank_angle[number])
    phase = float(cylinders.phase[number])
    lines, _ = slider_crank_lines(single, angle + phase)
    turn = np.array([[np.cos(bank), -np.sin(bank)], [np.sin(bank), np.cos(bank)]])
    rod = turn @ lines["pins"]
    paths = (rod, turn @ lines["piston"], turn @ lines["cylinder"])
    for line, path in zip(drawn, paths, strict=False):
        line.set_data(path[1], path[0])
    place = float(cylinders.position[number])
    wide = 0.08 * float(single.bore)
    drawn[3].set_data([place, place], rod[0, 1:])
    drawn[4].set_data([place - wide, place + wide], rod[0, [2, 2]])


def _crank_line(cylinders: Crankshaft, radius: float, angle: float):
    """The crank from the side: z and x of its axis, throw by throw."""
    z = []
    x = []
    places = list(np.asarray(cylinders.position))
    room = 0.25 * radius
    for throw in cylinders.rows:
        rods = places[: throw.banks.size]
        places = places[throw.banks.size :]
        height = radius * np.cos(angle + float(throw.angle))
        # up to the pin, along the rods, and down again
        z += np.repeat([min(rods) - room, max(rods) + room], 2).tolist()
        x += [0.0, height, height, 0.0]
    return z, x


# ---------------------------------------------------------------- journals


def journal_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of every journal in its clearance circle with its load, and its film below.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.
    """
    films = journal_films(compressor, orbit)
    size = (3.6 * len(films) + 0.8, 6.0)
    figure, axes = style.new_figure(2, len(films), size, "Journals in their films", False)
    time = np.asarray(orbit.time)
    angle = orbit.state.angle
    period = float(orbit.period)
    instants = time[0] + period * np.arange(frames) / frames

    def at(values):
        """(2, frames) At the instants of the frames."""
        return np.array([np.interp(instants, time, row, period=period) for row in values])

    crank = np.interp(instants, np.append(time, time[0] + period),
                      np.append(angle, angle[0] + 2 * np.pi))  # fmt: skip
    degrees = (np.rad2deg(crank) + 180) % 360 - 180
    drawn = []
    for place, ((name, film), (above, below)) in enumerate(zip(films.items(), axes.T, strict=True)):
        paint = style.colour(name, place)
        path, load = in_clearance(above, film, color=paint, linewidth=0.8, alpha=0.6)
        above.set(xticks=[], yticks=[])
        style.heading(above, style.words(name))
        dot = above.plot([0], [0], "o", color=paint)[0]
        thickness = {name: 1e6 * film.thickness}
        style.turn_curves(below, angle, thickness, "", zero=False, color=paint)
        below.set_ylim(0, None)
        mark = below.axvline(0, color=style.INK, linewidth=1.0)
        drawn.append((at(path), at(load), dot, _arrow(above, style.INK, 1.0), mark))
    axes[1, 0].set_ylabel("Smallest film, µm")
    style.note(figure, "Dot: centre of the journal in its clearance circle. Arrow: load on it.")

    def show(frame: int) -> None:
        i = frame % frames
        for places, loads, dot, tip, mark in drawn:
            dot.set_data(places[:1, i], places[1:, i])
            _point(tip, places[:, i], loads[:, i])
            mark.set_xdata([degrees[i], degrees[i]])

    show(0)
    return Motion(figure, show, frames)
