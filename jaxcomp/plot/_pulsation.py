"""Pictures of pulsation: resonances of pipes against orders of the crank, and spectra with limits."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._core.display import RPM
from . import _style as style
from ._drawing import draws

# Orders of a spectrum that are drawn.
_DRAWN = 20
# [Pa] Height of the axis where less than this pulsates.
_LEAST_SHOWN = 1.0


@draws()
def pulsation_figures(pulsation: dict[str, Any]) -> dict[str, Figure]:
    """Pictures of `jaxcomp pulsation`, by name.

    Args:
        pulsation: what the command prints.
    """
    figures = {"resonances": resonance_map(pulsation)}
    if "solved" in pulsation:
        figures["spectra"] = spectra(pulsation["solved"])
    return figures


def resonance_map(pulsation: dict[str, Any]) -> Figure:
    """Orders of the crank over its speed, and the frequencies at which pipes ring."""
    figure, ax = style.single((8.0, 5.0), "Resonances of pipes and orders of the crank")
    rpm = np.array([pulsation["lowest_speed"], pulsation["highest_speed"]]) * RPM
    for order in range(1, pulsation["orders"] + 1):
        ax.plot(rpm, order * rpm / 60, color=style.INK, linewidth=0.8, alpha=0.6)
        ax.annotate(f"{order}", (rpm[1], order * rpm[1] / 60), fontsize=8, color=style.INK)
    named = set()
    for resonance in pulsation["resonances"]:
        line = resonance["line"]
        place = 0 if line == "suction" else 1
        tint = style.tint(place)
        label = None if line in named else line
        named.add(line)
        ax.axhline(resonance["frequency"], color=tint, linewidth=1.5, label=label)
        for crossing in resonance["crossings"]:
            ax.plot(crossing["speed"] * RPM, resonance["frequency"], "o", color=tint, markersize=5)
    ax.axvline(pulsation["speed"] * RPM, color=style.INK, linestyle=":", linewidth=1)
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
        limits = [limit for limit in solved["limits"] if limit["place"] == node and limit["order"]]
        if limits:
            orders = np.array([limit["order"] for limit in limits])
            values = np.array([limit["value"] for limit in limits])
            allowed = np.array([limit["allowed"] for limit in limits])
            # in the unit of the bars, whichever the limits have
            scale = 2 * sizes[orders - 1] / np.maximum(values, 1e-12)
            ax.plot(orders, allowed * scale, "_", color=style.INK, markersize=12)
        # at a node that holds its pressure nothing is left but rounding
        ax.set_ylim(0, max(ax.get_ylim()[1], _LEAST_SHOWN))
        ax.set_ylabel(f"{node}, Pa")
    last_axes = np.atleast_1d(axes)[-1]
    last_axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    last_axes.set_xlabel("Order (bars: peak to peak; marks: limit of API 618)")
    return figure
