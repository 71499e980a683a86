"""Pictures of a sweep: curves over one variable, maps over two, clouds of samples.

They take the dataset of `jaxcomp.sweep` and show it in the units people use.
"""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..sweeping import best_curve, best_design, shown_column
from ._style import INK, legend_above, new_figure, ylabel

if TYPE_CHECKING:
    import xarray

_CURVE, _MARK, _BEST = "#0072B2", "#D55E00", "#D55E00"
# Points of a cloud that still can be told apart.
_CLOUD = 20_000
# Values of the second variable up to which a picture of one curve each can be read.
_CURVES = 12
_CURVE_COLOURS = "viridis"


def sweep_figures(found: "xarray.Dataset", title: str) -> dict[str, Figure]:
    """All pictures of a sweep, by name.

    Args:
        found: of `sweep`.
        title: what was swept.
    """
    figures = {}
    heading = title
    for name in _quantities(found):
        dims = found[name].dims
        title = f"{heading}: {shown_column(found, name).words.lower()}"
        if dims == ("sample",):
            figures[f"samples-{name}"] = sample_cloud(found, name, title)
        elif len(dims) == 1:
            figures[f"curve-{name}"] = sweep_curves(found, name, title)
        else:
            figures[f"map-{name}"] = sweep_map(found, name, title)
            figures[f"curves-{name}"] = sweep_curves(found, name, title)
            if len(dims) == 2 and _judged(found, name):
                figures[f"optimum-{name}"] = optimum_curve(found, name, title)
    return figures


def machine_figures(found: "xarray.Dataset", title: str, dimension: str) -> dict[str, Figure]:
    """Every quantity of several machines beside each other: all designs of each, and their middle.

    Args:
        found: of `sweep_machines`.
        title: what was swept.
        dimension: along which the machines stand.
    """
    machines, figures = [str(one) for one in found[dimension].values], {}
    for name in _quantities(found):
        look = shown_column(found, name)
        figure, axes = new_figure(1, 1, (7.2, 4.2), f"{title}: {look.words.lower()}")
        ax = axes[0, 0]
        values = found[name].transpose(dimension, ...).values.reshape(len(machines), -1)
        for place, own in enumerate(values * look.factor):
            good = own[np.isfinite(own)]
            # as wide as a bar, in the order of the designs
            at = place + (
                np.linspace(-0.3, 0.3, good.size) if good.size > 1 else np.zeros(good.size)
            )
            ax.plot(at, good, "o", color=_CURVE, markersize=3.5)
            if good.size:
                ax.plot([place - 0.35, place + 0.35], [np.median(good)] * 2, color=_BEST)
        ax.set_xticks(range(len(machines)), machines)
        ylabel(ax, look.label)
        figures[f"machines-{name}"] = figure
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
    y, x, z = (shown_column(found, n) for n in (along, across, name))
    values = np.ma.masked_invalid(np.asarray(found[name]) * z.factor)
    figure, axes = new_figure(1, 1, (7.2, 5.0), f"{title}{at}")
    ax = axes[0, 0]
    ax.grid(False)
    px, py = np.asarray(found[across]) * x.factor, np.asarray(found[along]) * y.factor
    right, up = np.argsort(px), np.argsort(py)
    values, px, py = values[np.ix_(up, right)], px[right], py[up]
    if values.count() and min(values.shape) > 1:
        levels = MaxNLocator(20, steps=[1, 2, 5, 10]).tick_values(values.min(), values.max())
        if values.max() == values.min():
            levels = np.array([values.min() - 0.5, values.max() + 0.5])
        shades = ax.contourf(px, py, values, levels=levels, cmap="viridis")
        shades.hover = px, py, values.filled(np.nan), z.label  # pyright: ignore
        lines = ax.contour(px, py, values, levels=levels, colors="white", linewidths=0.5)
        ax.clabel(lines, levels[::2], fontsize=7.5, fmt="%.4g")
        bar = figure.colorbar(shades, ax=ax, pad=0.01)
        bar.set_label(z.label, fontsize=9)
        bar.ax.tick_params(labelsize=8.5)
    failed = np.ma.getmaskarray(values)
    if failed.any():
        rows, columns = np.nonzero(failed)
        ax.plot(px[columns], py[rows], "x", color="#888888", markersize=3, label="failed")
    if _judged(found, name):
        top = best_curve(found, name)
        order = np.argsort(top.across)
        at_end = ~_inside(top.along, np.asarray(found[along]))
        inner = np.where(at_end, np.nan, top.between)[order]
        words = f"best {y.words.lower()}"
        ax.plot(px, inner * y.factor, color=_BEST, linewidth=2.0, label=words)
        best = best_design(found, name)
        if best is not None:
            place = best[across] * x.factor, best[along] * y.factor
            ax.plot(*place, "o", color=_BEST, markeredgecolor="white", markersize=7,
                    clip_on=False, label=f"best of all, {z.text(best[name], 4)}")  # fmt: skip
    ax.set_xlabel(x.label, fontsize=9)
    ylabel(ax, y.label)
    if ax.get_legend_handles_labels()[0]:
        legend_above(ax)
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
    x, y = (shown_column(found, n) for n in (dims[0], name))
    values = np.asarray(found[name]).reshape(found.sizes[dims[0]], -1) * y.factor
    px = np.asarray(found[dims[0]]) * x.factor
    order = np.argsort(px)
    px, values = px[order], values[order]
    figure, axes = new_figure(1, 1, (7.2, 4.4), f"{title}{at}")
    ax = axes[0, 0]
    count = values.shape[1]
    chosen = np.unique(np.linspace(0, count - 1, min(count, _CURVES)).round().astype(int))
    from matplotlib import colormaps

    tints = [_CURVE] if count == 1 else colormaps[_CURVE_COLOURS](np.linspace(0, 0.9, len(chosen)))
    second = shown_column(found, dims[1]) if len(dims) == 2 else None
    sign = -1.0 if found[name].attrs.get("better") == "less" else 1.0
    for tint, column in zip(tints, chosen, strict=True):
        label = None if second is None else second.text(float(found[dims[1]][column]), 4)
        curve = values[:, column]
        single = np.isfinite(curve).sum() <= 40
        ax.plot(px, curve, "o-" if single else "-", color=tint, linewidth=1.5, markersize=2.5,
                label=label)  # fmt: skip
        if _judged(found, name) and np.any(np.isfinite(curve)):
            top = np.nanargmax(sign * curve)
            ax.plot(px[top], curve[top], "o", color=_MARK, markersize=5.5, zorder=3)
    ax.set_xlabel(x.label, fontsize=9)
    ylabel(ax, y.label + (" (the best is marked)" if _judged(found, name) else ""))
    if second is not None:
        ax.legend(frameon=False, fontsize=8, title=second.words, title_fontsize=8.5,
                  loc="center left", bbox_to_anchor=(1.0, 0.5))  # fmt: skip
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
    x, y, z = (shown_column(found, n) for n in (across, along, name))
    figure, axes = new_figure(2, 1, (7.2, 5.4), title)
    order = np.argsort(top.across)
    px = top.across[order] * x.factor
    inner = _inside(top.along, np.asarray(found[along]))[order]
    best, between = top.along[order] * y.factor, top.between[order] * y.factor
    ax = axes[0, 0]
    ax.plot(px, np.where(inner, between, np.nan), color=_CURVE, linewidth=1.6,
            label="between the values tried (parabola)")  # fmt: skip
    ax.plot(px, best, "o", color=_CURVE, markersize=3.5, label="of the values tried")
    if not inner.all():
        ax.plot(px[~inner], best[~inner], "o", color="#888888", markersize=4,
                label="at the end of the range")  # fmt: skip
    ylabel(ax, f"Best {y.label[:1].lower()}{y.label[1:]}")
    legend_above(ax)
    ax = axes[1, 0]
    ax.plot(px, top.value[order] * z.factor, "o-", color=_MARK, markersize=3, linewidth=1.5)
    ylabel(ax, z.label)
    ax.set_xlabel(x.label, fontsize=9)
    return figure


