"""The Pareto front of two objectives: what one costs in terms of the other."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from .._core.arguments import counted
from .._core.declared import (
    NAMED,
    RATIO,
    Measured,
    Record,
    computed,
    computed_part,
    computed_word,
    held,
    reading,
    records_of,
    word,
)
from .._core.errors import BadInput
from .._core.results import Data, Result
from .._core.status import SolveFailed, Status
from ._descent import BETTER, Descent, Method, method_of
from ._goal import Goal, Interval, Limit, goal_of
from ._optimise import Callback, Keep, Search, space
from ._optimum import Optimum, SampleCount, optimum_of
from ._problem import Problem, RequestedQuantity, checked_problem, measured_by_name


@dataclasses.dataclass(frozen=True)
class FrontObjective(Record):
    """One of the two objectives of a front.

    Attributes:
        name: of the quantity.
        unit: its SI unit.
        maximised: whether it is made large.
    """

    name: str = word()
    unit: str = word()
    maximised: bool = word()


@dataclasses.dataclass(frozen=True)
class FrontVariable(Record):
    """A variable of the designs of a front.

    Attributes:
        name: of it.
        unit: its SI unit.
    """

    name: str = word()
    unit: str = word()


@dataclasses.dataclass(frozen=True)
class FrontPoint(Record):
    """A design of a front.

    Attributes:
        values: [SI] of the variables, by name.
        objectives: [SI] by name.
        exchange, status, dominated: as in `ParetoFront`, of this point.
    """

    values: dict[str, Measured] = reading(NAMED)
    objectives: dict[str, Measured] = reading(NAMED)
    exchange: float = reading(RATIO)
    status: str = word()
    dominated: bool = word()


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Result):
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
    beaten_by: int = reading("")
    ends: tuple[Optimum, Optimum] = held()
    evaluations: int = reading("")

    # `status` here has one word a point
    table_dims: ClassVar[tuple[str, ...]] = ("point",)

    @computed_part(FrontObjective, key="objectives")
    def stated_objectives(self) -> tuple[FrontObjective, ...]:
        """(2,) Name, unit and sense of each objective."""
        return records_of(
            FrontObjective, name=self.names, unit=self.units, maximised=self.maximised
        )

    @computed_part(FrontVariable, key="variables")
    def stated_variables(self) -> tuple[FrontVariable, ...]:
        """(variables,) Name and unit of each variable."""
        return records_of(
            FrontVariable, name=self.variables, unit=self.ends[0].problem.variable_units
        )

    @computed(NAMED, key="present")
    def present_objectives(self) -> dict[str, Measured]:
        """[SI] Both objectives of the design as it stands, by name."""
        return measured_by_name(self.names, self.units, self.present)

    @computed_part(FrontPoint)
    def points(self) -> tuple[FrontPoint, ...]:
        """(n,) The designs of the front."""
        variable_units = self.ends[0].problem.variable_units
        values = []
        for row in self.values:
            values.append(measured_by_name(self.variables, variable_units, row))
        objectives = [measured_by_name(self.names, self.units, row) for row in self.objectives]
        return records_of(
            FrontPoint,
            values=values,
            objectives=objectives,
            exchange=self.exchange,
            status=self.status,
            dominated=self.dominated,
        )

    @computed_word()
    def verdicts(self) -> list[str]:
        """Verdicts on either end."""
        return [end.verdict for end in self.ends]

    @computed_part(SampleCount, key="sample")
    def sample_in_short(self) -> SampleCount:
        """Numbers of designs that the front is compared with."""
        return SampleCount(len(self.ends[0].sample.ok), len(self.sample))

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has the points of the front."""
        at = self.table_dims
        names = *self.variables, *self.names
        units = *self.ends[0].problem.variable_units, *self.units
        columns = *self.values.T, *self.objectives.T
        for name, unit, column in zip(names, units, columns, strict=True):
            yield Data(name, unit, column, at)
        yield Data("exchange", "", self.exchange, at, "first objective per unit of the second")
        yield Data("dominated", "", self.dominated, at)
        yield Data("status", "", np.array(self.status), at)


