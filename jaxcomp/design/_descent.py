r"""One start of a search, moved by an optimiser of SciPy or Optax.

Variables are shares u of their ranges. Objective f and constraints g are in spreads of their quantities
over the sample, g <= 0 or g = 0. A design is optimal to first order where no variable can lower

$$L = f + \sum_j \mu_j g_j, \qquad \mu_j \ge 0 \text{ for inequalities, } 0 \text{ where } g_j < 0,$$

but for those that a bound of their range holds (Karush, Kuhn and Tucker; Nocedal and Wright 2006,
Numerical Optimization, 2nd ed., ch. 12). The multipliers at a design are those that make the slope of L
smallest, so that they and the test of convergence do not depend on the optimiser.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import jax
import numpy as np
import optax
from jaxtyping import Float
from scipy.optimize import least_squares, lsq_linear, minimize

from .._fields import BadInput
from ._goal import Goal
from ._ranges import Ranges
from ._together import Evaluate

METHODS = ("slsqp", "least-squares", "adam")
# [-] of a constraint's spread over the sample.
FEASIBLE = 1e-6
# [-] a design counts as better beyond this share of the objective's spread: above the roughness of
# solutions with few panels (2e-5 of the spread for the efficiency over the bore).
BETTER = 1e-4
# [-] of a range: the least step; the first step; a step of Adam.
_LEAST, _FIRST, _ADAM_STEP = 1e-7, 0.25, 0.02
# A search that cannot move is at the optimum as well as the solutions are smooth if its slope is
# below this times the tolerance.
_ROUGH = 1e3
# [spreads] what a design that cannot be solved counts more than the best one, so that a line search
# goes back to a tenth of its step.
_FAILED = 1e3


class Point(NamedTuple):
    """A solved design.

    Attributes:
        share: [-] (variables,) of the ranges.
        values, slope: [SI] (quantities,) and (quantities, variables).
        ok: whether it could be solved; if not, what follows means nothing.
        objective, gradient: [-] f and its derivative (variables,).
        residuals, residuals_slope: [-] with targets, f being half the sum of the squared residuals.
        limits, limits_slope: [-] g (limits,) and its derivatives (limits, variables).
        violation: [-] of the worst constraint.
        multipliers: [-] (limits,)
        stationarity: [-] largest slope of L over a range that no bound holds.
    """

    share: Float[np.ndarray, " variables"]
    values: Float[np.ndarray, " quantities"]
    slope: Float[np.ndarray, "quantities variables"]
    ok: bool
    objective: float
    gradient: Float[np.ndarray, " variables"]
    residuals: Float[np.ndarray, " targets"]
    residuals_slope: Float[np.ndarray, "targets variables"]
    limits: Float[np.ndarray, " limits"]
    limits_slope: Float[np.ndarray, "limits variables"]
    violation: float
    multipliers: Float[np.ndarray, " limits"]
    stationarity: float

    @property
    def rank(self) -> tuple[float, float]:
        """Lower is better: first the violation, then the objective."""
        return max(self.violation, 10 * FEASIBLE), self.objective

    def optimal(self, tolerance: float) -> bool:
        """Whether it keeps the constraints and has no slope left."""
        return self.ok and self.violation <= FEASIBLE and self.stationarity <= tolerance


class Scaled(NamedTuple):
    """A goal with the scales of its numbers.

    Attributes:
        goal: objective and constraints.
        ranges: of the variables.
        scale: [SI] (quantities,) their spreads over the sample.
        tolerance: [-] of the stationarity.
    """

    goal: Goal
    ranges: Ranges
    scale: Float[np.ndarray, " quantities"]
    tolerance: float

    @property
    def unit(self) -> float:
        """[SI] by which f multiplies into the objective."""
        place = self.goal.objective
        return 1.0 if place is None else self.goal.sign * float(self.scale[place])

    def point(self, share, values, slope, ok) -> Point:
        """A design with its quantities [SI], dimensionless."""
        goal = self.goal
        values, slope = (np.where(ok, a, 0.0) for a in (values, slope))
        shown, steep = values / self.scale, slope * self.ranges.width / self.scale[:, None]
        places = [place for place, _ in goal.targets]
        residuals = shown[places] - [v / self.scale[i] for i, v in goal.targets]
        if goal.objective is None:
            objective, gradient = residuals @ residuals / 2, residuals @ steep[places]
        else:
            objective, gradient = (
                goal.sign * shown[goal.objective],
                goal.sign * steep[goal.objective],
            )
        at = [limit.place for limit in goal.limits]
        side = np.array([limit.side or 1 for limit in goal.limits], float)
        equal = np.array([limit.side == 0 for limit in goal.limits], bool)
        limits = side * (
            shown[at] - [limit.bound / self.scale[limit.place] for limit in goal.limits]
        )
        limits_slope = side[:, None] * steep[at]
        broken = np.where(equal, np.abs(limits), limits)
        multipliers = _multipliers(share, gradient, limits, limits_slope, equal)
        uphill = gradient + multipliers @ limits_slope
        left = np.max(np.abs(share - np.clip(share - uphill, 0.0, 1.0)))
        return Point(
            share, values, slope, bool(ok), float(objective), gradient, residuals, steep[places],
            limits, limits_slope, float(np.max(broken, initial=0.0)), multipliers, float(left),
        )  # fmt: skip


def _multipliers(share, gradient, limits, slope, equal) -> np.ndarray:
    """(limits,) for which the slope of L is smallest; those of the bounds are found beside them."""
    out = np.zeros(len(limits))
    active = equal | (limits >= -10 * FEASIBLE)
    if active.any():
        unit = np.eye(len(share))
        columns = np.concatenate([slope[active], -unit[share <= _LEAST], unit[share >= 1 - _LEAST]])
        least = np.zeros(len(columns))
        least[: active.sum()][equal[active]] = -np.inf
        found = lsq_linear(columns.T, -gradient, (least, np.inf), method="bvls")
        out[active] = found.x[: active.sum()]
    return out


class _Ended(Exception):
    """The search of a start has ended."""


class Descent:
    """The search from one start.

    Args:
        scaled: the goal.
        start: [SI] (variables,)
        max_steps: largest number of solved designs.

    Attributes:
        points: solved designs in turn.
        path: the best of them up to each of them.
    """

    def __init__(self, scaled: Scaled, start: Float[np.ndarray, " variables"], max_steps: int):
        self.scaled, self.begin, self.max_steps = scaled, start, max_steps
        self.points: list[Point] = []
        self.path: list[Point] = []
        self._known: dict[bytes, Point] = {}

    def run(self, method: "Method", evaluate: Evaluate) -> None:
        """Move until the optimiser, or the test of convergence, ends the search."""
        self._evaluate = evaluate
        with suppress(_Ended):
            method(self, self.scaled.ranges.shares(self.begin))

    @property
    def best(self) -> Point:
        """Where the search ended."""
        return self.path[-1]

    @property
    def status(self) -> str:
        """How it ended; see `Start`."""
        best, tolerance = self.best, self.scaled.tolerance
        limited = len(self.points) >= self.max_steps
        if not best.ok:
            return "start not solvable"
        if best.violation > 10 * FEASIBLE:
            return "step limit" if limited else "no feasible design"
        if best.stationarity <= tolerance:
            return "converged"
        if limited:
            return "step limit"
        return "converged" if best.stationarity <= _ROUGH * tolerance else "no better step"

    def at(self, share: Float[np.ndarray, " variables"]) -> Point:
        """The design at shares of the ranges, solved once.

        Raises:
            _Ended: where the search is to end here, or before the design is solved.
        """
        key = share.tobytes()
        if key in self._known:
            return self._known[key]
        if len(self.points) >= self.max_steps:
            raise _Ended
        if self.path and np.max(np.abs(share - self.best.share)) < _LEAST:
            raise _Ended
        share = np.array(share)
        values, ok, slope = self._evaluate(self.scaled.ranges.values(share))
        point = self._known[key] = self.scaled.point(share, values, slope, ok)
        self.points.append(point)
        best = self.best if self.path else point
        limit = best.rank[0], best.rank[1] + BETTER
        optimal = point.optimal(self.scaled.tolerance) and point.rank < limit
        if optimal or (point.ok and point.rank < best.rank):
            best = point
        self.path.append(best)
        if optimal or not best.ok:
            raise _Ended
        return point

    def value(self, share) -> float:
        """[-] the objective; a high value where the design cannot be solved."""
        point = self.at(share)
        return point.objective if point.ok else self.best.objective + _FAILED

    def near(self, share) -> Point:
        """The design, or the best one so far if it cannot be solved."""
        point = self.at(share)
        return point if point.ok else self.best


Method = Callable[[Descent, Float[np.ndarray, " variables"]], None]


def _slsqp(descent: Descent, start) -> None:
    """Sequential quadratic programming (Kraft 1988), for bounds and constraints."""
    limits = descent.scaled.goal.limits
    equal = np.array([limit.side == 0 for limit in limits], bool)
    kinds = {"eq": equal, "ineq": ~equal}
    constraints = [
        {
            "type": kind,
            "fun": lambda u, of=of: -descent.near(u).limits[of],
            "jac": lambda u, of=of: -descent.near(u).limits_slope[of],
        }
        for kind, of in kinds.items()
        if of.any()
    ]
    steep = np.max(np.abs(descent.near(start).gradient))
    gain = min(1.0, _FIRST / max(steep, 1e-300))
    minimize(
        lambda u: gain * descent.value(u),
        start,
        jac=lambda u: gain * descent.near(u).gradient,
        bounds=[(0, 1)] * len(start),
        constraints=constraints,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 10_000},
    )


def _least_squares(descent: Descent, start) -> None:
    """Gauss-Newton steps in a trust region that keeps bounds (Branch, Coleman and Li 1999)."""

    def residuals(u):
        point = descent.at(u)
        return point.residuals if point.ok else np.full_like(point.residuals, np.inf)

    least_squares(
        residuals,
        start,
        jac=lambda u: descent.at(u).residuals_slope,
        bounds=(0, 1),
        ftol=1e-14,
        xtol=1e-14,
        gtol=1e-14,
    )


def _first_order(transformation: optax.GradientTransformation) -> Method:
    """Steps of Optax, cut off at the bounds; half of the way back from where nothing can be solved."""
    update = jax.jit(transformation.update)

    def method(descent: Descent, start) -> None:
        here, there, state = start, start, transformation.init(start)
        while True:
            point = descent.at(there)
            if not point.ok:
                there = (here + there) / 2
                continue
            step, state = update(point.gradient, state, there)
            here, there = there, np.clip(there + np.asarray(step), 0.0, 1.0)

    return method


def method_of(method: str | optax.GradientTransformation | None, goal: Goal) -> Method:
    """A method by name, or any transformation of Optax.

    Raises:
        BadInput: no such method, or one that does not suit the goal.
    """
    if method is None:
        method = "least-squares" if goal.targets and not goal.limits else "slsqp"
    named = method if isinstance(method, str) else "a transformation of optax"
    if named == "slsqp":
        return _slsqp
    if isinstance(method, str) and method not in METHODS:
        raise BadInput("method", named, f"one of {', '.join(METHODS)}, or of optax")
    if goal.limits:
        raise BadInput("method", named, "'slsqp' with constraints")
    if named == "least-squares":
        if not goal.targets:
            raise BadInput("method", named, "'slsqp' for an objective without targets to meet")
        return _least_squares
    return _first_order(optax.adam(_ADAM_STEP) if isinstance(method, str) else method)