def sample_cloud(found: "xarray.Dataset", name: str, title: str) -> Figure:
    """The distribution of a quantity, and the quantity over each variable.

    Args:
        found: data set of `sweep`.
        name: of the quantity.
        title: of the picture.
    """
    variables = [str(n) for n in found.coords if n != "sample"]
    y = shown_column(found, name)
    every = -(-found.sizes["sample"] // _CLOUD)
    values = np.asarray(found[name]) * y.factor
    good = values[np.isfinite(values)]
    columns = min(len(variables) + 1, 3)
    rows = -(-(len(variables) + 1) // columns)
    figure, axes = new_figure(rows, columns, (3.4 * columns, 3.1 * rows), title, share=False)
    ax = axes[0, 0]
    if good.size:
        ax.hist(good, bins=min(80, max(10, round(good.size**0.5))), color=_CURVE)
        low, middle, high = np.percentile(good, [5, 50, 95])
        for level, dash in ((low, ":"), (middle, "-"), (high, ":")):
            ax.axvline(level, color=_MARK, linestyle=dash, linewidth=1.2)
        ax.set_title(f"median {middle:.5g}, 5 to 95 %: {low:.5g} to {high:.5g}", fontsize=8,
                     color=INK, loc="left")  # fmt: skip
    ax.set_xlabel(y.label, fontsize=9)
    ylabel(ax, "Designs")
    for ax, variable in zip(axes.flat[1:], variables, strict=False):
        x = shown_column(found, variable)
        px = np.asarray(found[variable][::every]) * x.factor
        size = 2.5 if px.size > 2000 else 5
        ax.scatter(px, values[::every], s=size, color=_CURVE, alpha=0.5, linewidths=0,
                   rasterized=True)  # fmt: skip
        ax.set_xlabel(x.label, fontsize=9)
        ylabel(ax, y.label)
    for ax in axes.flat[len(variables) + 1 :]:
        ax.set_visible(False)
    return figure


def _quantities(found) -> list[str]:
    return [str(name) for name in found.data_vars if name != "ok"]


def _judged(found, name) -> bool:
    return bool(found[name].attrs.get("better")) and bool(np.isfinite(found[name]).any())


def _inside(values, tried):
    return (values > tried.min()) & (values < tried.max())


def _sliced(found, name, keep):
    """The dataset at one value of every variable after the first ones, and words on where."""
    rest = found[name].dims[keep:]
    if not rest:
        return found, ""
    best = best_design(found, name) if _judged(found, name) else None
    at, words = {}, []
    for dim in rest:
        values = np.asarray(found[dim])
        at[dim] = values.size // 2 if best is None else int(np.argmin(abs(values - best[dim])))
        look = shown_column(found, dim)
        words.append(f"{look.words.lower()} {look.text(float(values[at[dim]]), 4)}")
    return found.isel(at), f", at {', '.join(words)}"
