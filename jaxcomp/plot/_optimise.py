"""Pictures of an optimisation: the paths of all starts, their convergence, the Pareto front."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from ..design import Front, Optimum
from ._style import INK, legend, new_figure, note, words, ylabel

_SAMPLE, _BEST, _NOW, _BAD = "#9A9A9A", "#D55E00", "#009E73", "#CC79A7"
_PATHS = ("#0072B2", "#56B4E9", "#E69F00", "#56437F", "#999933", "#AA4499", "#444444", "#009E73")
# what SI values are shown in
_SHOWN = {"m": (1e3, "mm"), "rad/s": (30 / np.pi, "rpm"), "m^3": (1e6, "cm³"), "N": (1e-3, "kN")}


def optimum_figures(optimum: Optimum) -> dict[str, Figure]:
    """All pictures of an optimum, by name."""
    return {"path": optimum_path(optimum), "convergence": optimum_convergence(optimum)}


def optimum_path(optimum: Optimum) -> Figure:
    """How the starts moved: over one variable, in the plane of two, by step for more."""
    draw = {1: _line, 2: _plane}.get(len(optimum.values), _strips)
    return draw(optimum)


def optimum_convergence(optimum: Optimum) -> Figure:
    """Distance from the best objective and projected slope by step, for every start."""
    history, best = optimum.history, optimum.objective
    figure, axes = new_figure(2, 1, (6.4, 5.4), f"Convergence: {_title(optimum)}")
    for number, start in enumerate(optimum.starts):
        steps = np.arange(1, min(start.steps, len(history.ok)) + 1)
        away = np.abs(history.objective[: len(steps), number] - best)
        for ax, rows in zip(
            axes[:, 0], (away, history.stationarity[: len(steps), number]), strict=True
        ):
            shown = np.where(np.isfinite(rows) & (rows > 0), rows, np.nan)
            ax.semilogy(steps, shown, "o-", color=_path(number), markersize=3, linewidth=1.1)
    ylabel(axes[0, 0], _label(f"|{optimum.objective_name} - best|", _unit(optimum), False))
    note(figure, "Each colour is one start.")
    ylabel(axes[1, 0], "Projected slope")
    axes[1, 0].set_xlabel("Designs solved from this start", fontsize=9)
    return figure


def pareto_front(front: Front) -> Figure:
    """The front with both ends and the present design, over the sample."""
    names = [_label(name, unit) for name, unit in zip(front.names, front.units, strict=True)]
    title = f"Pareto front: {words(front.names[0]).lower()} and {words(front.names[1]).lower()}"
    figure, axes = new_figure(1, 1, (6.6, 4.8), title)
    ax = axes[0, 0]
    scale = np.array([_scale(unit)[0] for unit in front.units])
    sample, points = front.sample * scale, front.objectives * scale
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
    if np.all(np.isfinite(front.present)):
        ax.plot(
            *(front.present * scale)[::-1], "D", color=_NOW, markersize=6, label="present design"
        )
    _room(ax, np.concatenate([points, (front.present * scale)[None]]))
    ax.set_xlabel(names[1], fontsize=9)
    ylabel(ax, names[0])
    legend(ax, loc="best")
    return figure


def _room(ax, points) -> None:
    """Limits around the front and the present design: a wide sample would press them flat."""
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.15 * np.where(high > low, high - low, np.maximum(np.abs(high), 1e-12))
    ax.set_ylim(low[0] - margin[0], high[0] + margin[0])
    ax.set_xlim(low[1] - margin[1], high[1] + margin[1])


def _line(optimum: Optimum) -> Figure:
    figure, axes = new_figure(2, 1, (6.6, 6.0), _title(optimum))
    (ax, below), sample, history = axes[:, 0], optimum.sample, optimum.history
    variable = optimum.problem.variables[0]
    scale, tall = _scale(variable.unit)[0], _scale(_unit(optimum))[0]
    order = np.argsort(sample.values[:, 0])
    order = order[sample.ok[order]]
    x, y = sample.values[order, 0] * scale, sample.objective[order] * tall
    ax.plot(x, y, color=_SAMPLE, linewidth=1.4, label=f"{len(order)} samples")
    broken = ~sample.feasible[order]
    if broken.any():
        ax.plot(x[broken], y[broken], ".", color=_BAD, markersize=5, label="breaks a constraint")
    for number, start in enumerate(optimum.starts):
        path = history.values[: start.steps, number, 0] * scale
        value = history.objective[: start.steps, number] * tall
        ax.plot(path[:1], value[:1], "o", color=_path(number), markersize=5)
        below.plot(path, np.arange(1, len(path) + 1), "o-", color=_path(number), markersize=3.5,
                   linewidth=1.1)  # fmt: skip
    _marks(ax, optimum, next(iter(optimum.values.values())) * scale, optimum.objective * tall)
    present = np.asarray(optimum.problem.current)[0]
    near = np.flatnonzero(sample.values[:, 0] == present)
    if near.size and sample.ok[near[0]]:
        _now(ax, present * scale, sample.objective[near[0]] * tall)
    note(figure, "Each colour is one start; above its first design, below all of them.")
    below.invert_yaxis()
    below.set_xlabel(_label(variable.name, variable.unit), fontsize=9)
    ylabel(below, "Designs solved from this start")
    ylabel(ax, _label(optimum.objective_name, _unit(optimum)))
    legend(ax, loc="best")
    return figure


def _plane(optimum: Optimum) -> Figure:
    figure, axes = new_figure(1, 1, (6.8, 5.0), _title(optimum))
    ax, sample = axes[0, 0], optimum.sample
    variables = optimum.problem.variables
    scale = np.array([_scale(one.unit)[0] for one in variables])
    tall = _scale(_unit(optimum))[0]
    places = sample.values * scale
    if sample.ok.sum() >= 4:
        # neighbours in shares of the ranges: in units of their own one variable dwarfs the other
        mesh = Triangulation(*(sample.values[sample.ok] / np.asarray(optimum.ranges.width)).T)
        corners = Triangulation(*places[sample.ok].T, triangles=mesh.triangles)
        filled = ax.tricontourf(corners, sample.objective[sample.ok] * tall, 16, cmap="Greys",
                                alpha=0.75)  # fmt: skip
        bar = figure.colorbar(filled, ax=ax)
        bar.set_label(_label(optimum.objective_name, _unit(optimum)), fontsize=9)
        bar.ax.tick_params(labelsize=8)
    out = sample.ok & ~sample.feasible
    if out.any():
        ax.plot(*places[out].T, ".", color=_BAD, markersize=4, label="breaks a constraint")
    if (~sample.ok).any():
        ax.plot(*places[~sample.ok].T, "x", color=_BAD, markersize=4, label="cannot be solved")
    for number in range(len(optimum.starts)):
        path = (optimum.history.values[:, number] * scale).T
        ax.plot(*path, ".-", color=_path(number), linewidth=1.2, markersize=4)
        ax.plot(*path[:, 0], "o", color=_path(number), markersize=6, markeredgecolor="white")
    note(figure, "Each colour is one start, from its large dot; the shade is of the samples.")
    _marks(ax, optimum, *(np.array(list(optimum.values.values())) * scale))
    now = np.asarray(optimum.problem.current)
    if np.all((now >= np.asarray(optimum.ranges.low)) & (now <= np.asarray(optimum.ranges.high))):
        _now(ax, *(now * scale))
    ax.set_xlabel(_label(variables[0].name, variables[0].unit), fontsize=9)
    ylabel(ax, _label(variables[1].name, variables[1].unit))
    legend(ax, loc="upper left", bbox_to_anchor=(0, -0.12), ncols=3)
    return figure


def _strips(optimum: Optimum) -> Figure:
    variables = optimum.problem.variables
    size = (6.6, 1.6 * len(variables) + 0.6)
    figure, axes = new_figure(len(variables), 1, size, _title(optimum))
    for place, (ax, one) in enumerate(zip(axes[:, 0], variables, strict=True)):
        scale = _scale(one.unit)[0]
        for number, start in enumerate(optimum.starts):
            rows = optimum.history.values[: start.steps, number, place] * scale
            ax.plot(np.arange(1, len(rows) + 1), rows, color=_path(number), linewidth=1.1)
        ax.axhline(optimum.values[one.name] * scale, color=_BEST, linewidth=1, linestyle="--")
        low, high = (
            np.asarray(end)[place] * scale for end in (optimum.ranges.low, optimum.ranges.high)
        )
        ax.set_ylim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        ylabel(ax, _label(one.name, one.unit))
    axes[-1, 0].set_xlabel("Designs solved from this start", fontsize=9)
    note(figure, "Each colour is one start; dashed: the optimum.")
    return figure


def _marks(ax, optimum: Optimum, x, y) -> None:
    ax.plot(x, y, "*", color=_BEST, markersize=14, markeredgecolor="white", zorder=5, linestyle="",
            label=f"optimum, {optimum.agreeing} of {len(optimum.starts)} starts")  # fmt: skip


def _now(ax, x, y) -> None:
    ax.plot(x, y, "D", color=_NOW, markersize=6, zorder=4, linestyle="", label="present design")


def _title(optimum: Optimum) -> str:
    if optimum.objective_name == "residuals":
        return "Targets met by least squares"
    return f"{'Highest' if optimum.maximised else 'Lowest'} {words(optimum.objective_name).lower()}"


def _unit(optimum: Optimum) -> str:
    problem = optimum.problem
    units = dict(zip(problem.names, problem.units, strict=True))
    return units.get(optimum.objective_name, "")


def _scale(unit: str) -> tuple[float, str]:
    return _SHOWN.get(unit, (1.0, unit))


def _label(name: str, unit: str, capital: bool = True) -> str:
    shown = _scale(unit)[1]
    name = words(name) if capital else name.replace("_", " ")
    return f"{name}, {shown}" if shown else name


def _path(number: int) -> str:
    return _PATHS[number % len(_PATHS)]
