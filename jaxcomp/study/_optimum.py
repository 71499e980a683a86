"""The best design that was found, with the evidence for it."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._core.declared import (
    BESIDE,
    NAMED,
    NUMBER,
    QUANTITY,
    Measured,
    Note,
    Record,
    computed,
    computed_part,
    held,
    part,
    reading,
    records_of,
    word,
)
from .._core.display import shown
from .._core.evidence import Check, ended
from .._core.results import Data, Result
from ..machine import Machine
from ._compared import Comparison, compare
from ._descent import BETTER, Descent
from ._goal import FEASIBLE, Goal, Point, Ranges
from ._problem import Problem, may_need, measured_by_name

_SIGNS = {"upper": "<=", "lower": ">=", "equal": "="}  # of a side


@dataclasses.dataclass(frozen=True)
class Constrained(Record):
    """One side of a constraint at the optimum.

    Attributes:
        name: of the quantity.
        side: "upper", "lower" or "equal".
        bound, value: [SI] of the quantity.
        active: whether the constraint holds the optimum back.
        multiplier: what the optimal objective gains per unit of the bound, in SI units of both.
        violation: [-] in spreads of the quantity over the sample; zero inside.
        excess: [SI] of the quantity, by which the constraint is broken; zero inside, not a number in
            results that were saved before it was told.
        unit: SI unit of the quantity; none in such results.
    """

    name: str = word()
    side: str = word()
    bound: float = reading(BESIDE)
    value: float = reading(BESIDE)
    active: bool = word()
    multiplier: float = reading(Note("in the unit of the objective over that of the quantity"))
    violation: float = reading("")
    excess: float = reading(BESIDE, default=math.nan)
    unit: str = word(default="")


@dataclasses.dataclass(frozen=True)
class Start(Record):
    """One start of a search, and its end.

    Attributes:
        start, values: [SI] (variables,) where it began and ended.
        objective: [SI] there.
        violation: [-] of the worst constraint.
        stationarity: [-] projected slope, see `Optimum`.
        status: "converged", "no better step" (none was found although the slope is not small: a
            kink, the edge of what can be solved, or solutions too rough), "step limit", "no feasible
            design" or "start not solvable".
        steps: solved designs.
        agrees: whether it ended within a thousandth of each range of the best one.
        path: [SI] (steps, variables) the best design so far, after each solved one.
        objectives: [SI] (steps,) there.
        slopes: [-] (steps,) stationarity there.
        solved: (steps,) whether the design that was tried could be solved.
    """

    start: Float[np.ndarray, " variables"] = reading(NUMBER)
    values: Float[np.ndarray, " variables"] = reading(NUMBER)
    objective: float = reading(QUANTITY)
    violation: float = reading("")
    stationarity: float = reading("")
    status: str = word()
    steps: int = reading("")
    agrees: bool = word()
    path: Float[np.ndarray, "steps variables"] = reading(NUMBER)
    objectives: Float[np.ndarray, " steps"] = reading(QUANTITY)
    slopes: Float[np.ndarray, " steps"] = reading("")
    solved: Bool[np.ndarray, " steps"] = word()


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

    def starts(self, count: int) -> Float[np.ndarray, "starts variables"]:
        """[SI] The best design, and the first of the others that can be solved."""
        # The first points of a Sobol sequence are spread evenly by themselves.
        places = np.flatnonzero(self.ok)
        if self.best is not None:
            places = np.concatenate([[self.best], places[places != self.best]])
        return self.values[places[:count]]


@dataclasses.dataclass(frozen=True)
class OptimisedVariable(Record):
    """A variable at the optimum.

    Attributes:
        name: of it.
        unit: its SI unit.
        low, high: [SI] ends of its range.
        present, value: [SI] in the design as it stands, and at the optimum.
        gradient: [SI] of the objective there.
        at_bound: "low" or "high" where it ended on a bound of its range.
    """

    name: str = word()
    unit: str = word()
    low: float = reading(BESIDE)
    high: float = reading(BESIDE)
    present: float = reading(BESIDE)
    value: float = reading(BESIDE)
    gradient: float = reading(BESIDE)
    at_bound: str | None = word()


@dataclasses.dataclass(frozen=True)
class OptimisedObjective(Record):
    """The objective at the optimum.

    Attributes:
        name: of the quantity; "residuals" with targets.
        unit: its SI unit.
        maximised: whether it was made large.
        present: [SI] of the design as it stands; `None` where it was not in the sample.
        value: [SI] at the optimum.
    """

    name: str = word()
    unit: str = word()
    maximised: bool = word()
    present: float | None = reading(BESIDE)
    value: float = reading(BESIDE)


@dataclasses.dataclass(frozen=True)
class SampleCount(Record):
    """A sample in numbers.

    Attributes:
        count: of its designs.
        feasible: those that could be solved and keep the constraints.
    """

    count: int = reading("")
    feasible: int = reading("")


@dataclasses.dataclass(frozen=True)
class SampleInShort(SampleCount):
    """A sample in numbers, with its best design.

    Attributes:
        count, feasible: as in `SampleCount`.
        solved: designs that could be solved.
        best_objective: [SI] of the best of those that keep the constraints; `None` without any.
    """

    solved: int = reading("")
    best_objective: float | None = reading(QUANTITY)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Optimum(Result):
    """The best design that was found, with the evidence for it.

    Attributes:
        problem: with all quantities of objective and constraints.
        ranges: of the variables.
        design: the best design.
        values: [SI] by variable.
        objective: [SI] there; with targets half the sum of the squared residuals, in spreads.
        objective_name: the quantity; "residuals" with targets.
        maximised: whether the objective was made large.
        quantities: [SI] all quantities of the problem there, by name.
        status: as in `Start`, of the best start; "no feasible design" if none keeps all constraints.
        feasible: whether it keeps all constraints, to a hundred-thousandth of their spread; if not, it
            is no optimum but the nearest design, which breaks them least.
        stationarity: [-] largest slope of the Lagrangian over the range of a variable, in spreads of
            the objective over the sample, where no bound forbids to follow it.
        gradient: [SI] of the objective by variable, at the optimum.
        at_bound: variables that ended on a bound of their range, with "low" or "high".
        constraints: each side.
        starts: how each start ended.
        sample: what the optimum was compared with.
        verdict: the comparison in words; of a design that is not feasible what it breaks, and by how
            much.
        local: whether a sample is better than the optimum, which only starts that are given allow.
        evaluations: designs solved (each with its derivatives) in the descent; the sample's are beside.
    """

    problem: Problem
    ranges: Ranges
    design: Machine
    values: dict[str, float]
    objective: float
    objective_name: str
    maximised: bool
    quantities: dict[str, float]
    status: str = word()
    feasible: bool = word()
    stationarity: float = reading("")
    gradient: dict[str, float] = held()
    at_bound: dict[str, str] = held()
    constraints: tuple[Constrained, ...] = part(Constrained)
    starts: tuple[Start, ...] = part(Start)
    sample: Sample = held()
    verdict: str = word()
    local: bool = word()
    evaluations: int = reading("")

    table_dims: ClassVar[tuple[str, ...]] = ("sample",)

    @computed_part(OptimisedVariable)
    def variables(self) -> tuple[OptimisedVariable, ...]:
        """(variables,) Every variable with its range, as it stands and at the optimum."""
        names = self.problem.variable_names
        return records_of(
            OptimisedVariable,
            name=names,
            unit=self.problem.variable_units,
            low=self.ranges.low,
            high=self.ranges.high,
            present=self.problem.current,
            value=map(self.values.get, names),
            gradient=map(self.gradient.get, names),
            at_bound=map(self.at_bound.get, names),
        )

    @computed_part(OptimisedObjective, key="objective")
    def objective_compared(self) -> OptimisedObjective:
        """The objective as the design stands and at the optimum."""
        return OptimisedObjective(
            name=self.objective_name,
            unit=self.problem.unit_of.get(self.objective_name, ""),
            maximised=self.maximised,
            present=self.present_objective,
            value=self.objective,
        )

    @computed(NAMED, key="quantities")
    def measured_quantities(self) -> dict[str, Measured]:
        """[SI] All quantities of the problem at the optimum, by name, each with its unit."""
        units = map(self.problem.unit_of.__getitem__, self.quantities)
        return measured_by_name(self.quantities, units, self.quantities.values())

    @computed_part(SampleInShort, key="sample")
    def sample_in_short(self) -> SampleInShort:
        """Numbers of designs of the sample could be solved, and the best of them."""
        sample = self.sample
        best = None
        if sample.best is not None:
            best = sample.objective[sample.best]
        return SampleInShort(
            count=len(sample.ok),
            feasible=sample.feasible.sum(),
            solved=sample.ok.sum(),
            best_objective=best,
        )

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of the search and of the constraints."""
        del tolerance
        answer = "kept" if self.feasible else "violated"
        return (
            ended("Search", self.status, self.status == "converged"),
            Check("Constraints", answer, bool(self.feasible), "kept"),
        )

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has the sample it was compared with."""
        problem = self.problem
        sample = self.sample
        values = np.array([*self.values.values()])
        quantities = np.array([*self.quantities.values()])
        yield from problem.columns(values, quantities, before=f"{self.label.lower()}.")
        yield Data("status", "", self.status)
        yield from self.data_of("stationarity")
        yield Data("agreeing_starts", "", f"{self.agreeing} of {len(self.starts)}")
        yield Data("verdict", "", self.verdict)
        yield from problem.columns(sample.values, sample.quantities, self.table_dims)
        yield Data("feasible", "", sample.feasible, self.table_dims)

    @property
    def label(self) -> str:
        """Heading of the design: "Optimum", or "Nearest" where none keeps the constraints."""
        return "Optimum" if self.feasible else "Nearest"

    @computed("")
    def agreeing(self) -> int:
        """Number of starts that ended at the optimum."""
        return sum(start.agrees for start in self.starts)

    @property
    def present_objective(self) -> float | None:
        """[SI] The objective of the design as it stands; `None` where it was not in the sample."""
        sample = self.sample
        places = np.flatnonzero(np.all(sample.values == np.asarray(self.problem.current), axis=1))
        if not places.size or not sample.ok[places[0]]:
            return None
        return float(sample.objective[places[0]])

    def compare(self) -> Comparison | None:
        """The design as it stands beside the optimum.

        `None` where no quantity needs a periodic state of the crank; these are compared by themselves.
        """
        problem = self.problem

        crank = any(may_need(quantity, "orbit") for quantity in problem.quantities)
        if problem.design.compressor is None or not crank:
            return None
        designs = {"Present": problem.design, self.label: self.design}
        return compare(designs, problem.options.solver, throw=False)


def optimum_of(goal: Goal, sample: Sample, descents: Sequence[Descent]) -> Optimum:
    """The result of starts that have ended."""
    problem = goal.problem
    ranges = goal.ranges
    best = min(descents, key=lambda descent: descent.best.rank)
    end = best.best
    values = ranges.values(best.best.share)
    verdict, local = _verdict(sample, end)
    names = problem.variable_names
    # From spreads and shares of ranges back to SI.
    gradient = goal.unit * end.gradient / ranges.width
    at_bound = {}
    for side, reached in (("low", end.share < 1e-4), ("high", end.share > 1 - 1e-4)):
        at_bound |= dict.fromkeys(np.array(names)[reached].tolist(), side)
    status = best.status
    if end.ok and not end.feasible:
        status = "no feasible design"
    return Optimum(
        problem=problem,
        ranges=ranges,
        design=problem.designed(jnp.asarray(values)),
        values=dict(zip(names, values.tolist(), strict=True)),
        objective=end.objective,
        objective_name=goal.name,
        maximised=goal.sign < 0,
        quantities=dict(zip(problem.names, end.values.tolist(), strict=True)),
        status=status,
        feasible=end.feasible,
        stationarity=end.stationarity,
        gradient=dict(zip(names, gradient.tolist(), strict=True)),
        at_bound=at_bound,
        constraints=_constrained(end),
        starts=tuple(_start(descent, end) for descent in descents),
        sample=sample,
        verdict=verdict,
        local=local,
        evaluations=sum(len(descent.points) for descent in descents),
    )


def _start(descent: Descent, best: Point) -> Start:
    end = descent.best
    path = descent.path
    ranges = descent.goal.ranges
    shares = []
    objectives = []
    slopes = []
    for point in path:
        shares.append(point.share)
        objectives.append(point.objective)
        slopes.append(point.stationarity)
    return Start(
        start=descent.start,
        values=ranges.values(end.share),
        objective=end.objective,
        violation=end.violation,
        stationarity=end.stationarity,
        status=descent.status,
        steps=len(descent.points),
        agrees=bool(np.max(np.abs(end.share - best.share)) <= 1e-3),
        path=ranges.values(np.stack(shares)),
        objectives=np.array(objectives),
        slopes=np.array(slopes),
        solved=np.array([point.ok for point in descent.points]),
    )


def _verdict(sample: Sample, end: Point) -> tuple[str, bool]:
    """The verdict, and whether a sample is better."""
    among = f"{len(sample.ok)} samples"
    if sample.best is None and not end.ok:
        return f"no start and none of {among} keeps all constraints", False
    if sample.best is None and not end.feasible:
        return _missed(end.goal.problem, _constrained(end)), False
    if sample.best is not None:
        value = float(sample.objective[sample.best])
        if not end.feasible:
            return f"no start keeps all constraints, but one of {among} does", True
        if (end.objective - value) / end.goal.unit > BETTER:
            return f"a local optimum: one of {among} is better, {value:.7g}", True
    return f"no better design among {among}", False


def _constrained(end: Point) -> tuple[Constrained, ...]:
    out = []
    for number, limit in enumerate(end.goal.limits):
        over = float(end.limits.values[number])
        scale = float(end.goal.scale[limit.place])
        violation = over
        if not limit.side:
            violation = abs(over)
        if violation <= 10 * FEASIBLE:
            violation = 0.0
        out.append(
            Constrained(
                name=limit.name,
                side={1: "upper", -1: "lower", 0: "equal"}[limit.side],
                bound=limit.bound,
                value=float(end.values[limit.place]),
                active=limit.side == 0 or bool(end.multipliers[number] > 0),
                multiplier=end.price(number),
                violation=violation,
                excess=violation * scale,
                unit=end.goal.problem.unit_of[limit.name],
            )
        )
    return tuple(out)


def _missed(problem: Problem, constraints: Sequence[Constrained]) -> str:
    """Which constraints the nearest design breaks, and by how much."""
    parts = []
    for constraint in constraints:
        if constraint.violation:
            name = constraint.name
            look = shown(name, problem.unit_of[name], [constraint.bound, constraint.value])
            limit = f"{name} {_SIGNS[constraint.side]} {look.text(constraint.bound)}"
            parts.append(f"{limit} by {look.difference(constraint.excess, 3).lstrip('+')}")
    return f"no design found within the ranges keeps its limits: the nearest breaks {' and '.join(parts)}"
