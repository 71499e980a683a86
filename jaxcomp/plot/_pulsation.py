"""Pictures of pulsation: resonances of pipes against orders of the crank, and spectra with limits."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .._core.display import RPM
from . import _style as style

# Orders of a spectrum that are drawn.
_DRAWN = 20


def pulsation_figures(found: dict[str, Any]) -> dict[str, Figure]:
    """Pictures of `jaxcomp pulsation`, by name.

    Args:
        found: what the command prints.
    """
    figures = {"resonances": resonance_map(found)}
    if "solved" in found:
        figures["spectra"] = spectra(found["solved"])
    return figures


def resonance_map(found: dict[str, Any]) -> Figure:
    """Orders of the crank over its speed, and the frequencies at which pipes ring."""
    figure, ax = style.single((8.0, 5.0), "Resonances of pipes and orders of the crank")
    rpm = np.array([found["lowest_speed"], found["highest_speed"]]) * RPM
    for order in range(1, found["orders"] + 1):
        ax.plot(rpm, order * rpm / 60, color=style.INK, linewidth=0.8, alpha=0.6)
        ax.annotate(f"{order}", (rpm[1], order * rpm[1] / 60), fontsize=8, color=style.INK)
    named = set()
    for resonance in found["resonances"]:
        line = resonance["line"]
        tint = style.tint(0 if line == "suction" else 1)
        label = None if line in named else line
        named.add(line)
        ax.axhline(resonance["frequency"], color=tint, linewidth=1.5, label=label)
        for crossing in resonance["crossings"]:
            ax.plot(crossing["speed"] * RPM, resonance["frequency"], "o", color=tint, markersize=5)
    ax.axvline(found["speed"] * RPM, color=style.INK, linestyle=":", linewidth=1)
    ax.set(xlabel="Speed, rpm", ylabel="Frequency, Hz")
    ax.set_xlim(rpm[0], rpm[1] + 0.04 * (rpm[1] - rpm[0]))
    if named:
        style.legend_above(ax)
    return figure


def spectra(solved: dict[str, Any]) -> Figure:
    """Amplitudes by order at every node, with the limits of API 618 where they count by component."""
    nodes = list(solved["spectra"])
    figure, axes = style.stacked(len(nodes), (8.0, 1.6 + 1.5 * len(nodes)), "Pulsation by order")
    for ax, node in zip(np.atleast_1d(axes), nodes, strict=True):
        sizes = np.array(solved["spectra"][node][:_DRAWN])
        orders = np.arange(1, sizes.size + 1)
        ax.bar(orders, 2 * sizes, color=style.tint(0), width=0.6)
        limits = [one for one in solved["limits"] if one["place"] == node and one["order"]]
        if limits:
            place = [one["order"] for one in limits]
            scale = [2 * sizes[one["order"] - 1] / max(one["value"], 1e-12) for one in limits]
            allowed = [one["allowed"] * s for one, s in zip(limits, scale, strict=True)]
            ax.plot(place, allowed, "_", color=style.INK, markersize=12)
        ax.set_ylabel(f"{node}, Pa")
    np.atleast_1d(axes)[-1].set_xlabel("Order (bars: peak to peak; marks: limit of API 618)")
    return figure
