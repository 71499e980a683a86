"""Pictures of an identification: readings and model, what is left, and what is hardly told."""

import numpy as np
from matplotlib.figure import Figure

from .._core.display import shown
from ..study import Identification
from ..study.rating import ZERO
from . import _style as style

_FITTED = style.tint(0)
_PREDICTED = style.tint(1)
# Pairs of constants that are drawn, and root of chi-square of two for 95 %.
_PAIRS = 3
_RADIUS = 5.991**0.5
# Different values of a condition up to which it is worth a colour each.
_FEW = 12


def identification_figures(found: Identification, name: str) -> dict[str, Figure]:
    """All pictures of an identification by name.

    Args:
        found: to show.
        name: of the machine.
    """
    figures = {}
    for one in found.quantities:
        trace = np.isfinite(_condition(found, "crank_angle", one)).all()
        figures[f"identified_{one}"] = (_trace if trace else _readings)(found, name, one)
        if np.isfinite(_condition(found, "condensing", one)).all():
            figures[f"map_{one}"] = _map(found, name, one)
    if len(found.parameters) > 1 and np.isfinite(found.covariance).all():
        figures["identified_pairs"] = _pairs(found, name)
    return figures


def _condition(found: Identification, key: str, quantity: str) -> np.ndarray:
    """Values of a condition; not a number where it has none."""
    whole = found.conditions.get(key, np.full(len(found.quantity), np.nan))
    return np.asarray(whole)[found.of(quantity)]


def _columns(found: Identification, quantity: str):
    """Measured, computed, width of the interval, error, and which were fitted."""
    mine = found.of(quantity)
    unit, relative = found.kinds[quantity]
    measured, computed, half, used = (
        np.asarray(getattr(found, key))[mine]
        for key in ("measured", "computed", "half_width", "used")
    )
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
    error = found.error(quantity) * factor
    return (
        look,
        look.of(measured),
        look.of(computed),
        half * look.factor,
        error,
        label,
        used,
    )


def _readings(found: Identification, name: str, quantity: str) -> Figure:
    """Computed over measured, and the error over every condition that varies."""
    look, measured, computed, half, error, unit, used = _columns(found, quantity)
    axes = {key: _condition(found, key, quantity) for key in found.conditions}
    axes = {
        key: values
        for key, values in axes.items()
        if np.isfinite(values).all() and np.ptp(values) > 1e-9 * np.abs(values).max()
    }
    count = 1 + len(axes)
    figure, grid = style.beside(count, (4.3 * count, 4.2), f"{name}: {look.label}")
    grid = np.atleast_1d(grid)
    ends = [min(measured.min(), computed.min()), max(measured.max(), computed.max())]
    grid[0].plot(ends, ends, color=style.GREY, linewidth=0.8)
    for which, tint, label in ((used, _FITTED, "fitted"), (~used, _PREDICTED, "predicted")):
        if not which.any():
            continue
        look_of = {"fmt": "o", "color": tint, "markersize": 4, "label": label}
        grid[0].errorbar(measured[which], computed[which], half[which], **look_of)
        for ax, (key, values) in zip(grid[1:], axes.items(), strict=True):
            x = values[which] - ZERO * (found.condition_units[key] == "K")
            ax.plot(x, error[which], "o", color=tint, markersize=4)
    grid[0].set(xlabel="Measured", ylabel="Computed, with its 95 % interval")
    for ax, key in zip(grid[1:], axes, strict=True):
        style.zero_line(ax)
        at = {"K": "\N{DEGREE SIGN}C", "": ""}.get(
            found.condition_units[key], found.condition_units[key]
        )
        ax.set(
            xlabel=f"{style.words(key)}{at and f', {at}'}", ylabel=f"Computed less measured, {unit}"
        )
    style.legend(grid[0])
    return figure


def _trace(found: Identification, name: str, quantity: str) -> Figure:
    """Readings and model over the crank angle, and what is left in standard deviations."""
    look, measured, computed, *_ = _columns(found, quantity)
    mine = found.of(quantity)
    angle = np.degrees(_condition(found, "crank_angle", quantity))
    left = np.asarray((found.computed - found.measured) / found.sd)[mine]
    figure, (ax, off) = style.stacked(2, (7.2, 5.4), f"{name}: {look.label}")
    points = np.asarray(found.point)[mine]
    # each file is a line of its own
    for number, point in enumerate(dict.fromkeys(points.tolist())):
        at = np.flatnonzero(points == point)
        at = at[np.argsort(angle[at])]
        tint = style.tint(number)
        which = f", {number + 1}" if np.ptp(points) else ""
        ax.plot(angle[at], measured[at], ".", color=tint, markersize=4, label=f"measured{which}")
        ax.plot(angle[at], computed[at], color=tint, linewidth=1.2, label=f"computed{which}")
        off.plot(angle[at], left[at], ".", color=tint, markersize=3)
    style.zero_line(off)
    ax.set(ylabel=look.label)
    off.set(xlabel="Crank angle, degrees", ylabel="Difference, standard deviations")
    style.legend_above(ax)
    return figure


