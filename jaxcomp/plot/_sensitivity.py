"""Pictures of sensitivities: the numbers of a machine that a quantity depends on most."""

import numpy as np
from matplotlib.figure import Figure

from .._shown import shown
from ..design import Sensitivity
from ._style import INK, new_figure

_MORE, _LESS = "#0072B2", "#D55E00"
# Bars that still can be read.
_ROWS = 18


def sensitivity_figures(found: Sensitivity, title: str) -> dict[str, Figure]:
    """All pictures of a sensitivity study, by name.

    Args:
        found: of `sensitivity`.
        title: of the pictures.
    """
    return {
        f"sensitivity-{name}": sensitivity_bars(found, name, title) for name in found.quantities
    }


def sensitivity_bars(found: Sensitivity, name: str = "", title: str = "Sensitivity") -> Figure:
    """Elasticity of a quantity with respect to the numbers that it depends on most.

    Args:
        found: of `sensitivity`.
        name: of the quantity; the first of the study if absent.
        title: of the picture.
    """
    name = name or found.quantities[0]
    ranked = [one for one in found.ranking(name) if one.relative][:_ROWS]
    words = shown(name, "", 0.0).words.lower()
    size = (7.6, 1.4 + 0.28 * max(len(ranked), 2))
    figure, ((ax,),) = new_figure(1, 1, size, f"{title}: what {words} depends on most")
    values = np.array([one.elasticity for one in ranked])
    bars = ax.barh(
        np.arange(len(ranked)), values, 0.7, color=np.where(values > 0, _MORE, _LESS).tolist()
    )
    ax.bar_label(bars, [f"{x:+.3g}" for x in values], padding=4, fontsize=8, color=INK)
    ax.set_yticks(range(len(ranked)), [f"{one.part}, {one.value}" for one in ranked], fontsize=8.5)
    ax.invert_yaxis()
    ax.margins(x=0.16)
    ax.axvline(0, color=INK, linewidth=0.9)
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(f"Change of {words} in % for a rise of the number by 1 %", fontsize=9)
    return figure
