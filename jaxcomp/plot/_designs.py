"""Pictures of designs: what they depend on, how they scatter, and several beside each other."""

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from .._core.display import Shown, shown
from ..study import Comparison, Sensitivity
from ..study.tolerance import Tolerances
from . import _style as style
from ._drawing import draws

_LOW = "#0072B2"
_HIGH = "#D55E00"
_SECOND = "#56437F"
_LIMIT = "#CC0000"
_LOSS = "loss_power."
_USE = "power_use."
# Bars of a sensitivity and of a tornado that still can be read.
_BARS = 18
_ROWS = 14


@draws(comparison=Comparison)
def compared_figures(comparison: Comparison) -> dict[str, Figure]:
    """All pictures of a comparison, by name: those of which it has numbers."""
    draw = {"power_use": (_USE, compared_power_use), "losses": (_LOSS, compared_losses)}
    figures = {}
    for name, (family, function) in draw.items():
        if any(row.name.startswith(family) for row in comparison.rows):
            figures[name] = function(comparison)
    return figures


@draws(comparison=Comparison)
def compared_losses(comparison: Comparison) -> Figure:
    """Power lost in each joint of some designs, with a bar for each design.

    Args:
        comparison: of `compare`.
    """
    return _compared_family(comparison, _LOSS, "Friction losses", "Power lost, W")


@draws(comparison=Comparison)
def compared_power_use(comparison: Comparison) -> Figure:
    """Uses of the electric (or shaft) power of machines with valves, with a bar for each design.

    Args:
        comparison: of `compare`.
    """
    return _compared_family(comparison, _USE, "What the power is spent on", "Power, W")


def _compared_family(comparison: Comparison, family: str, title: str, label: str) -> Figure:
    """The members of a family of powers [W], with a bar for each design."""
    labels = comparison.labels
    members = {}
    lengths = []
    for row in comparison.rows:
        if row.name.startswith(family):
            members[row.name.removeprefix(family)] = row.values
            # `None` stands for a joint that a design does not have
            lengths.append([power or 0.0 for power in row.values])
    values = np.array(lengths).reshape(-1, len(labels))
    size = (7.2, 1.8 + (0.25 + 0.22 * len(labels)) * len(members))
    figure, ax = style.single(size, title)
    shifts, height = style.side_by_side(len(labels))
    for place, name in enumerate(labels):
        at = np.arange(len(members)) + shifts[place]
        tint = style.colour("", place)
        bars = ax.barh(at, values[:, place], height, color=tint, label=name)
        texts = []
        for powers in members.values():
            power = powers[place]
            text = ""
            if power is not None:
                text = f"{style.plain_number(power)} W"
            texts.append(text)
        ax.bar_label(bars, texts, padding=4, fontsize=8, color=style.INK)
    style.named_rows(ax, list(map(style.words, members)))
    low = values.min(initial=0.0)
    high = max(values.max(initial=0.0), 1e-12)
    ax.set(xlim=(1.2 * low, 1.2 * high), xlabel=label)
    style.legend_above(ax)
    return figure


# ---------------------------------------------------------------- sensitivity


@draws(sensitivity=Sensitivity)
def sensitivity_figures(sensitivity: Sensitivity, title: str) -> dict[str, Figure]:
    """All pictures of a sensitivity study, by name.

    Args:
        sensitivity: of `sensitivity`.
        title: of the pictures.
    """
    figures = {}
    for quantity in sensitivity.quantities:
        figures[f"sensitivity-{quantity}"] = sensitivity_bars(sensitivity, quantity, title)
    return figures


@draws(found=Sensitivity)
def sensitivity_bars(found: Sensitivity, name: str = "", title: str = "Sensitivity") -> Figure:
    """Elasticity of a quantity with respect to the numbers that it depends on most.

    Args:
        found: of `sensitivity`.
        name: of the quantity; the first of the study if absent.
        title: of the picture.
    """
    name = name or found.quantities[0]
    ranked = [influence for influence in found.ranking(name) if influence.relative][:_BARS]
    words = shown(name, "", 0.0).words.lower()
    size = (7.6, 1.4 + 0.28 * max(len(ranked), 2))
    figure, ax = style.single(size, f"{title}: what {words} depends on most")
    elasticities = []
    labels = []
    for influence in ranked:
        elasticities.append(influence.elasticity)
        labels.append(f"{influence.part}, {influence.value}")
    values = np.array(elasticities)
    tints = np.where(values > 0, _LOW, _HIGH).tolist()
    bars = ax.barh(range(len(ranked)), values, 0.7, color=tints)
    ax.bar_label(bars, fmt="{:+.3g}", padding=4, fontsize=8, color=style.INK)
    style.named_rows(ax, labels, fontsize=8.5)
    ax.margins(x=0.16)
    ax.axvline(0, color=style.INK, linewidth=0.9)
    ax.set_xlabel(f"Change of {words} in % for a rise of the number by 1 %")
    return figure


# ---------------------------------------------------------------- tolerances


@draws(tolerances=Tolerances)
def tolerance_figures(tolerances: Tolerances, title: str) -> dict[str, Figure]:
    """All pictures of a scatter, by name.

    Args:
        tolerances: of `tolerance`.
        title: of the pictures.
    """
    figures = {}
    for name in tolerances.names:
        figures[f"histogram-{name}"] = tolerance_histogram(tolerances, name, title)
        figures[f"tornado-{name}"] = tornado(tolerances, name, title)
    return figures


