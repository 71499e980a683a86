"""Work-precision diagrams: error over run time, a curve for each method."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..study.accuracy import Extremes, Report
from . import _style as style
from ._drawing import draws

_TINTS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56437F", "#56B4E9", "#CC79A7", "#444444",
          "#999933", "#AA4499")  # fmt: skip
_MARKS = "osD^vP<>X*"


@draws(report=Report)
def accuracy_figures(report: Report, error: float | None = None) -> dict[str, Figure]:
    """All pictures of a study, by name.

    Args:
        report: of `jaxcomp.study.accuracy.accuracy`.
        error: [-] the requested error, marked in the diagram.
    """
    return {f"accuracy-{report.study}": work_precision_diagram(report, error)}


@draws(report=Report)
def work_precision_diagram(report: Report, error: float | None = None) -> Figure:
    """Relative error over run time in logarithms.

    Lines join the settings of a method that no other of its settings beats. Nothing is claimed
    within the shaded floor, the disagreement of the two reference methods.

    Args:
        report: of `accuracy`.
        error: [-] that is wanted, drawn as a line; absent: none.
    """
    title = f"{report.scene}: error in {report.quantity.replace('_', ' ')} against run time"
    figure, ax = style.single((7.4, 4.8), title)

    def draw(rows, **look):
        times = []
        errors = []
        for row in rows:
            times.append(row.seconds * 1e3)
            errors.append(report.claimed(row))
        ax.loglog(times, errors, **look)

    for place, method in enumerate(report.methods):
        look = _look(place)
        rows = [row for row in report.rows if row.method == method and np.isfinite(row.error)]
        if rows:
            draw(rows, linestyle="none", markersize=4, alpha=0.45, **look)
            draw(report.curve(method), linewidth=1.5, markersize=5, label=method, **look)
    ax.plot([], [], "o", color=style.GREY, markersize=4, alpha=0.45, label="other settings")
    low, high = ax.get_ylim()
    floor = report.reference.floor
    low = min(low, floor / 3)
    ax.set_ylim(low, high)
    ax.axhspan(low, floor, color="#EEEEEE", zorder=0, label="error of the reference")
    if error is not None:
        ax.axhline(error, color=style.GREY, linewidth=0.9, linestyle="--", zorder=1,
                   label="error wanted")  # fmt: skip
        best = report.cheapest(error)
        if best is not None:
            draw([best], marker="o", markersize=12, markerfacecolor="none", linestyle="none",
                 markeredgecolor=style.INK, label=f"cheapest for {error:g}")  # fmt: skip
    ax.set(xlabel="Run time of a warm call, ms", ylabel="Relative error")
    style.legend(ax, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


@draws(extremes=Extremes)
def extreme_errors(extremes: Extremes) -> Figure:
    """Error of every extreme case in logarithms; cases without a value are crossed out.

    Args:
        extremes: of `jaxcomp.study.accuracy.extremes`.
    """
    cases = extremes.cases
    size = (8.6, 1.4 + 0.24 * len(cases))
    figure, ax = style.single(size, f"{extremes.scene}: errors at its extremes")
    families = list(dict.fromkeys(case.family for case in cases))
    labels = [f"{case.family}, {case.setting}" for case in cases]
    place = np.arange(len(cases))[::-1]
    for number, case in zip(place, cases, strict=True):
        tint = _look(families.index(case.family))["color"]
        marks = {"x": 1e-16}
        if case.good:
            marks = {"o": case.error, "|": case.speed_error}
        for mark, error in marks.items():
            if error is not None:
                size = 7 if mark == "x" else 6
                ax.semilogx(max(error, 1e-16), number, mark, color=tint, markersize=size)
    ax.set_yticks(place, labels)
    ax.set_xlabel("Relative error (bars: of the speed; crosses: no value, named in the table)")
    return figure


def _look(place: int) -> dict[str, Any]:
    return {"color": _TINTS[place % len(_TINTS)], "marker": _MARKS[place % len(_MARKS)]}
