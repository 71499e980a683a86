"""Pictures of the journals: paths in the clearance, film and pressure over the revolution."""

import numpy as np
from matplotlib.figure import Figure

from ..compressor import Compressor
from ..crank import Orbit, journal_films
from ._motion import Motion
from ._style import (
    INK,
    colour,
    crank_axis,
    crank_marks,
    legend_above,
    new_figure,
    note,
    over_turn,
    words,
    ylabel,
)


def journal_paths(compressor: Compressor, orbit: Orbit) -> Figure:
    """Path of every journal in its clearance circle, with the load on it as arrows.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.
    """
    films = journal_films(compressor, orbit)
    columns = min(3, len(films))
    rows = -(-len(films) // columns)
    size, title = (4.0 * columns, 4.1 * rows), "Journals in their clearances"
    figure, axes = new_figure(rows, columns, size, title, False)
    note(figure, "Dots: every 45° of crank angle. Arrows: load on the journal.")
    degrees = np.rad2deg(np.asarray(orbit.state.angle))
    around = np.linspace(0, 2 * np.pi, 181)
    for ax in axes.flat[len(films) :]:
        ax.set_visible(False)
    for place, (ax, (name, film)) in enumerate(zip(axes.flat, films.items(), strict=False)):
        tint, path = colour(name, place), np.asarray(film.position)
        load = np.asarray(film.load)
        load = 0.4 * load / max(np.hypot(*load).max(), 1e-300)
        ax.plot(np.cos(around), np.sin(around), color=INK, linewidth=1.0)
        ax.plot(*np.append(path, path[:, :1], axis=1), color=tint, linewidth=1.6)
        crank_marks(ax, degrees, *path, tint)
        for mark in range(0, 360, 45):
            at = np.argmin(np.abs((degrees - mark + 180) % 360 - 180))
            end = path[:, at] + load[:, at]
            ax.annotate("", end, path[:, at], arrowprops={"arrowstyle": "->", "color": "#888888"})
        ax.set_aspect("equal")
        ax.set_xlim(-1.15, 1.15)
        ax.set_ylim(-1.15, 1.15)
        how = "orbit" if film.moving else "steady load at every instant"
        ax.set_title(f"{words(name)}, {how}", fontsize=9.5, loc="left", color=INK)
    return figure


def journal_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of every journal in its clearance circle with its load, and its film below.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.
    """
    films = journal_films(compressor, orbit)
    names, count = list(films), len(films)
    figure, axes = new_figure(2, count, (3.6 * count + 0.8, 6.0), "Journals in their films", False)
    time, angle = np.asarray(orbit.time), np.asarray(orbit.state.angle)
    period = float(orbit.period)
    instants = time[0] + period * np.arange(frames) / frames
    around = np.linspace(0, 2 * np.pi, 181)

    def at(values):
        """At the instants of the frames."""
        return np.array(
            [np.interp(instants, time, row, period=period) for row in np.atleast_2d(values)]
        )

    crank = np.rad2deg(np.interp(instants, np.append(time, time[0] + period),
                                 np.append(angle, angle[0] + 2 * np.pi)))  # fmt: skip
    degrees = (crank + 180) % 360 - 180
    drawn = []
    for k, name in enumerate(names):
        film, above, below, tint = films[name], axes[0, k], axes[1, k], colour(name, k)
        path, load = np.asarray(film.position), np.asarray(film.load)
        places, loads = at(path), at(0.4 * load / max(np.hypot(*load).max(), 1e-300))
        above.plot(np.cos(around), np.sin(around), color=INK, linewidth=1.0)
        above.plot(*np.append(path, path[:, :1], axis=1), color=tint, linewidth=0.8, alpha=0.6)
        above.set_aspect("equal")
        above.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), xticks=[], yticks=[])
        above.set_title(words(name), fontsize=9.5, loc="left", color=INK)
        dot = above.plot([0], [0], "o", color=tint)[0]
        tip = above.annotate("", (0, 0), (0, 0), arrowprops={"arrowstyle": "-|>", "color": INK})
        turned, thickness = over_turn(orbit.state.angle, film.thickness)
        below.plot(turned, 1e6 * thickness, color=tint)
        below.set_ylim(0, None)
        crank_axis(below)
        mark = below.axvline(0, color=INK, linewidth=1.0)
        drawn.append((places, loads, dot, tip, mark))
    ylabel(axes[1, 0], "Smallest film, µm")
    note(figure, "Dot: centre of the journal in its clearance circle. Arrow: load on it.")

    def show(frame: int) -> None:
        i = frame % frames
        for places, loads, dot, tip, mark in drawn:
            dot.set_data(places[:1, i], places[1:, i])
            tip.set_position(tuple(places[:, i]))
            tip.xy = tuple(places[:, i] + loads[:, i])
            mark.set_xdata([degrees[i], degrees[i]])

    show(0)
    return Motion(figure, show, frames)


def journal_films_over_turn(compressor: Compressor, orbit: Orbit) -> Figure:
    """Smallest film thickness and largest pressure of every journal over the crank angle.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.
    """
    figure, axes = new_figure(2, 1, (7.2, 5.6), "Films of the journals")
    for place, (name, film) in enumerate(journal_films(compressor, orbit).items()):
        degrees, thickness, pressure = over_turn(orbit.state.angle, film.thickness, film.pressure)
        tint = colour(name, place)
        axes[0, 0].plot(degrees, 1e6 * thickness, color=tint, label=words(name))
        axes[1, 0].plot(degrees, pressure / 1e6, color=tint)
    axes[0, 0].set_ylim(0, None)
    ylabel(axes[0, 0], "Smallest film, µm")
    ylabel(axes[1, 0], "Largest pressure, MPa")
    legend_above(axes[0, 0])
    crank_axis(axes[1, 0])
    return figure
