"""Pictures of a sweep: curves over one variable, maps over two, clouds of samples.

They take the dataset of `jaxcomp.sweep` and show it in the units people use.
"""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._core.display import Shown
from ..study.sweep import best_curve, best_design
from ..study.sweep.interface import machine_parts, quantity_names, shown_column
from . import _style as style

if TYPE_CHECKING:
    import xarray

_CURVE = "#0072B2"
_BEST = "#D55E00"
# Points of a cloud that still can be told apart.
_CLOUD = 20_000
# Values of the second variable up to which a picture of one curve each can be read.
_CURVES = 12


def sweep_figures(found: "xarray.Dataset", title: str) -> dict[str, Figure]:
    """All pictures of a sweep, by name.

    Args:
        found: of `sweep`.
        title: what was swept.
    """
    figures = {}
    for name in quantity_names(found):
        dims = found[name].dims
        words = f"{title}: {_drawn(found, name).words.lower()}"
        if dims == ("sample",):
            figures[f"samples-{name}"] = sample_cloud(found, name, words)
        elif len(dims) == 1:
            figures[f"curve-{name}"] = sweep_curves(found, name, words)
        else:
            figures[f"map-{name}"] = sweep_map(found, name, words)
            figures[f"curves-{name}"] = sweep_curves(found, name, words)
            if len(dims) == 2 and _judged(found, name):
                figures[f"optimum-{name}"] = optimum_curve(found, name, words)
    return figures


def machine_figures(found: "xarray.Dataset", title: str, dimension: str) -> dict[str, Figure]:
    """Every quantity of several machines beside each other, then the pictures of each by itself.

    Beside each other are all designs of each, and their middle.

    Args:
        found: of `sweep_machines`.
        title: what was swept.
        dimension: along which the machines stand.
    """
    machines = [str(one) for one in found[dimension].values]
    figures = {}
    for name in quantity_names(found):
        look = _drawn(found, name)
        heading = f"{title}: {look.words.lower()}"
        figure, ax = style.single((7.2, 4.2), heading)
        values = found[name].transpose(dimension, ...).values.reshape(len(machines), -1)
        for place, own in enumerate(look.of(values)):
            good = own[np.isfinite(own)]
            # as wide as a bar, in the order of the designs
            wide = np.linspace(-0.3, 0.3, good.size) if good.size > 1 else 0 * good
            ax.plot(place + wide, good, "o", color=_CURVE, markersize=3.5)
            if good.size:
                ax.plot([place - 0.35, place + 0.35], [np.median(good)] * 2, color=_BEST)
        ax.set_xticks(range(len(machines)), machines)
        ax.set_ylabel(look.label)
        figures[f"machines-{name}"] = figure
    for machine, part in machine_parts(found, dimension).items():
        if part["ok"].dims:
            own = sweep_figures(part, f"{title}, {machine}")
            figures |= {f"{machine}-{name}": one for name, one in own.items()}
    return figures


def sweep_map(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """A quantity as a filled map over the first two variables, with the curve of its best values.

    The second variable is the abscissa; further ones are at the best design, or at their middle.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    found, at = _sliced(found, name, 2)
    along, across = found[name].dims
    y, x, z = (_drawn(found, n) for n in (along, across, name))
    values = np.ma.masked_invalid(z.of(np.asarray(found[name])))
    figure, ax = style.single((7.2, 5.0), f"{title}{at}")
    ax.grid(False)
    px, py = x.of(np.asarray(found[across])), y.of(np.asarray(found[along]))
    right = np.argsort(px)
    up = np.argsort(py)
    values = values[np.ix_(up, right)]
    px = px[right]
    py = py[up]
    if values.count() and min(values.shape) > 1:
        levels = MaxNLocator(20, steps=[1, 2, 5, 10]).tick_values(values.min(), values.max())
        if values.max() == values.min():
            levels = np.array([values.min() - 0.5, values.max() + 0.5])
        shades = ax.contourf(px, py, values, levels=levels, cmap="viridis")
        lines = ax.contour(shades, colors="white", linewidths=0.5)
        ax.clabel(lines, lines.levels[::2], fontsize=7.5, fmt="%.4g")
        style.colour_bar(ax, shades, z.label, (px, py, values.filled(np.nan)))
    failed = np.ma.getmaskarray(values)
    if failed.any():
        rows, columns = np.nonzero(failed)
        ax.plot(px[columns], py[rows], "x", color=style.GREY, markersize=3, label="failed")
    if _judged(found, name):
        top = best_curve(found, name)
        order = np.argsort(top.across)
        inner = np.where(_inside(top.along, found[along]), top.between, np.nan)[order]
        words = f"best {y.words.lower()}"
        ax.plot(px, y.of(inner), color=_BEST, linewidth=2.0, label=words)
        best = best_design(found, name)
        if best is not None:
            place = x.of(best[across]), y.of(best[along])
            ax.plot(*place, "o", color=_BEST, markeredgecolor="white", markersize=7,
                    clip_on=False, label=f"best of all, {z.text(best[name], 4)}")  # fmt: skip
    ax.set(xlabel=x.label, ylabel=y.label)
    if ax.get_legend_handles_labels()[0]:
        style.legend_above(ax)
    return figure


def sweep_curves(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """A quantity over the first variable, with a curve for each value of the second.

    Best designs are marked. Further variables are as in `sweep_map`.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    found, at = _sliced(found, name, 2)
    dims = found[name].dims
    x, y = (_drawn(found, n) for n in (dims[0], name))
    values = y.of(np.asarray(found[name]).reshape(found.sizes[dims[0]], -1))
    px = x.of(np.asarray(found[dims[0]]))
    order = np.argsort(px)
    px = px[order]
    values = values[order]
    figure, ax = style.single((7.2, 4.4), f"{title}{at}")
    count = values.shape[1]
    judged = _judged(found, name)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _CURVES)).round().astype(int))
    tints = [_CURVE] if count == 1 else colormaps["viridis"](np.linspace(0, 0.9, len(chosen)))
    second = _drawn(found, dims[1]) if len(dims) == 2 else None
    sign = -1.0 if found[name].attrs.get("better") == "less" else 1.0
    for tint, column in zip(tints, chosen, strict=True):
        label = None if second is None else second.text(float(found[dims[1]][column]), 4)
        curve = values[:, column]
        known = np.isfinite(curve).sum()
        ax.plot(px, curve, "o-" if known <= 40 else "-", color=tint, linewidth=1.5, markersize=2.5,
                label=label)  # fmt: skip
        if judged and known:
            top = np.nanargmax(sign * curve)
            ax.plot(px[top], curve[top], "o", color=_BEST, markersize=5.5, zorder=3)
    ax.set(xlabel=x.label, ylabel=y.label + (" (the best is marked)" if judged else ""))
    if second is not None:
        style.legend(ax, fontsize=8, title=second.words, title_fontsize=8.5, loc="center left",
                     bbox_to_anchor=(1.0, 0.5))  # fmt: skip
    return figure


