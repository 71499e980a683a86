r"""What an optimiser makes small and what it must keep, and how near to that a solved design is.

Variables are shares u of their ranges. Objective f and constraints g are in spreads of their quantities
over the sample, g <= 0 or g = 0. A design is optimal to first order where no variable can lower

$$L = f + \sum_j \mu_j g_j, \qquad \mu_j \ge 0 \text{ for inequalities, } 0 \text{ where } g_j < 0,$$

but for those that a bound of their range holds (Karush, Kuhn and Tucker; Nocedal and Wright 2006,
Numerical Optimization, 2nd ed., ch. 12). The multipliers at a design are those that make the slope of L
smallest, so that they and the test of convergence do not depend on the optimiser.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from .._core.arguments import bounds_by_names
from .._core.errors import BadInput
from ._analysis import quantity_named
from ._problem import (
    Problem,
    RequestedQuantity,
    check_traced,
    name_of,
    prepared,
    without_ranges,
)
from ._variables import Variable

Rows: TypeAlias = Float[np.ndarray, "*n variables"]
Interval = tuple[float | None, float | None]
Objective = RequestedQuantity | Mapping[RequestedQuantity, float]
# [-] of a constraint's spread over the sample.
FEASIBLE = 1e-6
# [-] of a range: nearer than this to a bound a design is on it, and no step is shorter.
SHORTEST_STEP = 1e-7


class Ranges(NamedTuple):
    """The ranges of the variables.

    Attributes:
        low, high: (variables,) in the SI units of the variables.
    """

    low: Float[np.ndarray, " variables"]
    high: Float[np.ndarray, " variables"]

    @property
    def width(self) -> Float[np.ndarray, " variables"]:
        """Width of each range."""
        return self.high - self.low

    def values(self, shares: Rows) -> Rows:
        """[SI] the variables at shares of their ranges."""
        return self.low + self.width * shares

    def shares(self, values: Rows) -> Rows:
        """[-] variables as shares of their ranges."""
        return np.clip((values - self.low) / self.width, 0.0, 1.0)

    def contain(self, values: Float[np.ndarray, "n variables"]) -> np.ndarray:
        """(n,) whether designs lie inside."""
        return np.all((values >= self.low) & (values <= self.high), axis=1)


def ranges_of(variables: tuple[Variable, ...]) -> Ranges:
    """The ranges of variables.

    Raises:
        BadInput: an end that is missing, or a range without width.
    """
    for variable in variables:
        for end in (variable.low, variable.high):
            if not math.isfinite(end):
                raise BadInput(
                    variable.name, end, "given a range with two finite ends to be optimised"
                )
        if not variable.low < variable.high:
            bound = f"given a range that rises from {variable.low:g}"
            raise BadInput(variable.name, variable.high, bound)
    return Ranges(np.array([v.low for v in variables]), np.array([v.high for v in variables]))


class Limit(NamedTuple):
    """One side of a constraint, or a target.

    Attributes:
        name: of the quantity.
        place: of the quantity in the problem.
        side: +1 for an upper, -1 for a lower bound, 0 for a value to be met.
        bound: in the unit of the quantity.
    """

    name: str
    place: int
    side: int
    bound: float


@dataclasses.dataclass(frozen=True, eq=False)
class Goal:
    """An objective and constraints on a problem; nothing here is traced.

    Attributes:
        problem: with all quantities that are needed.
        ranges: of the variables.
        objective: place of the quantity that is made small or large; `None` with targets.
        sign: +1 to make it small, -1 to make it large.
        targets: to be met in the sense of least squares.
        limits: the constraints, side by side.
        scale: [SI] (quantities,) spreads over the sample; 1 until that is solved.
        tolerance: [-] of the stationarity.
    """

    problem: Problem
    ranges: Ranges
    objective: int | None
    sign: int
    targets: tuple[Limit, ...]
    limits: tuple[Limit, ...]
    scale: Float[np.ndarray, " quantities"]
    tolerance: float = 1e-5

    @property
    def name(self) -> str:
        """Name of the objective."""
        if self.objective is None:
            return "residuals"
        return self.problem.names[self.objective]

    @property
    def unit(self) -> float:
        """[SI] by which f multiplies into the objective."""
        place = self.objective
        if place is None:
            return 1.0
        return self.sign * float(self.scale[place])

    @property
    def equalities(self) -> Bool[np.ndarray, " limits"]:
        """Which constraints are values to be met."""
        return np.array([limit.side == 0 for limit in self.limits], bool)


def goal_of(
    problem: Problem,
    objective: Objective | None,
    maximise: bool | None,
    constraints: Mapping[RequestedQuantity, Interval] | None,
) -> Goal:
    """Check an objective and constraints.

    Raises:
        BadInput: a variable without range, a quantity that the scene does not have, one that could be
            better either way, or a bound that is no number or leaves nothing.
    """
    ranges = ranges_of(problem.variables)
    quantities = list(problem.quantities)

    def place(quantity: RequestedQuantity) -> int:
        if quantity not in quantities:
            quantities.append(quantity)
        return quantities.index(quantity)

    targets = ()
    main = None
    sign = 1
    if objective is None:
        objective = problem.quantities[0]
    if isinstance(objective, Mapping):
        if not objective:
            raise BadInput("objective", "empty", "a quantity, or at least one target")
        if maximise is not None:
            raise BadInput("maximise", str(maximise), "left out with targets, which are met")
        for quantity, value in objective.items():
            targets += (_target(quantity, place(quantity), value),)
    else:
        main = place(objective)
        sign = _sign(objective, maximise)
    limits = []
    for quantity, interval in bounds_by_names("constraints", constraints).items():
        limits += _sides(name_of(quantity), place(quantity), *interval)
    rangeless = without_ranges(problem.variables)
    # Without the ranges, which are the optimiser's business: another range compiles nothing anew.
    complete = Problem(problem.design, rangeless, tuple(quantities), problem.options)
    check_traced(complete)
    return Goal(
        problem=prepared(complete),
        ranges=ranges,
        objective=main,
        sign=sign,
        targets=targets,
        limits=tuple(limits),
        scale=np.ones(len(quantities)),
    )


def _target(quantity: RequestedQuantity, place: int, value) -> Limit:
    if not math.isfinite(value):
        raise BadInput(name_of(quantity), value, "given a finite value to meet")
    return Limit(name=name_of(quantity), place=place, side=0, bound=float(value))


def _sign(quantity: RequestedQuantity, maximise: bool | None) -> int:
    if maximise is None:
        better = "less"
        if isinstance(quantity, str):
            better = quantity_named(quantity).better
        if not better:
            bound = f"given: {quantity} is not better in either direction"
            raise BadInput("maximise", "absent", bound)
        maximise = better == "more"
    return -1 if maximise else 1


def _sides(name: str, place: int, low: float | None, high: float | None) -> list[Limit]:
    limits = []
    for side, bound in ((-1, low), (1, high)):
        if bound is None:
            continue
        if not math.isfinite(bound):
            raise BadInput(name, bound, "given finite bounds, or None for no bound")
        limits.append(Limit(name=name, place=place, side=side, bound=bound))
    if not limits:
        raise BadInput(name, "without bounds", "given a lower or an upper bound")
    if low is not None and high is not None and low >= high:
        if low > high:
            raise BadInput(name, low, f"given a lower bound below the upper, here {high:g}")
        return [Limit(name=name, place=place, side=0, bound=float(low))]
    return limits


class Misses(NamedTuple):
    """Distances of quantities beyond limits or targets, in spreads.

    Attributes:
        values: [-] (limits,)
        slope: [-] (limits, variables) by shares of the ranges.
    """

    values: Float[np.ndarray, " limits"]
    slope: Float[np.ndarray, "limits variables"]


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """A solved design, measured by a goal.

    Attributes:
        goal: the goal.
        share: [-] (variables,) of the ranges.
        values: [SI] (quantities,)
        ok: whether it could be solved; if not, no other number means anything.
        slope: [SI] (quantities, variables)
    """

    goal: Goal
    share: Float[np.ndarray, " variables"]
    values: Float[np.ndarray, " quantities"]
    ok: bool
    slope: Float[np.ndarray, "quantities variables"]

    def _slope_of(self, places) -> np.ndarray:
        """[-] Derivatives of quantities in spreads by shares."""
        return self.slope[places] * self.goal.ranges.width / self.goal.scale[places, None]

    def _misses(self, limits: Iterable[Limit]) -> Misses:
        places = [limit.place for limit in limits]
        side = np.array([limit.side or 1 for limit in limits], float)
        away = self.values[places] - np.array([limit.bound for limit in limits])
        return Misses(side * away / self.goal.scale[places], side[:, None] * self._slope_of(places))

    @cached_property
    def residuals(self) -> Misses:
        """Misses of the targets, whose squares add up to 2 f."""
        return self._misses(self.goal.targets)

    @cached_property
    def limits(self) -> Misses:
        """Misses of the constraints, g."""
        return self._misses(self.goal.limits)

    @cached_property
    def f(self) -> float:
        """[-] The objective; infinite if the design could not be solved."""
        if not self.ok:
            return np.inf
        if self.goal.objective is None:
            return float(self.residuals.values @ self.residuals.values / 2)
        return float(self.values[self.goal.objective]) / self.goal.unit

    @cached_property
    def gradient(self) -> Float[np.ndarray, " variables"]:
        """[-] Of f."""
        if self.goal.objective is None:
            return self.residuals.values @ self.residuals.slope
        return self.goal.sign * self._slope_of([self.goal.objective])[0]

    @property
    def objective(self) -> float:
        """[SI] or, with targets, f."""
        place = self.goal.objective
        if not self.ok:
            return np.nan
        if place is None:
            return self.f
        return float(self.values[place])

    @cached_property
    def violation(self) -> float:
        """[-] of the worst constraint."""
        beyond = self.limits.values
        broken = np.where(self.goal.equalities, np.abs(beyond), beyond)
        return float(np.max(broken, initial=0.0))

    @cached_property
    def multipliers(self) -> Float[np.ndarray, " limits"]:
        """[-] For which the slope of L is smallest; those of bounds are found beside them."""
        beyond, slope = self.limits
        multipliers = np.zeros(len(beyond))
        equal = self.goal.equalities
        active = equal | (beyond >= -10 * FEASIBLE)
        if self.ok and active.any():
            unit = np.eye(len(self.share))
            at = self.share
            # Bounds as constraints -u <= 0 and u - 1 <= 0 with multipliers of their own.
            at_low = at <= SHORTEST_STEP
            at_high = at >= 1 - SHORTEST_STEP
            columns = np.concatenate([slope[active], -unit[at_low], unit[at_high]])
            lowest = np.zeros(len(columns))
            # Of a value to be met a multiplier has either sign.
            lowest[: active.sum()][equal[active]] = -np.inf
            from scipy.optimize import lsq_linear  # half a second, for those who search

            solution = lsq_linear(columns.T, -self.gradient, (lowest, np.inf), method="bvls")
            multipliers[active] = solution.x[: active.sum()]
        return multipliers

    def price(self, number: int) -> float:
        """[SI] What the optimal objective gains per unit of the bound of a constraint."""
        limit = self.goal.limits[number]
        multiplier = self.multipliers[number]
        # L = f + mu side (q - bound)/scale, so d f/d bound = -mu side/scale
        side = limit.side or 1
        scale = self.goal.scale[limit.place]
        return float(-self.goal.unit * multiplier * side / scale)

    @cached_property
    def stationarity(self) -> float:
        """[-] Largest slope of L over a range that no bound holds."""
        uphill = self.gradient + self.multipliers @ self.limits.slope
        # A step down the whole slope, cut off at the bounds: nothing is left where a bound holds.
        return float(np.max(np.abs(self.share - np.clip(self.share - uphill, 0.0, 1.0))))

    @property
    def feasible(self) -> bool:
        """True where the point could be solved and keeps the constraints."""
        return self.ok and self.violation <= 10 * FEASIBLE

    @property
    def rank(self) -> tuple[float, float]:
        """Lower is better: first the violation, then the objective."""
        # Whatever is feasible ranks by the objective alone.
        violation = np.inf
        if self.ok:
            violation = max(self.violation, 10 * FEASIBLE)
        return violation, self.f

    @property
    def optimal(self) -> bool:
        """True where the point keeps the constraints and has no slope left."""
        within_limits = self.ok and self.violation <= FEASIBLE
        return within_limits and self.stationarity <= self.goal.tolerance
