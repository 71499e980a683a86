"""The Pareto front of two objectives: what one costs in terms of the other."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .._fields import BadInput
from .._results import Data, Result
from .._status import SolveFailed, Status
from ._descent import BETTER, Descent, Scaled, method_of
from ._goal import Interval, Limit, goal_of, solved
from ._optimise import Callback, descend, present_design, sample_of, solved_sample, spreads
from ._optimum import Optimum, optimum_of
from ._problem import Asked, Problem
from ._ranges import even_sample, ranges_of


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
    ranges = ranges_of(problem.variables)
    asked = dict.fromkeys([*objectives, *(constraints or {}), *problem.quantities])
    # all quantities in one order, so that one program serves both ends and the front
    problem = Problem(problem.design, problem.variables, tuple(asked), problem.options)
    goals = [
        goal_of(problem, *pair, constraints) for pair in zip(objectives, maximise, strict=True)
    ]
    method = method_of("slsqp", goals[0])
    space = even_sample(ranges, max(samples, starts), seed)
    designs = np.concatenate([present_design(problem, ranges), space])
    found = solved_sample(goals[0], designs, batch, callback)
    scaled = [Scaled(goal, ranges, spreads(found), tolerance) for goal in goals]

    def searched(begin: list[tuple[Scaled, np.ndarray]]) -> list[Descent]:
        descents = [Descent(*one, max_steps) for one in begin]
        descend(descents, method, batch, callback)
        return descents

    ends = []
    for one in scaled:
        sample = sample_of(one, designs, found)
        descents = searched([(one, start) for start in sample.starts(starts)])
        ends.append(optimum_of(one, sample, descents))
        if not ends[-1].feasible:
            raise SolveFailed(Status.not_converged, ends[-1].verdict)
    names = [goal.name for goal in goals]
    front = [
        _Point(
            np.array(list(end.values.values())),
            np.array([end.quantities[name] for name in names]),
            np.nan,
            end.status,
        )
        for end in ends
    ]
    places = [goal.objective for goal in goals]
    scale = scaled[0].scale[places]
    between = []
    if abs(front[0].objectives[1] - front[1].objectives[1]) > BETTER * scale[1]:
        between = _levels(scaled, front, points)
    else:
        front = front[:1]
    begin = []
    for one, end in between:
        sample = sample_of(one, designs, found)
        begin.append((one, end if sample.best is None else sample.values[sample.best]))
    descents = searched(begin) if begin else []
    front += [_between(one, places) for one in descents]
    signs = np.array([goal.sign for goal in goals])
    # from the best of the first objective to the best of the second
    front.sort(key=lambda point: -signs[1] * point.objectives[1])
    values, reached, exchange = (np.array(c) for c in list(zip(*front, strict=True))[:3])
    now = solved(problem, problem.current[None], batch)
    present = np.where(np.asarray(now.ok)[0], np.asarray(now.values)[0, places], np.nan)
    sample = ends[0].sample.quantities[ends[0].sample.feasible][:, places]
    shown = signs * reached / scale
    beats = np.all((signs * sample / scale)[:, None] < shown - BETTER, axis=-1)
    return Front(
        names=(names[0], names[1]),
        units=(goals[0].unit, goals[1].unit),
        maximised=(goals[0].sign < 0, goals[1].sign < 0),
        variables=tuple(one.name for one in problem.variables),
        values=values,
        objectives=reached,
        exchange=exchange,
        status=tuple(point.status for point in front),
        dominated=dominated(shown, BETTER),
        present=present,
        sample=sample,
        beaten_by=int(np.any(beats, axis=1).sum()),
        ends=(ends[0], ends[1]),
        evaluations=sum(end.evaluations for end in ends) + sum(len(d.points) for d in descents),
    )


class _Point(NamedTuple):
    """A point of the front under construction; `exchange` is NaN at an end."""

    values: np.ndarray
    objectives: np.ndarray
    exchange: float
    status: str


def _levels(scaled, front, points: int) -> list[tuple[Scaled, np.ndarray]]:
    """Goals with one objective held at even levels between the ends, and the end that keeps them.

    Levels of one objective leave bare where the other one is steep: half the points have a level of
    the second objective, the others of the first.
    """
    out = []
    for held, count in ((1, (points - 1) // 2), (0, (points - 2) // 2)):
        main, other = scaled[1 - held], scaled[held].goal
        for level in np.linspace(*(p.objectives[held] for p in front), count + 2)[1:-1]:
            limit = Limit(other.name, other.objective, other.sign, float(level))
            goal = main.goal._replace(limits=(*main.goal.limits, limit))
            out.append((main._replace(goal=goal), front[held].values))
    return out


def _between(descent: Descent, places) -> _Point:
    """A point of the front whose last limit holds the other objective."""
    scaled, end = descent.scaled, descent.best
    limit = scaled.goal.limits[-1]
    # L = f/unit + mu side (q - level)/scale
    slope = -scaled.unit * limit.side * end.multipliers[-1] / scaled.scale[limit.place]
    if scaled.goal.objective == places[1]:
        slope = 1 / slope if slope else np.nan
    values = scaled.ranges.values(end.share)
    return _Point(values, end.values[places], slope, descent.status)


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
