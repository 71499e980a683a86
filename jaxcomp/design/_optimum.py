"""What a search found: the optimum and the evidence that it is one."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._results import Data, Result
from ..machine import Machine
from ._lane import STATUS
from ._problem import Problem
from ._search import BETTER, FEASIBLE, Frame, Search, agreeing, lane_merit, merit
from ._transform import Ranges


class Constrained(NamedTuple):
    """One side of a constraint at the optimum.

    Attributes:
        name: of the quantity.
        side: "upper", "lower" or "equal".
        bound, value: [SI] of the quantity.
        active: whether the constraint holds the optimum back.
        multiplier: what the optimal objective gains per unit of the bound, in SI units of both.
        violation: [-] in spreads of the quantity over the sample; zero inside.
    """

    name: str
    side: str
    bound: float
    value: float
    active: bool
    multiplier: float
    violation: float


class Start(NamedTuple):
    """How one start ended.

    Attributes:
        start, values: [SI] (variables,) where it began and ended.
        objective: [SI] there.
        violation: [-] of the worst constraint.
        stationarity: [-] projected slope, see `Optimum`.
        status: "converged", "no better step" (the line search found none although the slope is not
            small: a kink, or solutions too rough), "step limit" or "no feasible design".
        steps: solved designs.
        agrees: whether it ended within a thousandth of each range of the best one.
    """

    start: Float[np.ndarray, " variables"]
    values: Float[np.ndarray, " variables"]
    objective: float
    violation: float
    stationarity: float
    status: str
    steps: int
    agrees: bool


class History(NamedTuple):
    """Accepted designs, step by step; a start that has ended stands still.

    Attributes:
        values: [SI] (steps, starts, variables).
        objective: [SI] (steps, starts).
        violation, stationarity: [-] (steps, starts).
        ok: (steps, starts) whether the design that was tried could be solved.
    """

    values: Float[np.ndarray, "steps starts variables"]
    objective: Float[np.ndarray, "steps starts"]
    violation: Float[np.ndarray, "steps starts"]
    stationarity: Float[np.ndarray, "steps starts"]
    ok: Bool[np.ndarray, "steps starts"]


class Sample(NamedTuple):
    """Designs spread evenly over the ranges.

    Attributes:
        values: [SI] (n, variables).
        quantities: [SI] (n, quantities) of the problem.
        objective: [SI] (n,).
        ok: (n,) whether the design could be solved.
        feasible: (n,) whether it also keeps the constraints.
        best: place of the best of those, `None` if there is none.
    """

    values: Float[np.ndarray, "n variables"]
    quantities: Float[np.ndarray, "n quantities"]
    objective: Float[np.ndarray, " n"]
    ok: Bool[np.ndarray, " n"]
    feasible: Bool[np.ndarray, " n"]
    best: int | None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Optimum(Result):
    """The best design that was found, with the evidence for it.

    Attributes:
        problem: with all quantities of objective and constraints.
        ranges: of the variables.
        design: the best design.
        values: [SI] by variable.
        objective: [SI] there; with targets half the sum of the squared misses, in spreads.
        objective_name: the quantity; "misses" with targets.
        maximised: whether the objective was made large.
        quantities: [SI] all quantities of the problem there, by name.
        status: as in `Start`, of the best start.
        feasible: whether it keeps all constraints, to a hundred-thousandth of their spread; if not, it
            breaks them least.
        stationarity: [-] largest change of the Lagrangian, in spreads of the objective over the sample,
            that the slope promises over the range of a variable, where a bound does not forbid it.
        gradient: [SI] of the objective by variable, at the optimum.
        at_bound: variables that ended on a bound of their range, with "low" or "high".
        constraints: each side.
        starts: how each start ended.
        history: of all starts.
        sample: what the optimum was compared with.
        verdict: the comparison in words.
        local: whether a sample remained better than the optimum.
        descents: above one if a sample was better than all starts at first.
        evaluations: designs solved (each with its derivatives) in the descent; the sample's are beside.
        search: what `optimise(resume=...)` takes; files of `save` leave it out.
    """

    problem: Problem
    ranges: Ranges
    design: Machine
    values: dict[str, float]
    objective: float
    objective_name: str
    maximised: bool
    quantities: dict[str, float]
    status: str
    feasible: bool
    stationarity: float
    gradient: dict[str, float]
    at_bound: dict[str, str]
    constraints: tuple[Constrained, ...]
    starts: tuple[Start, ...]
    history: History
    sample: Sample
    verdict: str
    local: bool
    descents: int
    evaluations: int
    search: Search

    table_dims: ClassVar[tuple[str, ...]] = ("sample",)
    not_saved: ClassVar[tuple[str, ...]] = ("search",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has the sample it was compared with."""
        problem, sample = self.problem, self.sample
        for one in problem.variables:
            yield Data(f"optimum.{one.name}", one.unit, self.values[one.name])
        for name, unit in zip(problem.names, problem.units, strict=True):
            yield Data(f"optimum.{name}", unit, self.quantities[name])
        yield Data("stationarity", "", self.stationarity)
        yield Data("agreeing_starts", "", f"{self.agreeing} of {len(self.starts)}")
        yield Data("verdict", "", self.verdict)
        for place, one in enumerate(problem.variables):
            yield Data(one.name, one.unit, sample.values[:, place], ("sample",))
        for place, (name, unit) in enumerate(zip(problem.names, problem.units, strict=True)):
            yield Data(name, unit, sample.quantities[:, place], ("sample",))
        yield Data("feasible", "", sample.feasible, ("sample",))

    @property
    def agreeing(self) -> int:
        """How many starts ended at the optimum."""
        return sum(start.agrees for start in self.starts)


