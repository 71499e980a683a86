"""One look for all pictures, without touching matplotlib's global state."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Colour-blind safe (Okabe and Ito), by joint and by torque.
COLOURS = {
    "wall": "#D55E00",
    "piston_film": "#E69F00",
    "piston_pin": "#009E73",
    "crank_pin": "#0072B2",
    "main_journal": "#56437F",
    "wall_crown": "#D55E00",
    "wall_edge": "#CC79A7",
    "link_slider": "#009E73",
    "upper_bearing": "#56437F",
    "lower_bearing": "#56B4E9",
    "support": "#444444",
    "thrust_bearing": "#999933",
    "pump": "#AA4499",
    "gas": "#D55E00",
    "motor": "#0072B2",
    "friction": "#7F7F7F",
    "piston": "#009E73",
    "rod": "#CC79A7",
    "crank": "#444444",
}
_SPARE = ("#E69F00", "#56B4E9", "#F0E442", "#CC79A7", "#000000")
SPARE_COLOURS = len(_SPARE)
INK = "#222222"


def colour(name: str, place: int = 0) -> str:
    """The colour that a joint or torque has in every picture."""
    return COLOURS.get(name, _SPARE[place % len(_SPARE)])


def words(name: str) -> str:
    """`crank_pin` -> `Crank pin`."""
    return name.replace("_", " ").capitalize()


def new_figure(rows: int, columns: int, size: tuple[float, float], title: str, share: bool = True):
    """A figure with a grid of axes in the style of the package, as an array of shape (rows, columns).

    With `share` all axes have the same abscissa.
    """
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share and rows * columns > 1)
    figure.suptitle(title, fontsize=11, color=INK, x=0.01, ha="left")
    for ax in axes.flat:
        ax.grid(True, color="#E3E3E3", linewidth=0.7)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.spines[["left", "bottom"]].set_color("#888888")
        ax.tick_params(colors=INK, labelsize=8.5)
    return figure, axes


def new_polar_figure(rows: int, columns: int, title: str):
    """A figure with a grid of polar axes in the same style, as an array of shape (rows, columns)."""
    size = (4.0 * columns, 4.0 * rows + 0.4)
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"})
    figure.suptitle(title, fontsize=11, color=INK, x=0.01, ha="left")
    for ax in axes.flat:
        ax.grid(True, color="#E3E3E3", linewidth=0.7)
        ax.set_axisbelow(True)
        ax.spines["polar"].set_color("#888888")
        ax.tick_params(colors=INK, labelsize=8)
    return figure, axes


def crank_axis(ax: Axes, label: bool = True) -> None:
    """Crank angle from -180 to 180 degrees with a mark at zero."""
    ax.set_xlim(-180, 180)
    ax.set_xticks(range(-180, 181, 45))
    ax.axvline(0, color="#AAAAAA", linewidth=0.8, zorder=1)
    if label:
        ax.set_xlabel("Crank angle from top dead centre, degrees", fontsize=9)


def note(figure: Figure, text: str) -> None:
    """A line below the axes that says what marks and shades mean."""
    figure.supxlabel(text, fontsize=8, color=INK, x=0.01, ha="left")


def crank_marks(ax: Axes, degrees, x, y, tint: str) -> None:
    """Dots on a closed curve every 45 degrees of crank angle, every other one with its number.

    A number is left out where it would cover another one.

    Args:
        ax: plane or polar axes.
        degrees: crank angle (n,) of the points.
        x, y: (n,) the curve.
        tint: its colour.
    """
    places = y * np.exp(1j * x) if ax.name == "polar" else x + 1j * y
    apart, numbered = 0.12 * np.ptp([places.real, places.imag]), []
    for mark in (0, 180, 90, 270, 45, 135, 225, 315):
        at = np.argmin(np.abs((degrees - mark + 180) % 360 - 180))
        ax.plot(x[at], y[at], "o", color=tint, markersize=3.2)
        if mark % 90 == 0 and all(abs(places[at] - other) > apart for other in numbered):
            numbered.append(places[at])
            ax.annotate(f"{mark}°", (x[at], y[at]), xytext=(3, 3), color=INK,
                        textcoords="offset points", fontsize=7.5)  # fmt: skip


def ylabel(ax: Axes, text: str) -> None:
    ax.set_ylabel(text, fontsize=9)


def legend(ax: Axes, **options) -> None:
    ax.legend(frameon=False, fontsize=8.5, **options)


def legend_above(ax: Axes) -> None:
    """A legend in a row above the axes, where no curve can run."""
    legend(ax, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, borderaxespad=0.2)


def over_turn(angle, *curves):
    """Order curves from -180 to 180 degrees and close the revolution at both ends.

    Args:
        angle: [rad] (n,) nodes in rising order within one revolution from the top dead centre.
        curves: (n,) values at the nodes.

    Returns:
        Angle [degrees] (n + 2,) and each curve (n + 2,), continued periodically.
    """
    degrees = np.rad2deg(np.asarray(angle))
    degrees = (degrees + 180) % 360 - 180
    order = np.argsort(degrees)
    degrees = degrees[order]
    out = [np.concatenate([[degrees[-1] - 360], degrees, [degrees[0] + 360]])]
    for curve in curves:
        values = np.asarray(curve)[order]
        out.append(np.concatenate([values[-1:], values, values[:1]]))
    return out
