"""Pictures of an identification: readings and model, what is left, and what is hardly told."""

import numpy as np
from matplotlib.figure import Figure

from .._core.display import Shown, shown
from ..study import Identification
from ..study.rating import ZERO
from . import _style as style
from ._drawing import draws

_FITTED = style.tint(0)
_PREDICTED = style.tint(1)
# Pairs of constants that are drawn, and root of chi-square of two for 95 %.
_PAIRS = 3
_RADIUS = 5.991**0.5
# Different values of a condition up to which it is worth a colour each.
_FEW = 12


@draws(identification=Identification)
def identification_figures(identification: Identification, name: str) -> dict[str, Figure]:
    """All pictures of an identification by name.

    Args:
        identification: to show.
        name: of the machine.
    """
    figures = {}
    for quantity in identification.quantities:
        trace = np.isfinite(_condition(identification, "crank_angle", quantity)).all()
        draw = _trace if trace else _readings
        figures[f"identified_{quantity}"] = draw(identification, name, quantity)
        if np.isfinite(_condition(identification, "condensing", quantity)).all():
            figures[f"map_{quantity}"] = _map(identification, name, quantity)
    if len(identification.parameters) > 1 and np.isfinite(identification.covariance).all():
        figures["identified_pairs"] = _pairs(identification, name)
    return figures


def _condition(identification: Identification, key: str, quantity: str) -> np.ndarray:
    """Values of a condition; not a number where it has none."""
    values = identification.conditions.get(key, np.full(len(identification.quantity), np.nan))
    return np.asarray(values)[identification.of(quantity)]


def _columns(identification: Identification, quantity: str):
    """Measured, computed, width of the interval, error, and which were fitted."""
    rows = identification.of(quantity)
    unit, relative = identification.kinds[quantity]
    measured = np.asarray(identification.measured)[rows]
    computed = np.asarray(identification.computed)[rows]
    half = np.asarray(identification.half_width)[rows]
    used = np.asarray(identification.used)[rows]
    look = shown(quantity, unit, measured).drawn
    if relative:
        factor = 100.0
        label = "%"
    elif unit == "K":
        factor = 1.0
        label = "K"
    else:
        factor = look.factor
        label = look.label.rpartition(",")[2].strip() or "-"
    error = identification.error(quantity) * factor
    return (
        look,
        look.of(measured),
        look.of(computed),
        half * look.factor,
        error,
        label,
        used,
    )


def _readings(identification: Identification, name: str, quantity: str) -> Figure:
    """Computed over measured, and the error over every condition that varies."""
    look, measured, computed, half, error, unit, used = _columns(identification, quantity)
    axes = {}
    for key in identification.conditions:
        values = _condition(identification, key, quantity)
        # over one that is the same at all points but for rounding there is nothing to see
        if np.isfinite(values).all() and np.ptp(values) > 1e-9 * np.abs(values).max():
            axes[key] = values
    count = 1 + len(axes)
    figure, grid = style.abreast(count, (4.3 * count, 4.2), f"{name}: {look.label}")
    grid = np.atleast_1d(grid)
    ends = [min(measured.min(), computed.min()), max(measured.max(), computed.max())]
    grid[0].plot(ends, ends, color=style.GREY, linewidth=0.8)
    for which, tint, label in ((used, _FITTED, "fitted"), (~used, _PREDICTED, "predicted")):
        if not which.any():
            continue
        look_of = {"fmt": "o", "color": tint, "markersize": 4, "label": label}
        grid[0].errorbar(measured[which], computed[which], half[which], **look_of)
        for ax, (key, values) in zip(grid[1:], axes.items(), strict=True):
            x = values[which] - ZERO * (identification.condition_units[key] == "K")
            ax.plot(x, error[which], "o", color=tint, markersize=4)
    grid[0].set(xlabel="Measured", ylabel="Computed, with its 95 % interval")
    for ax, key in zip(grid[1:], axes, strict=True):
        style.zero_line(ax)
        condition_unit = identification.condition_units[key]
        if condition_unit == "K":
            condition_unit = "\N{DEGREE SIGN}C"
        ax.set_xlabel(_with_unit(style.words(key), condition_unit))
        ax.set_ylabel(f"Computed less measured, {unit}")
    style.legend(grid[0])
    return figure


def _trace(identification: Identification, name: str, quantity: str) -> Figure:
    """Readings and model over the crank angle, and what is left in standard deviations."""
    look, measured, computed, *_ = _columns(identification, quantity)
    rows = identification.of(quantity)
    angle = np.degrees(_condition(identification, "crank_angle", quantity))
    residual = np.asarray((identification.computed - identification.measured) / identification.sd)[
        rows
    ]
    figure, (ax, off) = style.stacked(2, (7.2, 5.4), f"{name}: {look.label}")
    points = np.asarray(identification.point)[rows]
    # each file is a line of its own
    for number, point in enumerate(dict.fromkeys(points.tolist())):
        at = np.flatnonzero(points == point)
        at = at[np.argsort(angle[at])]
        tint = style.tint(number)
        which = ""
        if np.ptp(points):
            which = f", {number + 1}"
        ax.plot(angle[at], measured[at], ".", color=tint, markersize=4, label=f"measured{which}")
        ax.plot(angle[at], computed[at], color=tint, linewidth=1.2, label=f"computed{which}")
        off.plot(angle[at], residual[at], ".", color=tint, markersize=3)
    style.zero_line(off)
    ax.set(ylabel=look.label)
    off.set(xlabel="Crank angle, degrees", ylabel="Difference, standard deviations")
    style.legend_above(ax)
    return figure