def optimum_curve(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """The best value of the first variable over the second, and what it reaches.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    along, across = found[name].dims
    top = best_curve(found, name)
    x, y, z = (_drawn(found, n) for n in (across, along, name))
    figure, (above, below) = style.stacked(2, (7.2, 5.4), title)
    order = np.argsort(top.across)
    px = x.of(top.across[order])
    value = z.of(top.value[order])
    inner = _inside(top.along, found[along])[order]
    best = y.of(top.along[order])
    between = y.of(top.between[order])
    above.plot(px, np.where(inner, between, np.nan), color=_CURVE, linewidth=1.6,
               label="between the values tried (parabola)")  # fmt: skip
    above.plot(px, best, "o", color=_CURVE, markersize=3.5, label="of the values tried")
    if not inner.all():
        above.plot(px[~inner], best[~inner], "o", color=style.GREY, markersize=4,
                   label="at the end of the range")  # fmt: skip
    above.set_ylabel(f"Best {y.label[:1].lower()}{y.label[1:]}")
    style.legend_above(above)
    below.plot(px, value, "o-", color=_BEST, markersize=3, linewidth=1.5)
    below.set(xlabel=x.label, ylabel=z.label)
    return figure


def sample_cloud(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """The distribution of a quantity, and the quantity over each variable.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    variables = [str(n) for n in found.coords if n != "sample"]
    y = _drawn(found, name)
    every = -(-found.sizes["sample"] // _CLOUD)
    values = y.of(np.asarray(found[name]))
    good = values[np.isfinite(values)]
    rows, columns = style.grid_of(len(variables) + 1, 3)
    size = (3.4 * columns, 3.1 * rows)
    figure, axes = style.new_figure(rows, columns, size, title, share=False)
    first, *others = style.used(axes, len(variables) + 1)
    if good.size:
        count = min(80, max(10, round(good.size**0.5)))
        first.hist(good, bins=style.bars(good, count), color=_CURVE)
        low, middle, high = np.percentile(good, [5, 50, 95])
        for level, dash in ((low, ":"), (middle, "-"), (high, ":")):
            first.axvline(level, color=_BEST, linestyle=dash, linewidth=1.2)
        style.heading(first, f"median {middle:.5g}, 5 to 95 %: {low:.5g} to {high:.5g}", 8)
    first.set(xlabel=y.label, ylabel="Designs")
    for ax, variable in zip(others, variables, strict=True):
        x = _drawn(found, variable)
        px = x.of(np.asarray(found[variable][::every]))
        size = 2.5 if px.size > 2000 else 5
        ax.scatter(px, values[::every], s=size, color=_CURVE, alpha=0.5, linewidths=0,
                   rasterized=True)  # fmt: skip
        ax.set(xlabel=x.label, ylabel=y.label)
    return figure


def _drawn(found, name: str) -> Shown:
    """Format in which a variable or quantity of a sweep is drawn."""
    return shown_column(found, name).drawn


def _judged(found, name) -> bool:
    return bool(found[name].attrs.get("better")) and bool(np.isfinite(found[name]).any())


def _inside(values, tried):
    return (values > float(tried.min())) & (values < float(tried.max()))


def _sliced(found, name, keep):
    """The dataset at one value of every variable after the first ones, and words on where."""
    rest = found[name].dims[keep:]
    if not rest:
        return found, ""
    best = best_design(found, name) if _judged(found, name) else None
    at = {}
    words = []
    for dim in rest:
        values = np.asarray(found[dim])
        at[dim] = values.size // 2 if best is None else int(np.argmin(abs(values - best[dim])))
        look = _drawn(found, dim)
        words.append(f"{look.words.lower()} {look.text(float(values[at[dim]]), 4)}")
    return found.isel(at), f", at {', '.join(words)}"
