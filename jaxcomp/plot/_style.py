"""One look for all pictures, without touching matplotlib's global state, and what many are made of."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend

# Colour-blind safe (Okabe and Ito), by joint, torque, valve and axis.
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
    "suction": "#0072B2",
    "discharge": "#D55E00",
    "motor": "#0072B2",
    "friction": "#7F7F7F",
    "piston": "#009E73",
    "rod": "#CC79A7",
    "crank": "#444444",
    "x": "#0072B2",
    "y": "#D55E00",
    "z": "#009E73",
}
_SPARE = ("#E69F00", "#56B4E9", "#F0E442", "#CC79A7", "#000000")
# Of curves that stand for no joint, in this order.
TINTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999933", "#56437F",
         "#444444")  # fmt: skip
INK = "#222222"
GREY = "#888888"
FAINT = "#AAAAAA"
GRID = "#E3E3E3"


def colour(name: str, place: int = 0) -> str:
    """The colour that a joint or torque has in every picture."""
    return COLOURS.get(name, _SPARE[place % len(_SPARE)])


def tint(place: int) -> str:
    """The colour of a curve by its place among the others."""
    return TINTS[place % len(TINTS)]


def words(name: str) -> str:
    """`crank_pin` -> `Crank pin`."""
    return name.replace("_", " ").capitalize()


def new_figure(
    rows: int, columns: int, size: tuple[float, float], title: str, share: bool = True, **options
):
    """A figure with a grid of axes in the style of the package, as an array of shape (rows, columns).

    With `share` all axes have the same abscissa; `options` are those of `Figure.subplots`.
    """
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    share = share and rows * columns > 1
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share, **options)
    figure.suptitle(title, fontsize=11, color=INK, x=0.01, ha="left")
    for ax in axes.flat:
        ax.grid(True, color=GRID, linewidth=0.7)
        ax.set_axisbelow(True)
        if ax.name == "polar":
            ax.spines["polar"].set_color(GREY)
            ax.tick_params(colors=INK, labelsize=8)
            continue
        ax.spines[["top", "right"]].set_visible(False)
        ax.spines[["left", "bottom"]].set_color(GREY)
        ax.tick_params(colors=INK, labelsize=8.5)
        for axis in (ax.xaxis, ax.yaxis):
            axis.label.set_size(9)
    return figure, axes


def single(size: tuple[float, float], title: str):
    """A figure with one pair of axes."""
    figure, axes = new_figure(1, 1, size, title)
    return figure, axes[0, 0]


def stacked(rows: int, size: tuple[float, float], title: str):
    """A figure with axes over a common abscissa, from the top down."""
    figure, axes = new_figure(rows, 1, size, title)
    return figure, axes[:, 0]


def abreast(columns: int, size: tuple[float, float], title: str):
    """A figure with axes beside each other, each with its own abscissa."""
    figure, axes = new_figure(1, columns, size, title, share=False)
    return figure, axes[0]


def new_polar_figure(rows: int, columns: int, title: str):
    """A figure with a grid of polar axes in the same style, as an array of shape (rows, columns)."""
    size = (4.0 * columns, 4.0 * rows + 0.4)
    polar = {"projection": "polar"}
    return new_figure(rows, columns, size, title, False, subplot_kw=polar)


def grid_of(count: int, columns: int) -> tuple[int, int]:
    """Rows and columns for so many axes, in rows of at most `columns`."""
    columns = min(columns, count)
    return -(-count // columns), columns


def used(axes: np.ndarray, count: int) -> list[Any]:
    """The first axes of a grid; the others are hidden."""
    for ax in axes.flat[count:]:
        ax.set_visible(False)
    return list(axes.flat[:count])


# ---------------------------------------------------------------- curves


def crank_axis(ax: Axes, label: bool = True) -> None:
    """Crank angle from -180 to 180 degrees with a mark at zero."""
    ax.set(xlim=(-180, 180), xticks=range(-180, 181, 45))
    ax.axvline(0, color=FAINT, linewidth=0.8, zorder=1)
    if label:
        ax.set_xlabel("Crank angle from top dead centre, degrees", fontsize=9)


def zero_line(ax: Axes) -> None:
    """A thin line at the ordinate zero."""
    ax.axhline(0, color=GREY, linewidth=0.8)


def over_turn(angle, *curves):
    """Order curves from -180 to 180 degrees and close the revolution at both ends.

    Args:
        angle: [rad] (n,) nodes in rising order within one revolution from the top dead centre.
        curves: (n,) values at the nodes.

    Returns:
        Angle [degrees] (n + 2,) and each curve (n + 2,), continued periodically.
    """
    degrees = (np.rad2deg(np.asarray(angle)) + 180) % 360 - 180
    order = np.argsort(degrees)
    closed = [np.pad(np.asarray(values)[order], 1, "wrap") for values in (degrees, *curves)]
    # the points that wrap around belong to the neighbouring revolutions
    closed[0][[0, -1]] += -360, 360
    return closed


def turn_curves(
    ax: Axes,
    angle,
    curves: Mapping[str, Any],
    ylabel: str,
    *,
    looks: Mapping[str, Mapping[str, Any]] = {},
    zero: bool = True,
    angle_label: bool = True,
    **look: Any,
) -> None:
    """Curves over the crank angle, each in the colour of its joint or torque.

    Args:
        ax: plane axes.
        angle: [rad] (n,)
        curves: (n,) values by name.
        ylabel: of the ordinate.
        looks: of single lines, by name.
        zero: draw a line at zero.
        angle_label: the abscissa has its label here.
        look: of all lines.
    """
    drawn = []
    for place, (name, values) in enumerate(curves.items()):
        usual = {"color": colour(name, place), "linewidth": 1.5, "label": words(name)}
        line_look = usual | look | looks.get(name, {})
        # a colour that comes again is dashed, then dotted
        dash = "-"
        if line_look["color"]:
            dash = ("-", "--", ":", "-.")[drawn.count(line_look["color"]) % 4]
        drawn.append(line_look["color"])
        ax.plot(*over_turn(angle, values), dash, **line_look)
    if zero:
        zero_line(ax)
    ax.set_ylabel(ylabel)
    crank_axis(ax, angle_label)


def crank_marks(ax: Axes, degrees, x, y, tint: str) -> None:
    """Dots on a closed curve every 45 degrees of crank angle, every other one with its number.

    Numbers stand beside the curve, and one is left out where its dot is that of another.

    Args:
        ax: plane axes of equal scales, or polar ones.
        degrees: crank angle (n,) of the points.
        x, y: (n,) the curve.
        tint: its colour.
    """
    if ax.name == "polar":
        places = np.asarray(y * np.exp(1j * x))
    else:
        ax.margins(0.12)  # for numbers beside the ends of the curve
        places = np.asarray(x + 1j * y)
    points = places * _points_per_unit(ax, places)
    # between the points as well, where a number could lie on the line
    curve = np.concatenate([points + k / 4 * (np.roll(points, -1) - points) for k in range(4)])
    centres: list[complex] = []
    numbered: list[complex] = []
    for mark in (0, 180, 90, 270, 45, 135, 225, 315):
        at = nearest_angle(degrees, mark)
        ax.plot(x[at], y[at], "o", color=tint, markersize=3.2)
        dot = complex(points[at])
        if mark % 90 or any(abs(dot - other) < _DOT for other in numbered):
            continue
        offset = _offset_beside(curve, dot, centres)
        numbered.append(dot)
        centres.append(dot + offset)
        line = None
        if abs(offset) > _NEAR:
            line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2}
        ax.annotate(f"{mark}°", (x[at], y[at]), xytext=(offset.real, offset.imag), color=INK,
                    textcoords="offset points", fontsize=7.5, ha="center", va="center",
                    arrowprops=line)  # fmt: skip


# [pt] Half of the size of a number such as 180°, room around it, and the size of a dot.
_HALF_WIDTH = 9.5
_HALF_HEIGHT = 4.5
_ROOM = 2.0
_DOT = 3.2
# [pt] Distances of a number from its dot that are tried; beyond the second a thin line joins them.
_DISTANCES = (10.0, 14.0, 19.0, 25.0, 32.0)
_NEAR = 14.5


def _points_per_unit(ax: Axes, places: np.ndarray) -> float:
    """[pt] About as long as one unit of a curve in the complex plane will be drawn."""
    box = ax.get_window_extent()
    width = box.width * 72 / ax.figure.dpi
    height = box.height * 72 / ax.figure.dpi
    if ax.name == "polar":
        return 0.5 * min(width, height) / (1.08 * max(float(np.abs(places).max()), 1e-12))
    wide = max(1.1 * float(np.ptp(np.real(places))), 1e-12)
    high = max(1.1 * float(np.ptp(np.imag(places))), 1e-12)
    return min(width / wide, height / high)


def _offset_beside(curve: np.ndarray, dot: complex, centres: Sequence[complex]) -> complex:
    """[pt] From a dot to the centre of its number, which covers neither the curve nor another number."""
    turns = np.exp(2j * np.pi * np.arange(16) / 16 + 0.25j * np.pi)
    best = complex(turns[0])
    clear = -np.inf
    for distance in _DISTANCES:
        offsets = distance * turns
        gaps = np.array([_gap(curve, centres, dot + offset) for offset in offsets])
        widest = int(np.argmax(gaps))
        if gaps[widest] > clear:
            best = complex(offsets[widest])
            clear = float(gaps[widest])
        if clear >= _ROOM:
            break
    return best


def _gap(curve: np.ndarray, centres: Sequence[complex], centre: complex) -> float:
    """[pt] Between the box of a number and the curve or the boxes of other numbers; 0 if they touch."""
    away = curve - centre
    beyond = np.hypot(
        np.maximum(np.abs(away.real) - _HALF_WIDTH, 0),
        np.maximum(np.abs(away.imag) - _HALF_HEIGHT, 0),
    )
    gaps = [float(beyond.min())]
    for other in centres:
        apart = centre - other
        gaps.append(max(abs(apart.real) - 2 * _HALF_WIDTH, abs(apart.imag) - 2 * _HALF_HEIGHT, 0.0))
    return min(gaps)


# Half of the size of two short lines of text, as parts of the axes, and room around them.
_HALF_TEXT = (0.17, 0.06)
_TEXT_ROOM = 0.02


def free_place(ax: Axes, target: tuple[float, float]) -> tuple[float, float]:
    """The place of a short text that covers no line, near to where it is wanted, as parts of the axes.

    Args:
        ax: with its lines and its limits.
        target: the middle of the text.
    """
    lines = [line.get_transform().transform(line.get_xydata()) for line in ax.lines]
    drawn = ax.transAxes.inverted().transform(np.concatenate(lines))
    starts = drawn[:-1]
    steps = np.diff(drawn, axis=0)
    drawn = np.concatenate([starts + k / 16 * steps for k in range(17)])
    right, up = np.meshgrid(np.linspace(0.2, 0.8, 25), np.linspace(0.1, 0.75, 27))
    places = np.stack([right.ravel(), up.ravel()], axis=-1)
    nearest = np.argsort(np.hypot(*(places - target).T))
    gaps = []
    for place in places[nearest]:
        beyond = np.maximum(np.abs(drawn - place) - _HALF_TEXT, 0)
        gaps.append(float(np.hypot(*beyond.T).min()))
        if gaps[-1] >= _TEXT_ROOM:
            return tuple(place)
    return tuple(places[nearest][int(np.argmax(gaps))])


def nearest_angle(degrees, mark: float) -> int:
    """The place of the crank angle that is nearest to one, both in degrees."""
    return int(np.argmin(np.abs((degrees - mark + 180) % 360 - 180)))


# ---------------------------------------------------------------- bars and maps


def named_rows(ax: Axes, names: Sequence[str], down: bool = True, **options) -> None:
    """Names beside rows of bars or marks, from the top `down`, without lines between them."""
    ax.set_yticks(range(len(names)), names, **options)
    if down:
        ax.invert_yaxis()
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)


def side_by_side(count: int, room: float = 0.8) -> tuple[np.ndarray, float]:
    """Shifts of so many bars around their common place, and the width of each."""
    width = room / count
    return width * (np.arange(count) - (count - 1) / 2), width


def bars(values: np.ndarray, count: int) -> int:
    """Number of bars of a histogram: one where values differ by no more than rounding."""
    return count if np.ptp(values) > 1e-9 * np.max(np.abs(values)) else 1


def colour_bar(ax: Axes, shades: Any, label: str, hover: tuple | None = None) -> None:
    """A bar that says what filled contours mean.

    Args:
        ax: the axes of the contours.
        shades: the contours.
        label: quantity and unit.
        hover: abscissas, ordinates and values (rows of ordinates) that an interactive picture tells.
    """
    bar = ax.figure.colorbar(shades, ax=ax, pad=0.01)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8.5)
    if hover is not None:
        shades.hover = *hover, label


# ---------------------------------------------------------------- words


def heading(ax: Axes, text: str, size: float = 9.5) -> None:
    """A title of one of several axes."""
    ax.set_title(text, fontsize=size, loc="left", color=INK)


def note(figure: Figure, text: str) -> None:
    """A line below the axes that says what marks and shades mean."""
    figure.supxlabel(text, fontsize=8, color=INK, x=0.01, ha="left")


def legend(ax: Axes, **options) -> Legend:
    """A legend without a frame."""
    return ax.legend(**{"frameon": False, "fontsize": 8.5} | options)


def legend_above(ax: Axes) -> None:
    """A legend in rows above the axes, where no curve can run, each as long as the axes leave room."""
    box = ax.get_window_extent()
    place = ax.get_subplotspec()
    room = box.width
    if place is None or place.is_last_col():
        room = ax.figure.bbox.width - box.x0

    def with_columns(ncols: int) -> Legend:
        return legend(ax, ncols=ncols, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.2)

    _widest(with_columns, 5, room)


def legend_outside(ax: Axes, loc: str, ncols: int) -> None:
    """A legend of these axes at the edge of the figure."""
    figure = ax.figure
    handles = ax.get_legend_handles_labels()
    look = {"loc": f"outside {loc}", "frameon": False, "fontsize": 8.5}

    def with_columns(ncols: int) -> Legend:
        for before in figure.legends[:]:
            before.remove()
        return figure.legend(*handles, ncols=ncols, **look)

    _widest(with_columns, ncols, 0.98 * figure.bbox.width)


def _widest(with_columns: Callable[[int], Legend], ncols: int, room: float) -> None:
    """Make the legend with the most columns, up to a number, that is no wider than its room [px]."""
    while with_columns(ncols).get_window_extent().width > room and ncols > 1:
        ncols -= 1


def plain_number(value: float, digits: int = 3) -> str:
    """A number with so many digits, and never with a power of ten that one can write out."""
    if 10**digits <= abs(value) < 1e7:
        return f"{float(f'{value:.{digits}g}'):.0f}"
    return f"{value:.{digits}g}"
