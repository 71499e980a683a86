"""Work-precision diagrams: error over run time, a curve for each method."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..work_precision import Extreme, Report, SceneCost
from ._style import INK, legend, new_figure, ylabel

_TINTS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56437F", "#56B4E9", "#CC79A7", "#444444",
          "#999933", "#AA4499")  # fmt: skip
_MARKS = "osD^vP<>X*"


def accuracy_figures(report: Report, error: float | None = None) -> dict[str, Figure]:
    """All pictures of a study, by name.

    Args:
        report: of `jaxcomp.work_precision.accuracy`.
        error: [-] the requested error, marked in the diagram.
    """
    figures = {f"accuracy-{report.study}": work_precision_diagram(report, error)}
    if report.orders:
        figures["orders"] = order_diagram(report)
    return figures


def work_precision_diagram(report: Report, error: float | None = None) -> Figure:
    """Relative error over run time in logarithms.

    Lines join the settings of a method that no other of its settings beats. Nothing is claimed
    within the shaded floor, the disagreement of the two reference methods.

    Args:
        report: of `accuracy`.
        error: [-] that is wanted, drawn as a line; absent: none.
    """
    title = f"{report.scene}: error in {report.quantity.replace('_', ' ')} against run time"
    figure, axes = new_figure(1, 1, (7.4, 4.8), title)
    ax = axes[0, 0]
    for place, method in enumerate(report.methods):
        look = {"color": _TINTS[place % len(_TINTS)], "marker": _MARKS[place % len(_MARKS)]}
        rows = [row for row in report.rows if row.method == method and np.isfinite(row.error)]
        if not rows:
            continue
        points = _points(report, rows)
        ax.plot(*points, linestyle="none", markersize=4, alpha=0.45, **look)
        ax.plot(*_points(report, report.curve(method)), linewidth=1.5, markersize=5, label=method,
                **look)  # fmt: skip
    ax.plot([], [], "o", color="#888888", markersize=4, alpha=0.45, label="other settings")
    _logarithmic(ax)
    floor = report.reference.floor
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, floor / 3), high)
    ax.axhspan(min(low, floor / 3), floor, color="#EEEEEE", zorder=0,
               label="error of the reference")  # fmt: skip
    if error is not None:
        ax.axhline(error, color="#888888", linewidth=0.9, linestyle="--", zorder=1,
                   label="error wanted")  # fmt: skip
        best = report.cheapest(error)
        if best is not None:
            place = best.seconds * 1e3, report.claimed(best)
            ax.plot(*place, "o", markersize=12, markerfacecolor="none", markeredgecolor=INK,
                    label=f"cheapest for {error:g}")  # fmt: skip
    ax.set_xlabel("Run time of a warm call, ms", fontsize=9)
    ylabel(ax, "Relative error")
    legend(ax, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def order_diagram(report: Report) -> Figure:
    """Error over the number of fixed steps, with the slope of each method's order beside it."""
    figure, axes = new_figure(1, 1, (7.4, 4.8), f"{report.scene}: {report.note}")
    ax = axes[0, 0]
    for place, (method, order) in enumerate(report.orders.items()):
        rows = [row for row in report.rows if row.method == method and row.error > 0]
        rows = [row for row in rows if np.isfinite(row.error) and row.iterations]
        steps, errors = (
            np.array([row.iterations for row in rows]),
            np.array([r.error for r in rows]),
        )
        tint, mark = _TINTS[place % len(_TINTS)], _MARKS[place % len(_MARKS)]
        label = f"{method}: order {order.expected}, found {order.observed:.2f}"
        ax.plot(steps, errors, color=tint, marker=mark, markersize=4, label=label)
        above = np.flatnonzero(errors > 1e-13)
        if above.size:
            last = above[-1]
            ideal = errors[last] * (steps[last] / steps) ** order.expected
            ax.plot(steps, np.where(ideal > 1e-15, ideal, np.nan), ":", color=tint, linewidth=1.0)
    ax.plot([], [], ":", color=INK, linewidth=1.0, label="slope of the order")
    _logarithmic(ax)
    ax.set_xlabel("Steps", fontsize=9)
    ylabel(ax, "Relative error of the speed at the end")
    legend(ax, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def extreme_errors(cases: Sequence[Extreme], title: str) -> Figure:
    """Error of every extreme case in logarithms; cases without a value are crossed out.

    Args:
        cases: of `extremes`.
        title: of the picture.
    """
    size = (8.6, 1.4 + 0.24 * len(cases))
    figure, ((ax,),) = new_figure(1, 1, size, f"{title}: errors at its extremes")
    families = list(dict.fromkeys(case.family for case in cases))
    place = np.arange(len(cases))[::-1]
    for number, case in zip(place, cases, strict=True):
        tint = _TINTS[families.index(case.family) % len(_TINTS)]
        if case.good:
            errors = [case.error] if case.speed_error is None else [case.error, case.speed_error]
            for error, mark in zip(errors, ("o", "|"), strict=False):
                ax.plot(max(error, 1e-16), number, mark, color=tint, markersize=6)
        else:
            ax.plot(1e-16, number, "x", color=tint, markersize=7)
    ax.set_yticks(place, [f"{case.family}, {case.setting}" for case in cases])
    ax.set_xscale("log")
    label = "Relative error (bars: of the speed; crosses: no value, named in the table)"
    ax.set_xlabel(label, fontsize=9)
    return figure


def scene_cost_bars(costs: Sequence[SceneCost], title: str) -> Figure:
    """Operations and run time of each scene, from the barest to the fullest, in logarithms.

    Args:
        costs: of `scene_costs`.
        title: of the picture.
    """
    size = (8.6, 1.2 + 0.36 * len(costs))
    figure, axes = new_figure(1, 2, size, f"{title}: cost of each part", share=False)
    place = np.arange(len(costs))[::-1]
    columns = (
        ("Operations of the program", [cost.flops for cost in costs], _TINTS[0]),
        ("Run time, ms", [cost.seconds * 1e3 for cost in costs], _TINTS[1]),
    )
    for ax, (label, values, tint) in zip(axes[0], columns, strict=True):
        ax.barh(place, values, color=tint, height=0.65)
        ax.set_xscale("log")
        ax.set_xlabel(label, fontsize=9)
        names = [cost.name if ax is axes[0, 0] else "" for cost in costs]
        ax.set_yticks(place, names)
    return figure


def _points(report: Report, rows):
    return [row.seconds * 1e3 for row in rows], [report.claimed(row) for row in rows]


def _logarithmic(ax: Axes) -> None:
    ax.set_xscale("log")
    ax.set_yscale("log")
