"""Pictures of a sweep: curves over one variable, maps over two, clouds of samples.

They take the dataset of `jaxcomp.sweep` and show it in the units people use.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._core.display import Shown
from ..study.sweep import best_curve, best_design
from ..study.sweep._best import shown_column
from ..study.sweep._store import quantity_names, variable_names
from ..study.sweep._summary import machine_parts
from . import _style as style
from ._drawing import draws

if TYPE_CHECKING:
    import xarray

_CURVE = "#0072B2"
_BEST = "#D55E00"
# Points of a cloud that still can be told apart.
_CLOUD = 20_000
# Values of the second variable up to which a picture of one curve each can be read.
_CURVES = 12


@draws()
def sweep_figures(dataset: "xarray.Dataset", title: str) -> dict[str, Figure]:
    """All pictures of a sweep, by name.

    Args:
        dataset: of `sweep`.
        title: what was swept.
    """
    figures = {}
    for name in quantity_names(dataset):
        dims = dataset[name].dims
        words = f"{title}: {_drawn(dataset, name).words.lower()}"
        if dims == ("sample",):
            figures[f"samples-{name}"] = sample_cloud(dataset, name, words)
        elif len(dims) == 1:
            figures[f"curve-{name}"] = sweep_curves(dataset, name, words)
        else:
            figures[f"map-{name}"] = sweep_map(dataset, name, words)
            figures[f"curves-{name}"] = sweep_curves(dataset, name, words)
            if len(dims) == 2 and _judged(dataset, name):
                figures[f"optimum-{name}"] = optimum_curve(dataset, name, words)
    return figures


@draws()
def machine_figures(dataset: "xarray.Dataset", title: str, dimension: str) -> dict[str, Figure]:
    """Every quantity of several machines beside each other, then the pictures of each by itself.

    Beside each other are all designs of each, and their middle.

    Args:
        dataset: of `sweep_machines`.
        title: what was swept.
        dimension: along which the machines stand.
    """
    machines = list(map(str, dataset[dimension].values))
    figures = {}
    for name in quantity_names(dataset):
        look = _drawn(dataset, name)
        heading = f"{title}: {look.words.lower()}"
        figure, ax = style.single((7.2, 4.2), heading)
        values = dataset[name].transpose(dimension, ...).values.reshape(len(machines), -1)
        for place, designs in enumerate(look.of(values)):
            good = designs[np.isfinite(designs)]
            # as wide as a bar, in the order of the designs
            wide = 0 * good
            if good.size > 1:
                wide = np.linspace(-0.3, 0.3, good.size)
            ax.plot(place + wide, good, "o", color=_CURVE, markersize=3.5)
            if good.size:
                ax.plot([place - 0.35, place + 0.35], [np.median(good)] * 2, color=_BEST)
        ax.set_xticks(range(len(machines)), machines)
        ax.set_ylabel(look.label)
        figures[f"machines-{name}"] = figure
    for machine, part in machine_parts(dataset, dimension).items():
        if part["ok"].dims:
            for name, figure in sweep_figures(part, f"{title}, {machine}").items():
                figures[f"{machine}-{name}"] = figure
    return figures


@draws()
def sweep_map(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """A quantity as a filled map over the first two variables, with the curve of its best values.

    The second variable is the abscissa; further ones are at the best design, or at their middle.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    found, at = _sliced(found, name, 2)
    ordinate, abscissa = found[name].dims
    y = _drawn(found, ordinate)
    x = _drawn(found, abscissa)
    z = _drawn(found, name)
    values = np.ma.masked_invalid(z.of(np.asarray(found[name])))
    figure, ax = style.single((7.2, 5.0), f"{title}{at}")
    ax.grid(False)
    px = x.of(np.asarray(found[abscissa]))
    py = y.of(np.asarray(found[ordinate]))
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
        inner = np.where(_inside(top.along, found[ordinate]), top.between, np.nan)[order]
        words = f"best {y.words.lower()}"
        ax.plot(px, y.of(inner), color=_BEST, linewidth=2.0, label=words)
        best = best_design(found, name)
        if best is not None:
            place = x.of(best[abscissa]), y.of(best[ordinate])
            ax.plot(*place, "o", color=_BEST, markeredgecolor="white", markersize=7,
                    clip_on=False, label=f"best of all, {z.text(best[name], 4)}")  # fmt: skip
    ax.set(xlabel=x.label, ylabel=y.label)
    if ax.get_legend_handles_labels()[0]:
        style.legend_above(ax)
    return figure


