"""The best design that was found, with the evidence for it."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._core.display import shown
from .._core.nested import fields_of, records
from .._core.results import Data, Result
from ..machine import Machine
from ._compared import Comparison, compare
from ._descent import BETTER, Descent
from ._goal import FEASIBLE, Goal, Point, Ranges
from ._problem import Problem, may_need

_SIGNS = {"upper": "<=", "lower": ">=", "equal": "="}  # of a side


class Constrained(NamedTuple):
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
    """

    name: str
    side: str
    bound: float
    value: float
    active: bool
    multiplier: float
    violation: float
    excess: float = math.nan


class Start(NamedTuple):
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

    start: Float[np.ndarray, " variables"]
    values: Float[np.ndarray, " variables"]
    objective: float
    violation: float
    stationarity: float
    status: str
    steps: int
    agrees: bool
    path: Float[np.ndarray, "steps variables"]
    objectives: Float[np.ndarray, " steps"]
    slopes: Float[np.ndarray, " steps"]
    solved: Bool[np.ndarray, " steps"]


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
    status: str
    feasible: bool
    stationarity: float
    gradient: dict[str, float]
    at_bound: dict[str, str]
    constraints: tuple[Constrained, ...]
    starts: tuple[Start, ...]
    sample: Sample
    verdict: str
    local: bool
    evaluations: int

    table_dims: ClassVar[tuple[str, ...]] = ("sample",)
    nested_units: ClassVar[str] = """
        variables|objective: low, high, present, value, gradient {beside}
        constraints: * {beside}
        quantities {named}; stationarity, agreeing, evaluations
        starts: start, values, path {number}; objective, objectives {quantity}
        starts: violation, stationarity, steps, slopes
        sample: count, solved, feasible; best_objective {quantity}
    """

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has the sample it was compared with."""
        problem = self.problem
        sample = self.sample
        values = np.array([*self.values.values()])
        quantities = np.array([*self.quantities.values()])
        yield from problem.columns(values, quantities, before=f"{self.label.lower()}.")
        yield Data("status", "", self.status)
        yield Data("stationarity", "", self.stationarity)
        yield Data("agreeing_starts", "", f"{self.agreeing} of {len(self.starts)}")
        yield Data("verdict", "", self.verdict)
        yield from problem.columns(sample.values, sample.quantities, self.table_dims)
        yield Data("feasible", "", sample.feasible, self.table_dims)

    def nested(self) -> dict[str, Any]:
        """Variables, objective, constraints and starts, and the sample in short."""
        problem = self.problem
        sample = self.sample
        units = problem.unit_of
        names = problem.variable_names
        constraints = []
        for constraint in self.constraints:
            constraints.append(constraint._asdict() | {"unit": units[constraint.name]})
        best_of_sample = None
        if sample.best is not None:
            best_of_sample = sample.objective[sample.best]
        return {
            "variables": records(
                name=names,
                unit=problem.variable_units,
                low=self.ranges.low,
                high=self.ranges.high,
                present=problem.current,
                value=map(self.values.get, names),
                gradient=map(self.gradient.get, names),
                at_bound=map(self.at_bound.get, names),
            ),
            "objective": {
                "name": self.objective_name,
                "unit": units.get(self.objective_name, ""),
                "maximised": self.maximised,
                "present": self.present_objective,
                "value": self.objective,
            },
            "constraints": constraints,
            **fields_of(self, "quantities", "status", "feasible", "stationarity", "verdict"),
            **fields_of(self, "local", "agreeing", "evaluations", "starts"),
            "sample": {
                "count": len(sample.ok),
                "solved": sample.ok.sum(),
                "feasible": sample.feasible.sum(),
                "best_objective": best_of_sample,
            },
        }

    @property
    def label(self) -> str:
        """Heading of the design: "Optimum", or "Nearest" where none keeps the constraints."""
        return "Optimum" if self.feasible else "Nearest"

    @property
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
