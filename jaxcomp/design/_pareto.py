"""The front between two objectives: what one costs in terms of the other."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .._fields import BadInput
from .._results import Data, Result
from .._status import SolveFailed, Status
from ._goal import Goal, Interval, Limit, goal_of, solved
from ._lane import STATUS
from ._methods import METHODS, method_of
from ._optimise import first_starts
from ._optimum import Optimum, optimum_of
from ._problem import Asked, Problem
from ._search import (
    BETTER,
    Callback,
    Frame,
    Search,
    begin,
    descend,
    merit,
    numbers_of,
    sampled,
    search_all,
)
from ._transform import ranges_of, scattered


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Front(Result):
    """Designs of which none is better in both objectives.

    The first is the best in the first objective, the last in the second; between them the first
    objective is optimised with the second held at even steps (epsilon constraints).

    Attributes:
        names, units: of the two objectives.
        maximised: (2,) which are made large.
        variables: names.
        values: [SI] (n, variables).
        objectives: [SI] (n, 2).
        exchange: [SI] (n,) slope of the front: change of the first objective per unit of the second, the
            multiplier of its constraint; NaN at both ends and where the level does not hold the
            search back.
        status: (n,) how each search ended; see `Start`.
        dominated: (n,) whether another one is better in one and as good in the other objective.
        present: [SI] (2,) the design as it stands; NaN if it cannot be solved.
        sample: [SI] (m, 2) objectives of all designs of the sample that keep the constraints.
        beaten_by: designs of the sample that are better than some point of the front in both.
        ends: the two optima.
        evaluations: designs solved, ends included, the sample not.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    maximised: tuple[bool, bool]
    variables: tuple[str, ...]
    values: Float[np.ndarray, "n variables"]
    objectives: Float[np.ndarray, "n 2"]
    exchange: Float[np.ndarray, " n"]
    status: tuple[str, ...]
    dominated: Bool[np.ndarray, " n"]
    present: Float[np.ndarray, "2"]
    sample: Float[np.ndarray, "m 2"]
    beaten_by: int
    ends: tuple[Optimum, Optimum]
    evaluations: int

    # `status` here has one word a point
    table_dims: ClassVar[tuple[str, ...]] = ("point",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has the points of the front."""
        at = self.table_dims
        for place, one in enumerate(self.ends[0].problem.variables):
            yield Data(one.name, one.unit, self.values[:, place], at)
        for place, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            yield Data(name, unit, self.objectives[:, place], at)
        yield Data("exchange", "", self.exchange, at, "first objective per unit of the second")
        yield Data("dominated", "", self.dominated, at)
        yield Data("status", "", np.array(self.status), at)


def pareto(
    problem: Problem,
    objectives: tuple[Asked, Asked],
    *,
    maximise: tuple[bool | None, bool | None] = (None, None),
    constraints: Mapping[Asked, Interval] | None = None,
    points: int = 12,
    starts: int = 8,
    max_steps: int = 100,
    tolerance: float = 1e-5,
    samples: int = 256,
    seed: int = 0,
    batch: int = 8,
    callback: Callback | None = None,
) -> Front:
    """Trace the front of two objectives by gradients; all its points move at once.

    Args:
        problem: whose variables all have ranges.
        objectives: two quantities, by name or as functions of a `DesignResult`.
        maximise: for each, as in `optimise`.
        constraints: [SI] as in `optimise`.
        points: of the front, with both ends; a front without conflict has one.
        starts: of the search for each end.
        max_steps, samples, seed, batch, callback: as in `optimise`, whose steps count anew
            for each end and for the points between.
        tolerance: [-] as in `optimise`.

    Raises:
        BadInput: as `optimise`, or fewer than three points.
        SolveFailed: no design of the sample can be solved, or none keeps the constraints.
    """
    if points < 3:
        raise BadInput("points", points, ">= 3")
    if starts < 1:
        raise BadInput("starts", starts, ">= 1")
    if len(objectives) != 2 or objectives[0] == objectives[1]:
        raise BadInput("objectives", str(objectives), "two different quantities")
    ranges, method = ranges_of(problem.variables), method_of(METHODS[0])
    asked = dict.fromkeys([*objectives, *(constraints or {}), *problem.quantities])
    # all quantities in one order, so that one program serves both ends and the front
    problem = Problem(problem.design, problem.variables, tuple(asked), problem.options)
    goals = [
        goal_of(problem, *pair, constraints) for pair in zip(objectives, maximise, strict=True)
    ]
    first = first_starts(problem, ranges)
    space = np.asarray(scattered(ranges, max(samples, starts), seed))
    known = sampled(goals[0], np.concatenate([first, space]), batch, callback)
    assert known.found is not None
    good = np.flatnonzero(known.found.ok)
    if not good.size:
        raise SolveFailed(Status.not_converged, f"none of {len(known.sample)} designs was solved")
    ends = []
    for goal in goals:
        numbers = numbers_of(goal, known.found, tolerance)
        frame, search = Frame(goal, method, ranges, numbers, batch), _fresh(known)
        begin(frame, search, known.sample[good[:starts]])
        search_all(frame, search, max_steps, callback)
        ends.append(optimum_of(frame, search))
        if not ends[-1].feasible:
            raise SolveFailed(Status.not_converged, ends[-1].verdict)
    front = [_end(end, goals) for end in ends]
    evaluations = sum(end.evaluations for end in ends)
    width = np.ptp([point.objectives for point in front], axis=0)
    spread = np.asarray(numbers_of(goals[0], known.found, tolerance).scale)
    if width[1] <= BETTER * spread[goals[1].objective]:
        front, points = front[:1], 2
    # Levels of one objective leave bare where the other one is steep: half the points have a level of
    # the second objective, the others of the first.
    for held, count in ((1, (points - 1) // 2), (0, (points - 2) // 2)):
        if count:
            main, other = goals[1 - held], goals[held]
            limit = Limit(other.name, other.objective, other.sign, 0.0)
            goal = Goal(main.problem, main.objective, main.sign, (), (*main.limits, limit))
            frame = Frame(goal, method, ranges, numbers_of(goal, known.found, tolerance), batch)
            levels = np.linspace(*(p.objectives[held] for p in front[:2]), count + 2)[1:-1]
            found, search = _at_levels(
                frame, levels, known, front[held].values, max_steps, callback
            )
            front += found if held else [point.swapped() for point in found]
            evaluations += search.evaluations
    return _front(problem, goals, ends, front, known, spread, batch, evaluations)


class _Point(NamedTuple):
    """A point of the front under construction; `exchange` is NaN at an end."""

    values: np.ndarray
    objectives: np.ndarray
    exchange: float
    status: str

    def swapped(self) -> "_Point":
        """With the objectives in the other order."""
        slope = 1 / self.exchange if self.exchange else np.nan
        return self._replace(objectives=self.objectives[::-1], exchange=slope)


def _fresh(known: Search) -> Search:
    return dataclasses.replace(known, done=0, evaluations=0, history={})


def _end(end: Optimum, goals) -> _Point:
    objectives = np.array([end.quantities[goal.name] for goal in goals])
    return _Point(np.array(list(end.values.values())), objectives, np.nan, end.status)


def _at_levels(frame: Frame, levels, known: Search, spare, max_steps, callback):
    """Points with the last limit of the goal at some levels, all searched at once."""
    goal, found = frame.goal, known.found
    assert found is not None
    assert goal.objective is not None
    *fixed, last = goal.limits
    starts = []
    for level in levels:
        # the best sample that keeps this level, or the end that does
        here = goal._replace(limits=(*fixed, last._replace(bound=float(level))))
        worth = merit(frame._replace(goal=here), np.asarray(found.values), np.asarray(found.ok))
        kept = np.isfinite(worth).any()
        starts.append(known.sample[np.argmin(worth)] if kept else spare)
    bounds = np.array([[*(one.bound for one in fixed), level] for level in levels])
    search = _fresh(known)
    begin(frame, search, np.stack(starts), bounds)
    descend(frame, search, max_steps, callback)
    lanes = search.lanes
    assert lanes is not None
    scale = np.asarray(frame.numbers.scale)
    # L = sign f/s_f + mu side (q - bound)/s_q
    pressure = np.asarray(lanes.multipliers)[:, -1]
    exchange = -goal.sign * last.side * pressure * scale[goal.objective] / scale[last.place]
    objectives = np.asarray(lanes.at.values)[:, [goal.objective, last.place]]
    words = [STATUS[s] for s in np.asarray(lanes.status)]
    values = np.asarray(frame.ranges.inside(lanes.free))
    return [_Point(*row) for row in zip(values, objectives, exchange, words, strict=True)], search


def _front(problem, goals, ends, points, known: Search, spread, batch, evaluations) -> Front:
    places = [goal.objective for goal in goals]
    scale = spread[places]
    signs = np.array([goal.sign for goal in goals])
    # from the best of the first objective to the best of the second
    points = sorted(points, key=lambda point: -signs[1] * point.objectives[1])
    values, objectives, exchange = (np.array(c) for c in list(zip(*points, strict=True))[:3])
    shown = signs * objectives / scale
    now = solved(problem, problem.current[None], batch)
    present = np.where(np.asarray(now.ok)[0], np.asarray(now.values)[0, places], np.nan)
    kept = ends[0].sample.feasible
    sample = ends[0].sample.quantities[kept][:, places]
    beats = np.all((signs * sample / scale)[:, None] < shown - BETTER, axis=-1)
    return Front(
        names=(goals[0].name, goals[1].name),
        units=(goals[0].unit, goals[1].unit),
        maximised=(goals[0].sign < 0, goals[1].sign < 0),
        variables=tuple(one.name for one in problem.variables),
        values=values,
        objectives=objectives,
        exchange=exchange,
        status=tuple(point.status for point in points),
        dominated=dominated(shown, BETTER),
        present=present,
        sample=sample,
        beaten_by=int(np.any(beats, axis=1).sum()),
        ends=(ends[0], ends[1]),
        evaluations=evaluations,
    )


def dominated(shown: np.ndarray, margin: float) -> np.ndarray:
    """(n,) which of some points (n, objectives), small is good, another one dominates.

    Args:
        shown: the objectives.
        margin: by how much the other has to be better in one of them; as much worse in the other does
            not save a point.
    """
    no_worse = np.all(shown[:, None] <= shown[None] + 1e-9, axis=-1)
    better = np.any(shown[:, None] < shown[None] - margin, axis=-1)
    return np.any(no_worse & better, axis=0)
