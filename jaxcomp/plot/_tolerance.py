"""Pictures of a scatter: distributions of the quantities, and what contributes to them."""

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from .._shown import Shown, shown
from ..design import variable_label
from ..tolerancing import Tolerances
from ._style import INK, legend, new_figure, note, ylabel

_BAR, _FIRST, _SECOND, _LIMIT, _LOW = "#9FC5E8", "#D55E00", "#56437F", "#CC0000", "#0072B2"
# Bars of a tornado that still can be read.
_ROWS = 14


def tolerance_figures(found: Tolerances, title: str) -> dict[str, Figure]:
    """All pictures of a scatter, by name.

    Args:
        found: of `tolerance`.
        title: of the pictures.
    """
    figures = {}
    for name in found.names:
        figures[f"histogram-{name}"] = tolerance_histogram(found, name, title)
        figures[f"tornado-{name}"] = tornado(found, name, title)
    return figures


def tolerance_histogram(found: Tolerances, name: str, title: str) -> Figure:
    """How a quantity is distributed, with the bells of first and second order and its limits.

    Args:
        found: of `tolerance`.
        name: of the quantity.
        title: of the picture.
    """
    place, look = found.names.index(name), _look(found, name)
    values = found.sampled.values[found.sampled.ok, place] * look.factor
    title = f"{title}: {_small(look.words)} of {len(values):,} machines"
    figure, axes = new_figure(1, 1, (6.8, 4.2), title)
    ax = axes[0, 0]
    bars = int(np.clip(np.sqrt(len(values)) / 2, 12, 80))
    heights, edges, _ = ax.hist(values, bars, density=True, color=_BAR, edgecolor="white",
                                linewidth=0.3, label="samples")  # fmt: skip
    top = 1.15 * heights.max()
    low, high = _shown_range(found, name, edges[0], edges[-1], look.factor)
    ax.set(xlim=(low, high), ylim=(0, top))
    x = np.linspace(low, high, 400)
    for moments, tint, line, word in (
        (found.first_order, _FIRST, "-", "first order"),
        (found.second_order, _SECOND, "--", "second order"),
    ):
        if moments is not None and moments.deviation[place] > 0:
            mean, wide = (m[place] * look.factor for m in (moments.mean, moments.deviation))
            bell = stats.norm.pdf(x, mean, wide)
            ax.plot(x, bell, line, color=tint, linewidth=1.3, label=f"normal, {word}")
    ax.axvline(
        found.value[place] * look.factor, color=INK, linewidth=1.0, linestyle=":", label="nominal"
    )
    for at, side in zip(np.percentile(values, (5, 95)), ("right", "left"), strict=True):
        ax.plot([at, at], [0, 0.06 * top], color=INK, linewidth=1.4)
        share = "5" if side == "right" else "95"
        ax.annotate(f"{share} %", (at, 0.07 * top), (-3 if side == "right" else 3, 0), fontsize=8,
                    textcoords="offset points", ha=side, color=INK)  # fmt: skip
    note(figure, "Short marks: 5 and 95 % of the machines lie below.")
    for one in found.reliability:
        if one.limit.quantity == name:
            _limit(ax, one, look, top)
    ax.set_yticks([])
    ax.set_xlabel(look.label, fontsize=9)
    ylabel(ax, "Share of the machines")
    legend(ax, loc="upper right" if found.sampled.skewness[place] > -0.5 else "upper left")
    return figure


def _shown_range(found: Tolerances, name: str, low, high, factor) -> tuple[float, float]:
    """The samples, and the limits that do not lie far off."""
    room = high - low
    for one in found.reliability:
        at = one.limit.bound * factor
        if one.limit.quantity == name and low - 0.5 * room < at < high + 0.5 * room:
            low, high = min(low, at), max(high, at)
    return low - 0.04 * room, high + 0.04 * room


def _limit(ax, one, look: Shown, top) -> None:
    at = one.limit.bound * look.factor
    text = f"limit {look.text(one.limit.bound)}: {100 * one.sampled:.3g} % break it"
    ax.axvline(at, color=_LIMIT, linewidth=1.3)
    low, far = ax.get_xlim()
    # beside the line on the side of what breaks it, where the samples are few
    side = 1 if one.limit.above and at < far else -1
    ax.annotate(text, (min(max(at, low), far), 0.6 * top), (4 * side, 0), fontsize=8, color=_LIMIT,
                textcoords="offset points", rotation=90, va="center",
                ha="left" if side > 0 else "right")  # fmt: skip


def tornado(found: Tolerances, name: str, title: str) -> Figure:
    """A quantity with one variable after the other at its limits, beside shares of the variance.

    Args:
        found: of `tolerance`.
        name: of the quantity.
        title: of the picture.
    """
    place, look = found.names.index(name), _look(found, name)
    ranked = found.ranking(name)[:_ROWS]
    rows = [found.variables.index(variable) for variable, _ in ranked]
    title = f"{title}: what changes {_small(look.words)}"
    figure, axes = new_figure(1, 1, (7.6, 1.6 + 0.36 * len(rows)), title)
    ax = axes[0, 0]
    mean = float(np.asarray(found.local.value)[place]) * look.factor
    y = np.arange(len(rows))
    for side, tint, word in ((0, _LOW, "at the low limit"), (1, _FIRST, "at the high limit")):
        reach = np.nan_to_num(found.swings[side, rows, place] * look.factor - mean)
        ax.barh(y + 0.19 * (2 * side - 1), reach, 0.36, left=mean, color=tint, label=word)
    low, high = ax.get_xlim()
    ax.set_xlim(low, high + 0.16 * (high - low))
    for row, (_, share) in enumerate(ranked):
        ax.annotate(f"{100 * share:.1f} %", (1.0, row), xycoords=("axes fraction", "data"),
                    fontsize=8, va="center", ha="right", color=INK)  # fmt: skip
    ax.annotate("of variance", (1.0, -0.62), xycoords=("axes fraction", "data"), fontsize=8,
                ha="right", va="bottom", color=INK)  # fmt: skip
    ax.axvline(mean, color=INK, linewidth=0.9)
    design = found.problem.design
    ax.set_yticks(y, [variable_label(design, variable) for variable, _ in ranked], fontsize=8.5)
    note(figure, f"Line: {_small(look.words)} of the mean machine.")
    ax.grid(False, axis="y")
    ax.set_ylim(len(rows) - 0.4, -0.9)
    ax.set_xlabel(look.label, fontsize=9)
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2,
                  frameon=False, fontsize=8.5)  # fmt: skip
    return figure


def _small(words: str) -> str:
    return words[:1].lower() + words[1:]


def _look(found: Tolerances, name: str) -> Shown:
    place = found.names.index(name)
    return shown(name, found.problem.units[place], found.value[place])
