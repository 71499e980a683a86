"""Pictures of an optimisation: the paths of all starts, their convergence, the Pareto front."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from .._shown import Shown, shown
from ..design import Optimum, ParetoFront
from ._style import INK, legend, new_figure, note, words, ylabel

_SAMPLE, _BEST, _NOW, _BAD = "#9A9A9A", "#D55E00", "#009E73", "#CC79A7"
_STEPS = "Designs solved from this start"
_PATHS = ("#0072B2", "#56B4E9", "#E69F00", "#56437F", "#999933", "#AA4499", "#444444", "#009E73")


def optimum_figures(optimum: Optimum) -> dict[str, Figure]:
    """All pictures of an optimum, by name."""
    return {"path": optimum_path(optimum), "convergence": optimum_convergence(optimum)}


def optimum_path(optimum: Optimum) -> Figure:
    """How the starts moved: over one variable, in the plane of two, by step for more."""
    draw = {1: _line, 2: _plane}.get(len(optimum.values), _strips)
    return draw(optimum)


def optimum_convergence(optimum: Optimum) -> Figure:
    """Distance from the best objective and projected slope by step, for every start."""
    figure, axes = new_figure(2, 1, (6.4, 5.4), f"Convergence: {_title(optimum)}")
    goal = _objective(optimum)
    for number, start in enumerate(optimum.starts):
        away = np.abs(start.objectives - optimum.objective) * goal.factor
        for ax, rows in zip(axes[:, 0], (away, start.slopes), strict=True):
            known = np.where(np.isfinite(rows) & (rows > 0), rows, np.nan)
            steps = np.arange(1, start.steps + 1)
            ax.semilogy(steps, known, "o-", color=_path(number), markersize=3, linewidth=1.1)
    ylabel(axes[0, 0], f"Distance from the best, {goal.unit}".rstrip(", "))
    note(figure, "Each colour is one start.")
    ylabel(axes[1, 0], "Projected slope")
    axes[1, 0].set_xlabel(_STEPS, fontsize=9)
    return figure


def pareto_front(front: ParetoFront) -> Figure:
    """The front with both ends and the present design, over the sample."""
    title = f"Pareto front: {words(front.names[0]).lower()} and {words(front.names[1]).lower()}"
    figure, axes = new_figure(1, 1, (6.6, 4.8), title)
    ax = axes[0, 0]
    rows = zip(front.names, front.units, front.objectives.T, strict=True)
    looks = [shown(*row) for row in rows]
    scale = np.array([look.factor for look in looks])
    sample, points, present = (
        a * scale for a in (front.sample, front.objectives, np.asarray(front.present))
    )
    ax.plot(sample[:, 1], sample[:, 0], ".", color=_SAMPLE, markersize=4, alpha=0.6,
            label=f"{len(sample)} samples")  # fmt: skip
    good = ~front.dominated
    ax.plot(
        points[good, 1],
        points[good, 0],
        "o-",
        color=_PATHS[0],
        markersize=4.5,
        label="Pareto front",
    )
    if front.dominated.any():
        ax.plot(points[~good, 1], points[~good, 0], "x", color=_BAD, label="dominated")
    for place, name, shift in ((0, 0, 10), (len(points) - 1, 1, -12)):
        at = points[place, ::-1]
        ax.plot(*at, "*", color=_BEST, markersize=13)
        most = "most" if front.maximised[name] else "least"
        text = f"{most} {words(front.names[name]).lower()}"
        ax.annotate(text, at, (0, shift), textcoords="offset points", fontsize=8, color=INK,
                    ha="center", va="center")  # fmt: skip
    if np.all(np.isfinite(present)):
        _present(ax, *present[::-1])
    _limits(ax, np.concatenate([points, present[None]]))
    ax.set_xlabel(looks[1].label, fontsize=9)
    ylabel(ax, looks[0].label)
    legend(ax, loc="best")
    return figure


def _limits(ax, points) -> None:
    """Limits around the front and the present design: a wide sample would press them flat."""
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.15 * np.where(high > low, high - low, np.maximum(np.abs(high), 1e-12))
    ax.set_ylim(low[0] - margin[0], high[0] + margin[0])
    ax.set_xlim(low[1] - margin[1], high[1] + margin[1])


def _line(optimum: Optimum) -> Figure:
    figure, axes = new_figure(2, 1, (6.6, 6.0), _title(optimum))
    (ax, below), sample = axes[:, 0], optimum.sample
    (variable,), goal = _variables(optimum), _objective(optimum)
    order = np.argsort(sample.values[:, 0])
    order = order[sample.ok[order]]
    x, y = sample.values[order, 0] * variable.factor, sample.objective[order] * goal.factor
    ax.plot(x, y, color=_SAMPLE, linewidth=1.4, label=f"{len(order)} samples")
    broken = ~sample.feasible[order]
    if broken.any():
        ax.plot(x[broken], y[broken], ".", color=_BAD, markersize=5, label="breaks a constraint")
    for number, start in enumerate(optimum.starts):
        path = start.path[:, 0] * variable.factor
        value = start.objectives * goal.factor
        ax.plot(path[:1], value[:1], "o", color=_path(number), markersize=5)
        below.plot(path, np.arange(1, len(path) + 1), "o-", color=_path(number), markersize=3.5,
                   linewidth=1.1)  # fmt: skip
    (best,) = optimum.values.values()
    _best(ax, optimum, best * variable.factor, optimum.objective * goal.factor)
    present = np.asarray(optimum.problem.current)[0]
    near = np.flatnonzero(sample.values[:, 0] == present)
    if near.size and sample.ok[near[0]]:
        _present(ax, present * variable.factor, sample.objective[near[0]] * goal.factor)
    note(figure, "Each colour is one start; above its first design, below the best so far.")
    below.invert_yaxis()
    below.set_xlabel(variable.label, fontsize=9)
    ylabel(below, _STEPS)
    ylabel(ax, goal.label)
    legend(ax, loc="best")
    return figure


def _plane(optimum: Optimum) -> Figure:
    figure, axes = new_figure(1, 1, (6.8, 5.0), _title(optimum))
    ax, sample, ranges = axes[0, 0], optimum.sample, optimum.ranges
    looks, goal = _variables(optimum), _objective(optimum)
    scale = np.array([look.factor for look in looks])
    places = sample.values * scale
    if sample.ok.sum() >= 4:
        # neighbours in shares of the ranges: in units of their own one variable dwarfs the other
        mesh = Triangulation(*ranges.shares(sample.values[sample.ok]).T)
        corners = Triangulation(*places[sample.ok].T, triangles=mesh.triangles)
        filled = ax.tricontourf(corners, sample.objective[sample.ok] * goal.factor, 16,
                                cmap="Greys", alpha=0.75)  # fmt: skip
        bar = figure.colorbar(filled, ax=ax)
        bar.set_label(goal.label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
    out = sample.ok & ~sample.feasible
    if out.any():
        ax.plot(*places[out].T, ".", color=_BAD, markersize=4, label="breaks a constraint")
    if (~sample.ok).any():
        ax.plot(*places[~sample.ok].T, "x", color=_BAD, markersize=4, label="cannot be solved")
    for number, start in enumerate(optimum.starts):
        path = (start.path * scale).T
        ax.plot(*path, ".-", color=_path(number), linewidth=1.2, markersize=4)
        ax.plot(*path[:, 0], "o", color=_path(number), markersize=6, markeredgecolor="white")
    note(figure, "Each colour is one start, from its large dot; the shade is of the samples.")
    _best(ax, optimum, *(np.array(list(optimum.values.values())) * scale))
    now = np.asarray(optimum.problem.current)
    if ranges.contain(now[None])[0]:
        _present(ax, *(now * scale))
    ax.set_xlabel(looks[0].label, fontsize=9)
    ylabel(ax, looks[1].label)
    legend(ax, loc="upper left", bbox_to_anchor=(0, -0.12), ncols=3)
    return figure


def _strips(optimum: Optimum) -> Figure:
    looks, ranges = _variables(optimum), optimum.ranges
    size = (6.6, 1.6 * len(looks) + 0.6)
    figure, axes = new_figure(len(looks), 1, size, _title(optimum))
    best = list(optimum.values.values())
    for place, (ax, look) in enumerate(zip(axes[:, 0], looks, strict=True)):
        for number, start in enumerate(optimum.starts):
            steps = np.arange(1, start.steps + 1)
            ax.plot(steps, start.path[:, place] * look.factor, color=_path(number), linewidth=1.1)
        ax.axhline(best[place] * look.factor, color=_BEST, linewidth=1, linestyle="--")
        low, high = (end[place] * look.factor for end in ranges)
        ax.set_ylim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        ylabel(ax, look.label)
    axes[-1, 0].set_xlabel(_STEPS, fontsize=9)
    note(figure, "Each colour is one start; dashed: the optimum.")
    return figure


def _best(ax, optimum: Optimum, x, y) -> None:
    ax.plot(x, y, "*", color=_BEST, markersize=14, markeredgecolor="white", zorder=5, linestyle="",
            label=f"optimum, {optimum.agreeing} of {len(optimum.starts)} starts")  # fmt: skip


def _present(ax, x, y) -> None:
    ax.plot(x, y, "D", color=_NOW, markersize=6, zorder=4, linestyle="", label="present design")


def _title(optimum: Optimum) -> str:
    if optimum.objective_name == "residuals":
        return "Targets met by least squares"
    return f"{'Highest' if optimum.maximised else 'Lowest'} {words(optimum.objective_name).lower()}"


def _objective(optimum: Optimum) -> Shown:
    problem = optimum.problem
    units = dict(zip(problem.names, problem.units, strict=True))
    name = optimum.objective_name
    return shown(name, units.get(name, ""), optimum.sample.objective)


def _variables(optimum: Optimum) -> list[Shown]:
    variables, values = optimum.problem.variables, optimum.sample.values.T
    return [shown(one.name, one.unit, row) for one, row in zip(variables, values, strict=True)]


def _path(number: int) -> str:
    return _PATHS[number % len(_PATHS)]