@draws()
def sweep_curves(dataset: "xarray.Dataset", name: str, title: str) -> Figure:
    """A quantity over the first variable, with a curve for each value of the second.

    Best designs are marked. Further variables are as in `sweep_map`.

    Args:
        dataset: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    dataset, at = _sliced(dataset, name, 2)
    dims = dataset[name].dims
    x = _drawn(dataset, dims[0])
    y = _drawn(dataset, name)
    values = y.of(np.asarray(dataset[name]).reshape(dataset.sizes[dims[0]], -1))
    px = x.of(np.asarray(dataset[dims[0]]))
    order = np.argsort(px)
    px = px[order]
    values = values[order]
    figure, ax = style.single((7.2, 4.4), f"{title}{at}")
    count = values.shape[1]
    judged = _judged(dataset, name)
    columns = np.unique(np.linspace(0, count - 1, min(count, _CURVES)).round().astype(int))
    tints: Any = [_CURVE]
    if count != 1:
        tints = colormaps["viridis"](np.linspace(0, 0.9, len(columns)))
    second = None
    if len(dims) == 2:
        second = _drawn(dataset, dims[1])
    sign = -1.0 if dataset[name].attrs.get("better") == "less" else 1.0
    for tint, column in zip(tints, columns, strict=True):
        label = None
        if second is not None:
            label = second.text(float(dataset[dims[1]][column]), 4)
        curve = values[:, column]
        points = np.isfinite(curve).sum()
        line = "o-" if points <= 40 else "-"
        ax.plot(px, curve, line, color=tint, linewidth=1.5, markersize=2.5, label=label)
        if judged and points:
            top = np.nanargmax(sign * curve)
            ax.plot(px[top], curve[top], "o", color=_BEST, markersize=5.5, zorder=3)
    ylabel = y.label
    if judged:
        ylabel += " (the best is marked)"
    ax.set(xlabel=x.label, ylabel=ylabel)
    if second is not None:
        style.legend(ax, fontsize=8, title=second.words, title_fontsize=8.5, loc="center left",
                     bbox_to_anchor=(1.0, 0.5))  # fmt: skip
    return figure


@draws()
def optimum_curve(dataset: "xarray.Dataset", name: str, title: str) -> Figure:
    """The best value of the first variable over the second, and what it reaches.

    Args:
        dataset: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    ordinate, abscissa = dataset[name].dims
    top = best_curve(dataset, name)
    x = _drawn(dataset, abscissa)
    y = _drawn(dataset, ordinate)
    z = _drawn(dataset, name)
    figure, (above, below) = style.stacked(2, (7.2, 5.4), title)
    order = np.argsort(top.across)
    px = x.of(top.across[order])
    value = z.of(top.value[order])
    inner = _inside(top.along, dataset[ordinate])[order]
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


@draws()
def sample_cloud(dataset: "xarray.Dataset", name: str, title: str) -> Figure:
    """The distribution of a quantity, and the quantity over each variable.

    Args:
        dataset: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    variables = variable_names(dataset)
    y = _drawn(dataset, name)
    every = -(-dataset.sizes["sample"] // _CLOUD)
    values = y.of(np.asarray(dataset[name]))
    good = values[np.isfinite(values)]
    rows, columns = style.grid_of(len(variables) + 1, 3)
    size = (3.4 * columns, 3.1 * rows)
    figure, axes = style.new_figure(rows, columns, size, title, share=False)
    first, *clouds = style.used(axes, len(variables) + 1)
    if good.size:
        count = min(80, max(10, round(good.size**0.5)))
        first.hist(good, bins=style.bars(good, count), color=_CURVE)
        low, middle, high = np.percentile(good, [5, 50, 95])
        for level, dash in ((low, ":"), (middle, "-"), (high, ":")):
            first.axvline(level, color=_BEST, linestyle=dash, linewidth=1.2)
        style.heading(first, f"median {middle:.5g}, 5 to 95 %: {low:.5g} to {high:.5g}", 8)
    first.set(xlabel=y.label, ylabel="Designs")
    for ax, variable in zip(clouds, variables, strict=True):
        x = _drawn(dataset, variable)
        px = x.of(np.asarray(dataset[variable][::every]))
        size = 2.5 if px.size > 2000 else 5
        ax.scatter(px, values[::every], s=size, color=_CURVE, alpha=0.5, linewidths=0,
                   rasterized=True)  # fmt: skip
        ax.set(xlabel=x.label, ylabel=y.label)
    return figure


def _drawn(dataset, name: str) -> Shown:
    """Format in which a variable or quantity of a sweep is drawn."""
    return shown_column(dataset, name).drawn


def _judged(dataset, name) -> bool:
    return bool(dataset[name].attrs.get("better")) and bool(np.isfinite(dataset[name]).any())


def _inside(values, tried):
    return (values > float(tried.min())) & (values < float(tried.max()))


def _sliced(dataset, name, keep):
    """The dataset at one value of every variable after the first ones, and words on where."""
    further = dataset[name].dims[keep:]
    if not further:
        return dataset, ""
    best = None
    if _judged(dataset, name):
        best = best_design(dataset, name)
    at = {}
    words = []
    for dim in further:
        values = np.asarray(dataset[dim])
        at[dim] = values.size // 2
        if best is not None:
            at[dim] = int(np.argmin(abs(values - best[dim])))
        look = _drawn(dataset, dim)
        words.append(f"{look.words.lower()} {look.text(float(values[at[dim]]), 4)}")
    return dataset.isel(at), f", at {', '.join(words)}"
