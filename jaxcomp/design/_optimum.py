"""What a search found: the optimum and the evidence that it is one."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._results import Data, Result
from ..machine import Machine
from ._descent import BETTER, FEASIBLE, Descent, Point, Scaled
from ._problem import Problem
from ._ranges import Ranges


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
        status: "converged", "no better step" (none was found although the slope is not small: a
            kink, the edge of what can be solved, or solutions too rough), "step limit", "no feasible
            design" or "start not solvable".
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
    """The best design so far from each start, after each solved design; at the end its last one.

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

    def starts(self, count: int) -> Float[np.ndarray, "starts variables"]:
        """[SI] The best design, and the first of the others that can be solved."""
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
        status: as in `Start`, of the best start.
        feasible: whether it keeps all constraints, to a hundred-thousandth of their spread; if not, it
            breaks them least.
        stationarity: [-] largest slope of the Lagrangian over the range of a variable, in spreads of
            the objective over the sample, where no bound forbids to follow it.
        gradient: [SI] of the objective by variable, at the optimum.
        at_bound: variables that ended on a bound of their range, with "low" or "high".
        constraints: each side.
        starts: how each start ended.
        history: of all starts.
        sample: what the optimum was compared with.
        verdict: the comparison in words.
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
    history: History
    sample: Sample
    verdict: str
    local: bool
    evaluations: int

    table_dims: ClassVar[tuple[str, ...]] = ("sample",)

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


def optimum_of(scaled: Scaled, sample: Sample, descents: Sequence[Descent]) -> Optimum:
    """The result of starts that have ended."""
    goal, ranges = scaled.goal, scaled.ranges
    problem = goal.problem
    ends = [one.best for one in descents]
    best = min(range(len(ends)), key=lambda n: (not ends[n].ok, ends[n].rank))
    end, values = ends[best], ranges.values(ends[best].share)
    shares = np.stack([point.share for point in ends])
    agrees = np.max(np.abs(shares - end.share), axis=1) <= 1e-3
    starts = tuple(
        Start(
            start=one.begin,
            values=ranges.values(point.share),
            objective=_objective(scaled, point),
            violation=point.violation,
            stationarity=point.stationarity,
            status=one.status,
            steps=len(one.points),
            agrees=bool(same),
        )
        for one, point, same in zip(descents, ends, agrees, strict=True)
    )
    feasible = end.ok and end.violation <= 10 * FEASIBLE
    verdict, local = _compared(scaled, sample, end, feasible)
    names = [one.name for one in problem.variables]
    gradient = scaled.unit * end.gradient / ranges.width
    sides = {"low": end.share < 1e-4, "high": end.share > 1 - 1e-4}
    return Optimum(
        problem=problem,
        ranges=ranges,
        design=problem.designed(jnp.asarray(values)),
        values=dict(zip(names, values.tolist(), strict=True)),
        objective=starts[best].objective,
        objective_name=goal.name,
        maximised=goal.sign < 0,
        quantities=dict(zip(problem.names, end.values.tolist(), strict=True)),
        status=starts[best].status,
        feasible=feasible,
        stationarity=end.stationarity,
        gradient=dict(zip(names, gradient.tolist(), strict=True)),
        at_bound={
            name: side for side, on in sides.items() for name in np.array(names)[on].tolist()
        },
        constraints=_constrained(scaled, end),
        starts=starts,
        history=_history(scaled, descents),
        sample=sample,
        verdict=verdict,
        local=local,
        evaluations=sum(start.steps for start in starts),
    )


def _objective(scaled: Scaled, point: Point) -> float:
    """[SI] of a design; NaN if it could not be solved."""
    return float(scaled.goal.value(point.values, scaled.scale)) if point.ok else np.nan


def _history(scaled: Scaled, descents: Sequence[Descent]) -> History:
    count = max(len(one.points) for one in descents)
    paths = [one.path + [one.best] * (count - len(one.path)) for one in descents]
    column = lambda of: np.array([[of(p) for p in row] for row in zip(*paths, strict=True)])  # noqa: E731
    tried = [[p.ok for p in one.points] + [True] * (count - len(one.points)) for one in descents]
    return History(
        values=scaled.ranges.values(column(lambda point: point.share)),
        objective=column(lambda point: _objective(scaled, point)),
        violation=column(lambda point: point.violation),
        stationarity=column(lambda point: point.stationarity),
        ok=np.array(tried).T,
    )


def _compared(scaled: Scaled, sample: Sample, end: Point, feasible: bool) -> tuple[str, bool]:
    count = len(sample.ok)
    if sample.best is None:
        kept = "no better design among" if feasible else "no start and none of"
        return f"{kept} {count} samples" + ("" if feasible else " keeps all constraints"), False
    if not feasible:
        return f"no start keeps all constraints, but one of {count} samples does", True
    value = sample.objective[sample.best]
    if (_objective(scaled, end) - value) / scaled.unit > BETTER:
        return f"a local optimum: one of {count} samples is better, {value:.7g}", True
    return f"no better design among {count} samples", False


def _constrained(scaled: Scaled, end: Point) -> tuple[Constrained, ...]:
    out = []
    for limit, over, pressure in zip(scaled.goal.limits, end.limits, end.multipliers, strict=True):
        # L = f/unit + mu side (q - bound)/scale, so d f/d bound = -unit mu side/scale
        multiplier = -scaled.unit * pressure * (limit.side or 1) / scaled.scale[limit.place]
        broken = float(over if limit.side else abs(over))
        out.append(
            Constrained(
                name=limit.name,
                side={1: "upper", -1: "lower", 0: "equal"}[limit.side],
                bound=limit.bound,
                value=float(end.values[limit.place]),
                active=limit.side == 0 or bool(pressure > 0),
                multiplier=float(multiplier),
                violation=broken if broken > 10 * FEASIBLE else 0.0,
            )
        )
    return tuple(out)