def optimum_of(frame: Frame, search: Search) -> Optimum:
    """Read the result of a search that has ended."""
    goal, lanes = frame.goal, search.lanes
    assert lanes is not None
    assert search.begins is not None
    scale, problem = np.asarray(frame.numbers.scale), goal.problem
    values = np.asarray(frame.ranges.inside(lanes.free))
    found = np.asarray(lanes.at.values)
    objective, violation = goal.value(found, scale), goal.violation(found, scale)
    status = np.asarray(lanes.status)
    reached = lane_merit(frame, search)
    # without a feasible start, the one that breaks the constraints least
    solved = np.asarray(lanes.at.ok)
    lost = not np.isfinite(reached).any()
    best = int(np.argmin(np.where(solved, violation, np.inf) if lost else reached))
    same = agreeing(values, best, frame.ranges)
    starts = tuple(
        Start(*row)
        for row in zip(
            search.begins, values, objective.tolist(), violation.tolist(),
            np.asarray(lanes.stationarity).tolist(), [STATUS[s] for s in status],
            np.asarray(lanes.steps).tolist(), same.tolist(), strict=True,
        )
    )  # fmt: skip
    sample = sample_of(frame, search)
    verdict, local = _compared(frame, search, sample, reached[best])
    names = [one.name for one in problem.variables]
    slope = np.asarray(lanes.at.slope)[best]
    row = _slope(goal, found[best], slope, scale)
    share = (values[best] - np.asarray(frame.ranges.low)) / np.asarray(frame.ranges.width)
    ends = {"low": share < 1e-4, "high": share > 1 - 1e-4}
    at_bound = {n: end for end, hit in ends.items() for n, on in zip(names, hit, strict=True) if on}
    return Optimum(
        problem=problem,
        ranges=frame.ranges,
        design=problem.designed(jnp.asarray(values[best])),
        values=dict(zip(names, values[best].tolist(), strict=True)),
        objective=float(objective[best]),
        objective_name=goal.name,
        maximised=goal.sign < 0,
        quantities=dict(zip(problem.names, found[best].tolist(), strict=True)),
        status=starts[best].status,
        feasible=not lost,
        stationarity=starts[best].stationarity,
        gradient=dict(zip(names, row.tolist(), strict=True)),
        at_bound=at_bound,
        constraints=_constrained(frame, lanes, best),
        starts=starts,
        history=History(*(np.stack(search.history[name]) for name in History._fields)),
        sample=sample,
        verdict=verdict,
        local=local,
        descents=search.rounds,
        evaluations=search.evaluations,
        search=search,
    )


def sample_of(frame: Frame, search: Search) -> Sample:
    """The sample of a search, judged."""
    assert search.found is not None
    found, ok = np.asarray(search.found.values), np.asarray(search.found.ok)
    worth = merit(frame, found, ok)
    best = int(np.argmin(worth)) if np.isfinite(worth).any() else None
    objective = frame.goal.value(found, np.asarray(frame.numbers.scale))
    return Sample(search.sample, found, objective, ok, np.isfinite(worth), best)


def _compared(frame: Frame, search: Search, sample: Sample, reached: float) -> tuple[str, bool]:
    count = len(sample.ok)
    if not np.isfinite(reached):
        if sample.best is None:
            return f"no start and none of {count} samples keeps all constraints", False
        return f"no start keeps all constraints, but one of {count} samples does", True
    worth = merit(frame, sample.quantities, sample.ok)
    if np.min(worth) < reached - BETTER:
        assert sample.best is not None
        value = sample.objective[sample.best]
        return f"a local optimum: one of {count} samples is better, {value:.7g}", True
    again = ""
    if search.rounds > 1:
        again = f" (after {search.rounds - 1} more descent from samples that were better)"
    return f"no better design among {count} samples{again}", False


def _slope(goal, found, slope, scale):
    """(variables,) of the objective."""
    if goal.objective is not None:
        return slope[goal.objective]
    rows = [(found[i] - v) / scale[i] ** 2 * slope[i] for i, v in goal.targets]
    return np.sum(rows, axis=0)


def _constrained(frame: Frame, lanes, best: int) -> tuple[Constrained, ...]:
    goal, scale = frame.goal, np.asarray(frame.numbers.scale)
    out = []
    for row, limit in enumerate(goal.limits):
        value = float(lanes.at.values[best, limit.place])
        pressure = float(lanes.multipliers[best, row])
        over = (value - limit.bound) / scale[limit.place]
        over = over * limit.side if limit.side else abs(over)
        # L = sign f/s_f + mu side (q - bound)/s_q, so d f/d bound = sign s_f mu side/s_q
        unit = 1.0 if goal.objective is None else goal.sign * scale[goal.objective]
        multiplier = -unit * pressure * (limit.side or 1) / scale[limit.place]
        side = {1: "upper", -1: "lower", 0: "equal"}[limit.side]
        active = limit.side == 0 or pressure > 0
        out.append(Constrained(limit.name, side, limit.bound, value, active, float(multiplier),
                               max(float(over), 0.0) if over > FEASIBLE else 0.0))  # fmt: skip
    return tuple(out)
