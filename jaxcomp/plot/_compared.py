"""Pictures of designs beside each other."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ._style import INK, colour, legend_above, new_figure, words

_LOSS = "loss_power."


def compared_losses(rows: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> Figure:
    """Power lost in each joint of some designs, with a bar for each design.

    Args:
        rows: with `name` and the `values` [W] of all designs; those of other names do not count.
        labels: of the designs.
    """
    losses = {r["name"][len(_LOSS) :]: r["values"] for r in rows if r["name"].startswith(_LOSS)}
    values = np.array([[x or 0.0 for x in row] for row in losses.values()]).reshape(-1, len(labels))
    size = (7.2, 1.8 + (0.25 + 0.22 * len(labels)) * len(losses))
    figure, ((ax,),) = new_figure(1, 1, size, "Friction losses")
    height = 0.8 / len(labels)
    for place, label in enumerate(labels):
        at = np.arange(len(losses)) + height * (place - (len(labels) - 1) / 2)
        bars = ax.barh(at, values[:, place], height, color=colour("", place), label=label)
        texts = ["" if row[place] is None else f"{row[place]:.3g} W" for row in losses.values()]
        ax.bar_label(bars, texts, padding=4, fontsize=8, color=INK)
    ax.set_yticks(np.arange(len(losses)), [words(name) for name in losses])
    ax.invert_yaxis()
    ax.set_xlim(0, 1.2 * max(values.max(initial=0.0), 1e-12))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("Power lost, W", fontsize=9)
    legend_above(ax)
    return figure
