"""Pictures of a balance: vibration before and after, corrections on the polar diagram."""

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..balancing import SHOWN_UNIT
from ._style import INK, new_figure, new_polar_figure

_BEFORE, _AFTER, _BAND = "#BBBBBB", "#0072B2", "#D55E00"


def balance_figures(result: dict[str, Any]) -> dict[str, Figure]:
    """All pictures of the result of `jaxcomp balance`, by name."""
    return {"vibration": balance_bars(result), "corrections": balance_polar(result)}


def balance_bars(result: dict[str, Any]) -> Figure:
    """Amplitude of every row before and after, a panel for each speed."""
    factor, unit = (1e6, "µm") if result["vibration_unit"] == "m" else (1, result["vibration_unit"])
    speeds = sorted({row["speed"] for row in result["rows"]})
    count = max(sum(r["speed"] == s for r in result["rows"]) for s in speeds)
    size = (max(6.0, 0.55 * count + 2), 2.7 * len(speeds) + 0.4)
    figure, axes = new_figure(len(speeds), 1, size, f"{result['machine']}: before and after")
    for ax, speed in zip(axes[:, 0], speeds, strict=True):
        rows = [row for row in result["rows"] if row["speed"] == speed]
        place = np.arange(len(rows))
        for shift, key, tint in ((-0.2, "before", _BEFORE), (0.2, "after", _AFTER)):
            heights = [row[key] * factor for row in rows]
            ax.bar(place + shift, heights, 0.4, color=tint, label=key)
        spread = [math.sqrt(sum(s**2 for s in r["sensitivity"].values())) * factor for r in rows]
        ax.errorbar(place + 0.2, [r["after"] * factor for r in rows], spread, fmt="none",
                    ecolor=_BAND, capsize=2, label="1 % and 1° off in every plane")  # fmt: skip
        labels = [f"{r['target']}\n{r['axis']}" for r in rows]
        ax.set_xticks(place, labels, fontsize=7.5)
        ax.set_ylabel(f"{unit} at {speed * 30 / np.pi:.5g} rpm", fontsize=9, color=INK)
        ax.set_ylim(bottom=0)
    axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def balance_polar(result: dict[str, Any]) -> Figure:
    """Size and place of the corrections, seen along the shaft; 0 is the crank pin's direction."""
    unit, factor = SHOWN_UNIT[result["correction_unit"]]
    sizes = [plane["correction"] * factor for plane in result["planes"]]
    figure, axes = new_polar_figure(1, 1, f"Corrections to add, {unit}")
    ax = axes[0, 0]
    for number, (plane, size) in enumerate(zip(result["planes"], sizes, strict=True)):
        ax.annotate("", (plane["phase"], size), (0, 0),
                    arrowprops={"arrowstyle": "->", "color": f"C{number}", "linewidth": 2})  # fmt: skip
        ax.plot([plane["phase"]], [size], "o", color=f"C{number}", markersize=4,
                label=f"{plane['name']}: {size:.4g} at {math.degrees(plane['phase']):.1f}°")  # fmt: skip
    ax.set_ylim(0, 1.1 * max(*sizes, 1e-12))
    ax.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    return figure