def pareto(
    problem: Problem,
    objectives: tuple[RequestedQuantity, RequestedQuantity] | None = None,
    *,
    maximise: tuple[bool | None, bool | None] = (None, None),
    constraints: Mapping[RequestedQuantity, Interval] | None = None,
    points: int = 12,
    starts: int = 8,
    max_steps: int = 100,
    tolerance: float = 1e-5,
    samples: int = 256,
    seed: int = 0,
    batch: int = 1,
    callback: Callback | None = None,
    keep: Keep | None = None,
) -> ParetoFront:
    """Trace the front of two objectives by gradients; all its points move at once.

    Args:
        problem: whose variables all have ranges.
        objectives: two quantities, by name or as functions of a `DesignResult`.
        maximise: for each, as in `optimise`.
        constraints: [SI] as in `optimise`.
        points: of the front, with both ends; a front without conflict has one.
        starts: of the search for each end.
        max_steps, samples, seed, batch, callback, keep: as in `optimise`, whose steps count anew
            for each end and for the points between.
        tolerance: [-] as in `optimise`.

    Raises:
        BadInput: as `optimise`, or fewer than three points.
        SolveFailed: no design of the sample can be solved, or none keeps the constraints.
    """
    counted("points", points, 3, 10_000)
    counted("starts", starts, high=10_000)
    problem = _with_all(checked_problem(problem), objectives, maximise, constraints)
    goals = []
    for objective, sense in zip(objectives, maximise, strict=True):
        goals.append(goal_of(problem, objective, sense, constraints))
    method = method_of("slsqp", goals[0])
    ranges = goals[0].ranges
    designs = space(problem, ranges, max(samples, starts), seed)
    search = Search(goals[0].problem, designs, batch, max_steps, tolerance, callback, keep)
    ends, front = _ends(search, goals, method, starts)
    evaluations = sum(end.evaluations for end in ends)
    # The goals of the ends have the spreads over the sample.
    goals = [descent.goal for descent in front]
    places = [goal.objective for goal in goals]
    signs = np.array([goal.sign for goal in goals])
    scale = goals[0].scale[places]
    first = front[0].best.values[places[1]]
    second = front[1].best.values[places[1]]
    if abs(first - second) > BETTER * scale[1]:
        between = search.descents(_between(ends, front, points), method)
        evaluations += sum(len(descent.points) for descent in between)
        front += between
    else:
        # Both objectives are best in one design.
        front = front[:1]
    # from the best of the first objective to the best of the second
    front.sort(key=lambda descent: -signs[1] * descent.best.values[places[1]])
    values = []
    objective_values = []
    exchange = []
    status = []
    for descent in front:
        values.append(ranges.values(descent.best.share))
        objective_values.append(descent.best.values[places])
        exchange.append(_exchange(descent, goals))
        status.append(descent.status)
    reached = np.array(objective_values)
    present = np.full(2, np.nan)
    current = search.solved(problem.current[None])
    if current.ok[0]:
        present = np.asarray(current.values)[0, places]
    sample = ends[0].sample.quantities[ends[0].sample.feasible][:, places]
    shown = signs * reached / scale
    beats = np.all((signs * sample / scale)[:, None] < shown - BETTER, axis=-1)
    return ParetoFront(
        names=(goals[0].name, goals[1].name),
        units=(problem.units[places[0]], problem.units[places[1]]),
        maximised=(goals[0].sign < 0, goals[1].sign < 0),
        variables=problem.variable_names,
        values=np.array(values),
        objectives=reached,
        exchange=np.array(exchange),
        status=tuple(status),
        dominated=dominated(shown, BETTER),
        present=present,
        sample=sample,
        beaten_by=int(np.any(beats, axis=1).sum()),
        ends=(ends[0], ends[1]),
        evaluations=evaluations,
    )


def _with_all(problem: Problem, objectives, maximise, constraints) -> Problem:
    """The problem with all quantities in one order, so that one program serves both ends and the front.

    Raises:
        BadInput: as `pareto`.
    """
    if not isinstance(objectives, tuple | list) or len(set(objectives)) != 2:
        bound = 'two different quantities, such as ("mechanical_efficiency", "motor_power")'
        raise BadInput("objectives", str(objectives or "absent"), bound)
    if not isinstance(maximise, tuple | list) or len(maximise) != 2:
        raise BadInput("maximise", str(maximise), "one for each objective, such as (True, False)")
    quantities = dict.fromkeys([*objectives, *(constraints or {}), *problem.quantities])
    return Problem(problem.design, problem.variables, tuple(quantities), problem.options)


def _ends(
    search: Search, goals: list[Goal], method: Method, starts: int
) -> tuple[list[Optimum], list[Descent]]:
    """The optimum of each objective by itself, and the descent that found it.

    Raises:
        SolveFailed: no design of the sample can be solved, or none keeps the constraints.
    """
    ends = []
    front = []
    for goal, sample in map(search.sampled, goals):
        begin = [(goal, start) for start in sample.starts(starts)]
        descents = search.descents(begin, method)
        ends.append(optimum_of(goal, sample, descents))
        front.append(min(descents, key=lambda descent: descent.best.rank))
        if not ends[-1].feasible:
            raise SolveFailed(Status.not_converged, ends[-1].verdict)
    return ends, front


def _between(ends, front: list[Descent], points: int) -> list[tuple[Goal, np.ndarray]]:
    """Goals with one objective held at even levels between the ends, and where to begin.

    Levels of one objective leave bare where the other one is steep: half the points have a level of
    the second objective, the others of the first.
    """
    begin = []
    for limited, count in ((1, (points - 1) // 2), (0, (points - 2) // 2)):
        main = front[1 - limited].goal
        other = front[limited].goal
        sample = ends[1 - limited].sample
        name = other.name
        place = other.objective
        sign = other.sign
        first = front[0].best.values[place]
        second = front[1].best.values[place]
        for level in np.linspace(first, second, count + 2)[1:-1]:
            limit = Limit(name=name, place=place, side=sign, bound=float(level))
            goal = dataclasses.replace(main, limits=(*main.limits, limit))
            # the best sample that keeps this level, or the end that does
            keeps_level = sample.feasible & (sign * (sample.quantities[:, place] - level) <= 0)
            if keeps_level.any():
                objective = np.where(keeps_level, sample.objective / main.unit, np.inf)
                start = sample.values[np.argmin(objective)]
            else:
                start = main.ranges.values(front[limited].best.share)
            begin.append((goal, start))
    return begin


def _exchange(descent: Descent, goals: list[Goal]) -> float:
    """[SI] Slope of the front at one of its points, by its last limit; NaN at an end."""
    if descent.goal in goals or (slope := descent.best.price(-1)) == 0:
        return np.nan
    if descent.goal.objective == goals[0].objective:
        return slope
    return 1 / slope


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