@draws(found=Tolerances)
def tolerance_histogram(found: Tolerances, name: str, title: str) -> Figure:
    """Distribution of a quantity, with the bells of first and second order and its limits.

    Args:
        found: of `tolerance`.
        name: of the quantity.
        title: of the picture.
    """
    place = found.names.index(name)
    look = found.shown(name).drawn
    values = look.of(found.sampled.values[found.sampled.ok, place])
    title = f"{title}: {_small(look)} of {len(values):,} machines"
    figure, ax = style.single((6.8, 4.2), title)
    bars = style.bars(values, int(np.clip(np.sqrt(len(values)) / 2, 12, 80)))
    heights, edges, _ = ax.hist(values, bars, density=True, color="#9FC5E8", edgecolor="white",
                                linewidth=0.3, label="samples")  # fmt: skip
    top = 1.15 * heights.max()
    limits = [r for r in found.reliability if r.limit.quantity == name]
    # the samples, and the limits that do not lie far off
    low = edges[0]
    high = edges[-1]
    room = np.ptp(edges)
    for row in limits:
        at = look.of(row.limit.bound)
        if low - 0.5 * room < at < high + 0.5 * room:
            low = min(low, at)
            high = max(high, at)
    low = low - 0.04 * room
    high = high + 0.04 * room
    ax.set(xlim=(low, high), ylim=(0, top))
    x = np.linspace(low, high, 400)
    for moments, tint, line, word in (
        (found.first_order, _HIGH, "-", "first order"),
        (found.second_order, _SECOND, "--", "second order"),
    ):
        if moments is not None and moments.deviation[place] > 0:
            mean = look.of(moments.mean[place])
            bell = stats.norm.pdf(x, mean, moments.deviation[place] * look.factor)
            ax.plot(x, bell, line, color=tint, linewidth=1.3, label=f"normal, {word}")
    nominal = look.of(found.value[place])
    ax.axvline(nominal, color=style.INK, linewidth=1.0, linestyle=":", label="nominal")
    for share, side, shift in ((5, "right", -3), (95, "left", 3)):
        at = np.percentile(values, share)
        ax.plot([at, at], [0, 0.06 * top], color=style.INK, linewidth=1.4)
        ax.annotate(f"{share} %", (at, 0.07 * top), (shift, 0), fontsize=8, ha=side,
                    textcoords="offset points", color=style.INK)  # fmt: skip
    style.note(figure, "Short marks: 5 and 95 % of the machines lie below.")
    for row in limits:
        at = look.of(row.limit.bound)
        text = f"limit {look.text(row.limit.bound)}"
        ax.axvline(at, color=_LIMIT, linewidth=1.3)
        # beside the line on the side of what breaks it, where the samples are few
        side = "right"
        shift = -4
        if row.limit.above and at < high:
            side = "left"
            shift = 4
        ax.annotate(f"{text}: {100 * row.sampled:.3g} % break it", (np.clip(at, low, high), 0.6 * top),
                    (shift, 0), fontsize=8, color=_LIMIT, textcoords="offset points", rotation=90,
                    va="center", ha=side)  # fmt: skip
    ax.set(yticks=[], xlabel=look.label, ylabel="Share of the machines")
    # above the longer tail
    side = "right" if found.sampled.skewness[place] > -0.5 else "left"
    style.legend(ax, loc=f"upper {side}")
    return figure


@draws(found=Tolerances)
def tornado(found: Tolerances, name: str, title: str) -> Figure:
    """A quantity with one variable after the other at its limits, beside shares of the variance.

    Args:
        found: of `tolerance`.
        name: of the quantity.
        title: of the picture.
    """
    place = found.names.index(name)
    look = found.shown(name).drawn
    ranked = found.ranking(name)[:_ROWS]
    rows = []
    labels = []
    shares = []
    for number, (variable, share) in enumerate(ranked):
        rows.append(found.variables.index(variable))
        labels.append(found.label(variable))
        shares.append((number, "center", f"{100 * share:.1f} %"))
    shares.append((-0.62, "bottom", "of variance"))
    size = (7.6, 1.6 + 0.36 * len(rows))
    title = f"{title}: what changes {_small(look)}"
    figure, ax = style.single(size, title)
    mean = look.of(float(np.asarray(found.local.value)[place]))
    reach = np.nan_to_num(look.of(found.swings[:, rows, place]) - mean)
    for side, tint, word in ((0, _LOW, "low"), (1, _HIGH, "high")):
        at = np.arange(len(rows)) + 0.19 * (2 * side - 1)
        ax.barh(at, reach[side], 0.36, left=mean, color=tint, label=f"at the {word} limit")
    low, high = ax.get_xlim()
    ax.set_xlim(low, high + 0.16 * (high - low))
    for row, alignment, text in shares:
        ax.annotate(text, (1.0, row), xycoords=("axes fraction", "data"), fontsize=8, ha="right",
                    va=alignment, color=style.INK)  # fmt: skip
    ax.axvline(mean, color=style.INK, linewidth=0.9)
    ax.set_yticks(range(len(rows)), labels, fontsize=8.5)
    style.note(figure, f"Line: {_small(look)} of the mean machine.")
    ax.grid(False, axis="y")
    ax.set(ylim=(len(rows) - 0.4, -0.9), xlabel=look.label)
    style.legend_outside(ax, "lower center", 2)
    return figure


def _small(look: Shown) -> str:
    return look.words[:1].lower() + look.words[1:]