def _map(identification: Identification, name: str, quantity: str) -> Figure:
    """The model with its intervals over the evaporating temperature, one line a condensing one."""
    look, measured, computed, half, _, _, used = _columns(identification, quantity)
    x = _condition(identification, "evaporating", quantity) - ZERO
    lines = np.stack([
        _condition(identification, "condensing", quantity) - ZERO,
        np.nan_to_num(_condition(identification, "speed", quantity)),
    ]).round(2)  # fmt: skip
    figure, ax = style.single((7.2, 4.8), f"{name}: {look.label}, with 95 % intervals")
    for place, (at, speed) in enumerate(sorted(set(map(tuple, lines.T.tolist())))):
        on_line = np.all(np.array([at, speed]) == lines.T, axis=1)
        order = np.flatnonzero(on_line)[np.argsort(x[on_line])]
        tint = style.tint(place)
        label = None
        if place < _FEW:
            label = f"{at:.4g} \N{DEGREE SIGN}C"
        ax.plot(x[order], computed[order], color=tint, linewidth=1.2, label=label)
        low = computed[order] - half[order]
        high = computed[order] + half[order]
        ax.fill_between(x[order], low, high, color=tint, alpha=0.15, linewidth=0)
        for which, face in ((used, tint), (~used, "none")):
            dots = order[which[order]]
            ax.plot(x[dots], measured[dots], "o", color=tint, markerfacecolor=face, markersize=5)
    ax.set(xlabel="Evaporating temperature, \N{DEGREE SIGN}C", ylabel=look.label)
    style.legend(ax, title="Condensing at")
    style.note(figure, "Full dots were fitted, empty ones predicted; lines are the model.")
    return figure


def _pairs(identification: Identification, name: str) -> Figure:
    """Ellipses of 95 % of the pairs of constants that are correlated most."""
    error = np.asarray(identification.standard_error)
    covariance = np.asarray(identification.covariance)
    correlation = covariance / np.outer(error, error)
    rows, columns = np.triu_indices(len(error), 1)
    worst = np.argsort(-np.abs(correlation[rows, columns]))[:_PAIRS]
    count = len(worst)
    figure, grid = style.abreast(count, (3.9 * count, 4.0), f"{name}: pairs that are told least")
    for ax, k in zip(np.atleast_1d(grid), worst, strict=True):
        i, j = rows[k], columns[k]
        block = covariance[np.ix_([i, j], [i, j])]
        sizes, axes = np.linalg.eigh(block / np.outer(error[[i, j]], error[[i, j]]))
        centre = np.asarray(identification.estimate)[[i, j]]
        angle = np.linspace(0, 2 * np.pi, 181)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        line = (axes * np.sqrt(np.maximum(sizes, 0))) @ circle * _RADIUS * error[[i, j], None]
        line = line + centre[:, None]
        if identification.bounds is not None:
            line = _within(line, np.asarray(identification.bounds)[[i, j]])
        looks = (_parameter_look(identification, i), _parameter_look(identification, j))
        size = np.array([look.factor for look in looks])
        zero = np.array([look.zero for look in looks])
        shift = centre * size + zero
        ax.plot(*(line * size[:, None] + zero[:, None]), color=_FITTED)
        ax.plot(*shift, "o", color=_FITTED, markersize=4)
        style.heading(ax, f"Correlation {correlation[i, j]:.3f}")
        names = (identification.parameters[i], identification.parameters[j])
        ax.set_xlabel(_with_unit(names[0], looks[0].unit))
        ax.set_ylabel(_with_unit(names[1], looks[1].unit))
        ax.xaxis.label.set_size(8)
        ax.yaxis.label.set_size(8)
    return figure


def _parameter_look(identification: Identification, n: int) -> Shown:
    """Format of an identified number."""
    name = identification.parameters[n]
    return shown(name, identification.units[n], identification.estimate[n])


def _with_unit(name: str, unit: str) -> str:
    return f"{name}, {unit}" if unit else name


def _within(line: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The part of a closed convex line (2, n) inside bounds (2, 2), closed along them.

    After Sutherland and Hodgman (1974), Reentrant polygon clipping: one side of the box after the other.
    """
    points = line
    if np.array_equal(line[:, 0], line[:, -1]):
        points = line[:, :-1]
    for axis, (low, high) in enumerate(bounds):
        for sign, end in ((1.0, low), (-1.0, high)):
            if not np.isfinite(end) or not points.size:
                continue
            inside = sign * (points[axis] - end)
            clipped = []
            for k in range(points.shape[1]):
                if inside[k - 1] * inside[k] < 0:
                    share = inside[k - 1] / (inside[k - 1] - inside[k])
                    crossing = points[:, k - 1] + share * (points[:, k] - points[:, k - 1])
                    crossing[axis] = end
                    clipped.append(crossing)
                if inside[k] >= 0:
                    clipped.append(points[:, k])
            points = np.empty((2, 0))
            if clipped:
                points = np.array(clipped).T
    return np.concatenate([points, points[:, :1]], axis=1)
