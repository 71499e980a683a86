"""Pictures of a balance: vibration before and after, corrections on the polar diagram."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._shown import RPM, small_unit
from ..balancing import Balance
from ._style import INK, legend, legend_above, new_figure, new_polar_figure, note

_PLANES = ("#0072B2", "#D55E00", "#009E73", "#56437F", "#E69F00", "#56B4E9")
_BEFORE, _AFTER, _BAND = "#BBBBBB", "#0072B2", "#D55E00"


def balance_figures(balance: Balance, title: str = "Vibration") -> dict[str, Figure]:
    """All pictures of a balance, by name."""
    return {"vibration": balance_bars(balance, title), "corrections": balance_polar(balance)}


def balance_bars(balance: Balance, title: str = "Vibration") -> Figure:
    """Amplitude of every reading before and after, a panel for each speed."""
    system = balance.influence
    factor, unit = (1e6, "µm") if system.unit == "m" else (1, system.unit)
    speed_of = np.array([row.speed for row in system.rows])
    speeds, counts = np.unique(speed_of, return_counts=True)
    size = (max(6.0, 0.55 * counts.max() + 2), 2.7 * len(speeds) + 0.4)
    figure, axes = new_figure(len(speeds), 1, size, f"{title}: before and after balancing")
    before, after = (factor * np.abs(x) for x in (system.initial, balance.residual))
    spread = factor * np.linalg.norm(balance.sensitivity(), axis=1)
    for ax, speed in zip(axes[:, 0], speeds, strict=True):
        rows = np.flatnonzero(speed_of == speed)
        place = np.arange(len(rows))
        for shift, heights, tint, label in (
            (-0.2, before, _BEFORE, "before"),
            (0.2, after, _AFTER, "after"),
        ):
            ax.bar(place + shift, heights[rows], 0.4, color=tint, label=label)
        ax.errorbar(place + 0.2, after[rows], spread[rows], fmt="none", ecolor=_BAND, capsize=2,
                    label="with 1 % and 1° of error in every plane")  # fmt: skip
        labels = [f"{system.rows[i].target}\n{system.rows[i].axis}" for i in rows]
        ax.set_xticks(place, labels, fontsize=7.5)
        ax.set_ylabel(f"{unit} at {speed * RPM:.5g} rpm", fontsize=9, color=INK)
        ax.set_xlim(-0.6, max(len(rows), 4) - 0.4)
        ax.set_ylim(bottom=0)
    legend_above(axes[0, 0])
    return figure


def balance_polar(balance: Balance) -> Figure:
    """Size and place of the corrections, seen along the shaft; 0 is the crank pin's direction."""
    unit, factor = small_unit(balance.influence.trial)
    correction = np.asarray(balance.correction)
    sizes, angles = np.abs(correction) * factor, np.angle(correction)
    figure, axes = new_polar_figure(1, 1, f"Corrections to add, {unit}")
    ax = axes[0, 0]
    for number, (name, size, angle) in enumerate(
        zip(balance.influence.planes, sizes, angles, strict=True)
    ):
        label = f"{name}: {size:.4g} at {np.rad2deg(angle):.1f}°"
        ax.plot([angle, angle], [0, size], "o-", color=_PLANES[number % len(_PLANES)], linewidth=2,
                markersize=4, markevery=[1], label=label)  # fmt: skip
    ax.set_ylim(0, 1.1 * max(*sizes, 1e-12))
    ax.yaxis.set_major_locator(MaxNLocator(4))
    note(figure, "Angles with the rotation, from the crank pin;\nof measured runs as those of the "
         "trial weights.")  # fmt: skip
    legend(ax, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    return figure
