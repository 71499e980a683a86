"""Pictures of the journals: paths in the clearance, film and pressure over the revolution."""

import numpy as np
from matplotlib.figure import Figure

from ..compressor import Compressor
from ..crank import Orbit, journal_films
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