def _map(found: Identification, name: str, quantity: str) -> Figure:
    """The model with its intervals over the evaporating temperature, one line a condensing one."""
    look, measured, computed, half, _, _, used = _columns(found, quantity)
    x = _condition(found, "evaporating", quantity) - ZERO
    lines = np.stack([
        _condition(found, "condensing", quantity) - ZERO,
        np.nan_to_num(_condition(found, "speed", quantity)),
    ]).round(2)  # fmt: skip
    figure, ax = style.single((7.2, 4.8), f"{name}: {look.label}, with 95 % intervals")
    for place, (at, speed) in enumerate(sorted(set(map(tuple, lines.T.tolist())))):
        mine = np.all(np.array([at, speed]) == lines.T, axis=1)
        order = np.flatnonzero(mine)[np.argsort(x[mine])]
        tint = style.tint(place)
        label = f"{at:.4g} \N{DEGREE SIGN}C" if place < _FEW else None
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


def _pairs(found: Identification, name: str) -> Figure:
    """Ellipses of 95 % of the pairs of constants that are correlated most."""
    error = np.asarray(found.standard_error)
    covariance = np.asarray(found.covariance)
    correlation = covariance / np.outer(error, error)
    rows, columns = np.triu_indices(len(error), 1)
    worst = np.argsort(-np.abs(correlation[rows, columns]))[:_PAIRS]
    count = len(worst)
    figure, grid = style.beside(count, (3.9 * count, 4.0), f"{name}: pairs that are told least")
    for ax, k in zip(np.atleast_1d(grid), worst, strict=True):
        i, j = rows[k], columns[k]
        block = covariance[np.ix_([i, j], [i, j])]
        sizes, axes = np.linalg.eigh(block / np.outer(error[[i, j]], error[[i, j]]))
        centre = np.asarray(found.estimate)[[i, j]]
        angle = np.linspace(0, 2 * np.pi, 181)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        line = (axes * np.sqrt(np.maximum(sizes, 0))) @ circle * _RADIUS * error[[i, j], None]
        line = line + centre[:, None]
        if found.bounds is not None:
            line = _within(line, np.asarray(found.bounds)[[i, j]])
        looks = [shown(found.parameters[n], found.units[n], found.estimate[n]) for n in (i, j)]
        size, zero = (np.array([getattr(one, key) for one in looks]) for key in ("factor", "zero"))
        shift = centre * size + zero
        ax.plot(*(line * size[:, None] + zero[:, None]), color=_FITTED)
        ax.plot(*shift, "o", color=_FITTED, markersize=4)
        style.heading(ax, f"Correlation {correlation[i, j]:.3f}")
        names = (found.parameters[i], found.parameters[j])
        labels = (
            f"{name}, {look.unit}" if look.unit else name
            for name, look in zip(names, looks, strict=True)
        )
        ax.set(**dict(zip(("xlabel", "ylabel"), labels, strict=True)))
        ax.xaxis.label.set_size(8)
        ax.yaxis.label.set_size(8)
    return figure


def _within(line: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The part of a closed convex line (2, n) inside bounds (2, 2), closed along them.

    After Sutherland and Hodgman (1974), Reentrant polygon clipping: one side of the box after the other.
    """
    points = line[:, :-1] if np.array_equal(line[:, 0], line[:, -1]) else line
    for axis, (low, high) in enumerate(bounds):
        for sign, end in ((1.0, low), (-1.0, high)):
            if not np.isfinite(end) or not points.size:
                continue
            inside = sign * (points[axis] - end)
            kept = []
            for k in range(points.shape[1]):
                if inside[k - 1] * inside[k] < 0:
                    share = inside[k - 1] / (inside[k - 1] - inside[k])
                    crossing = points[:, k - 1] + share * (points[:, k] - points[:, k - 1])
                    crossing[axis] = end
                    kept.append(crossing)
                if inside[k] >= 0:
                    kept.append(points[:, k])
            points = np.array(kept).T if kept else np.empty((2, 0))
    return np.concatenate([points, points[:, :1]], axis=1)
