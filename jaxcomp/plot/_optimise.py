"""Pictures of an optimisation: the paths of all starts, their convergence, the Pareto front."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from .._core.display import Shown, shown
from ..study import Optimum, ParetoFront
from . import _style as style
from ._drawing import draws

_SAMPLE = "#9A9A9A"
_BEST = "#D55E00"
_NOW = "#009E73"
_BAD = "#CC79A7"
_STEPS = "Designs solved from this start"
_BREAKS = "breaks a constraint"
_PATHS = ("#0072B2", "#56B4E9", "#E69F00", "#56437F", "#999933", "#AA4499", "#444444", "#009E73")


@draws(optimum=Optimum)
def optimum_figures(optimum: Optimum) -> dict[str, Figure]:
    """All pictures of an optimum, by name."""
    return {"path": optimum_path(optimum), "convergence": optimum_convergence(optimum)}


@draws(optimum=Optimum)
def optimum_path(optimum: Optimum) -> Figure:
    """Paths of the starts: over one variable, in the plane of two, by step for more."""
    draw = {1: _line, 2: _plane}.get(len(optimum.values), _strips)
    return draw(optimum)


@draws(optimum=Optimum)
def optimum_convergence(optimum: Optimum) -> Figure:
    """Distance from the best objective and projected slope by step, for every start."""
    title = f"Convergence: {_title(optimum)}"
    figure, (above, below) = style.stacked(2, (6.4, 5.4), title)
    goal = _objective(optimum)
    for number, start in enumerate(optimum.starts):
        away = np.abs(start.objectives - optimum.objective) * goal.factor
        for ax, rows in ((above, away), (below, start.slopes)):
            positive = np.where(np.isfinite(rows) & (rows > 0), rows, np.nan)
            steps = np.arange(1, start.steps + 1)
            ax.semilogy(steps, positive, "o-", color=_path(number), markersize=3, linewidth=1.1)
    style.note(figure, "Each colour is one start.")
    above.set_ylabel(f"Distance from the best, {goal.unit}".rstrip(", "))
    below.set(xlabel=_STEPS, ylabel="Projected slope")
    return figure


@draws(front=ParetoFront)
def pareto_front(front: ParetoFront) -> Figure:
    """The front with both ends and the present design, over the sample."""
    names = [style.words(name).lower() for name in front.names]
    figure, ax = style.single((6.6, 4.8), f"Pareto front: {names[0]} and {names[1]}")
    rows = zip(front.names, front.units, front.objectives.T, strict=True)
    looks = [shown(*row).drawn for row in rows]
    # the second objective is the abscissa
    scale = _columns(looks)
    sample = scale.of(np.asarray(front.sample))[..., ::-1]
    points = scale.of(np.asarray(front.objectives))[..., ::-1]
    present = scale.of(np.asarray(front.present))[..., ::-1]
    ax.plot(*sample.T, ".", color=_SAMPLE, markersize=4, alpha=0.6, label=f"{len(sample)} samples")
    ax.plot(
        *points[~front.dominated].T, "o-", color=_PATHS[0], markersize=4.5, label="Pareto front"
    )
    if front.dominated.any():
        ax.plot(*points[front.dominated].T, "x", color=_BAD, label="dominated")
    for at, name, maximised, shift in zip(
        points[[0, -1]], names, front.maximised, (10, -12), strict=True
    ):
        ax.plot(*at, "*", color=_BEST, markersize=13)
        extreme = "most" if maximised else "least"
        ax.annotate(f"{extreme} {name}", at, (0, shift), fontsize=8, ha="center",
                    va="center", textcoords="offset points", color=style.INK)  # fmt: skip
    if np.all(np.isfinite(present)):
        _present(ax, *present)
    # around the front and the present design: a wide sample would press them flat
    near = np.concatenate([points, present[None]])
    near = near[np.all(np.isfinite(near), axis=1)]
    low = near.min(axis=0)
    high = near.max(axis=0)
    margin = 0.15 * np.where(high > low, high - low, np.maximum(np.abs(high), 1e-12))
    xlim, ylim = np.stack([low - margin, high + margin], axis=1)
    ax.set(xlim=xlim, ylim=ylim, xlabel=looks[1].label, ylabel=looks[0].label)
    style.legend(ax, loc="best")
    return figure


def _columns(looks: Sequence[Shown]) -> Shown:
    """Format of the columns of a table of numbers."""
    return Shown("", "", *np.array([(look.factor, look.zero) for look in looks]).T)


def _line(optimum: Optimum) -> Figure:
    figure, (above, below) = style.stacked(2, (6.6, 6.0), _title(optimum))
    (variable,) = _variables(optimum)
    goal = _objective(optimum)
    sample = optimum.sample
    order = np.argsort(sample.values[:, 0])
    order = order[sample.ok[order]]
    x = variable.of(sample.values[order, 0])
    y = goal.of(sample.objective[order])
    above.plot(x, y, color=_SAMPLE, linewidth=1.4, label=f"{len(order)} samples")
    broken = ~sample.feasible[order]
    if broken.any():
        above.plot(x[broken], y[broken], ".", color=_BAD, markersize=5, label=_BREAKS)
    for number, start in enumerate(optimum.starts):
        path = variable.of(start.path[:, 0])
        value = goal.of(start.objectives)
        above.plot(path[:1], value[:1], "o", color=_path(number), markersize=5)
        below.plot(path, np.arange(1, len(path) + 1), "o-", color=_path(number), markersize=3.5,
                   linewidth=1.1)  # fmt: skip
    (best,) = optimum.values.values()
    _best(above, optimum, variable.of(best), goal.of(optimum.objective))
    present = np.asarray(optimum.problem.current)[0]
    if optimum.present_objective is not None:
        _present(above, variable.of(present), goal.of(optimum.present_objective))
    style.note(figure, "Each colour is one start; above its first design, below the best so far.")
    below.invert_yaxis()
    below.set(xlabel=variable.label, ylabel=_STEPS)
    above.set_ylabel(goal.label)
    style.legend(above, loc="best")
    return figure


def _plane(optimum: Optimum) -> Figure:
    figure, ax = style.single((6.8, 5.0), _title(optimum))
    sample = optimum.sample
    ranges = optimum.ranges
    looks = _variables(optimum)
    goal = _objective(optimum)
    scale = _columns(looks)
    places = scale.of(sample.values)
    if sample.ok.sum() >= 4:
        # neighbours in shares of the ranges: in units of their own one variable dwarfs the other
        mesh = Triangulation(*ranges.shares(sample.values[sample.ok]).T)
        corners = Triangulation(*places[sample.ok].T, triangles=mesh.triangles)
        filled = ax.tricontourf(corners, goal.of(sample.objective[sample.ok]), 16,
                                cmap="Greys", alpha=0.75)  # fmt: skip
        style.colour_bar(ax, filled, goal.label)
    out = sample.ok & ~sample.feasible
    if out.any():
        ax.plot(*places[out].T, ".", color=_BAD, markersize=4, label=_BREAKS)
    if (~sample.ok).any():
        ax.plot(*places[~sample.ok].T, "x", color=_BAD, markersize=4, label="cannot be solved")
    for number, start in enumerate(optimum.starts):
        path = scale.of(start.path).T
        ax.plot(*path, ".-", color=_path(number), linewidth=1.2, markersize=4)
        ax.plot(*path[:, 0], "o", color=_path(number), markersize=6, markeredgecolor="white")
    style.note(figure, "Each colour is one start, from its large dot; the shade is of the samples.")
    _best(ax, optimum, *scale.of(np.array(list(optimum.values.values()))))
    present = np.asarray(optimum.problem.current)
    if ranges.contain(present[None])[0]:
        _present(ax, *scale.of(present))
    ax.set(xlabel=looks[0].label, ylabel=looks[1].label)
    style.legend(ax, loc="upper left", bbox_to_anchor=(0, -0.12), ncols=3)
    return figure


def _strips(optimum: Optimum) -> Figure:
    looks = _variables(optimum)
    ranges = optimum.ranges
    size = (6.6, 1.6 * len(looks) + 0.6)
    figure, axes = style.stacked(len(looks), size, _title(optimum))
    best = list(optimum.values.values())
    for place, (ax, look) in enumerate(zip(axes, looks, strict=True)):
        for number, start in enumerate(optimum.starts):
            steps = np.arange(1, start.steps + 1)
            ax.plot(steps, look.of(start.path[:, place]), color=_path(number), linewidth=1.1)
        ax.axhline(look.of(best[place]), color=_BEST, linewidth=1, linestyle="--")
        low = look.of(ranges.low[place])
        high = look.of(ranges.high[place])
        ax.set_ylim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        ax.set_ylabel(look.label)
    axes[-1].set_xlabel(_STEPS)
    style.note(figure, f"Each colour is one start; dashed: the {optimum.label.lower()} design.")
    return figure


def _best(ax, optimum: Optimum, x, y) -> None:
    look = {"zorder": 5, "linestyle": ""}
    if not optimum.feasible:
        label = "nearest design, breaks a constraint"
        ax.plot(x, y, "X", color=_BAD, markersize=11, markeredgecolor="black", label=label, **look)
        return
    label = f"optimum, {optimum.agreeing} of {len(optimum.starts)} starts"
    ax.plot(x, y, "*", color=_BEST, markersize=14, markeredgecolor="white", label=label, **look)


def _present(ax, x, y) -> None:
    ax.plot(x, y, "D", color=_NOW, markersize=6, zorder=4, linestyle="", label="present design")


def _title(optimum: Optimum) -> str:
    if not optimum.feasible:
        return "No design found keeps the limits"
    if optimum.objective_name == "residuals":
        return "Targets met by least squares"
    which = "Highest" if optimum.maximised else "Lowest"
    return f"{which} {style.words(optimum.objective_name).lower()}"


def _objective(optimum: Optimum) -> Shown:
    problem = optimum.problem
    name = optimum.objective_name
    return shown(name, problem.unit_of.get(name, ""), optimum.sample.objective).drawn


def _variables(optimum: Optimum) -> list[Shown]:
    variables = optimum.problem.variables
    values = optimum.sample.values.T
    columns = []
    for variable, row in zip(variables, values, strict=True):
        columns.append(shown(variable.name, variable.unit, row).drawn)
    return columns


def _path(number: int) -> str:
    return _PATHS[number % len(_PATHS)]
