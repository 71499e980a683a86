r"""One start of a search, moved by an optimiser of SciPy or Optax.

Variables are shares u of their ranges. Objective f and constraints g are in spreads of their quantities
over the sample, g <= 0 or g = 0. A design is optimal to first order where no variable can lower

$$L = f + \sum_j \mu_j g_j, \qquad \mu_j \ge 0 \text{ for inequalities, } 0 \text{ where } g_j < 0,$$

but for those that a bound of their range holds (Karush, Kuhn and Tucker; Nocedal and Wright 2006,
Numerical Optimization, 2nd ed., ch. 12). The multipliers at a design are those that make the slope of L
smallest, so that they and the test of convergence do not depend on the optimiser.
"""

import dataclasses
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from .._fields import BadInput
from ._goal import Goal
from ._ranges import Ranges
from ._together import Evaluate

if TYPE_CHECKING:
    import optax


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


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """A solved design.

    Attributes:
        scaled: the goal.
        share: [-] (variables,) of the ranges.
        values: [SI] (quantities,)
        ok: whether it could be solved; if not, no other number means anything.
        slope: [SI] (quantities, variables)
    """

    scaled: Scaled
    share: Float[np.ndarray, " variables"]
    values: Float[np.ndarray, " quantities"]
    ok: bool
    slope: Float[np.ndarray, "quantities variables"]

    def _slope_of(self, places) -> np.ndarray:
        """[-] Derivatives of quantities in spreads by shares."""
        width, scale = self.scaled.ranges.width, self.scaled.scale
        return self.slope[places] * width / scale[places, None]

    @cached_property
    def residuals(self) -> Float[np.ndarray, " targets"]:
        """[-] (targets,) whose squares add up to 2 f."""
        targets = self.scaled.goal.targets
        return np.array([(self.values[i] - v) / self.scaled.scale[i] for i, v in targets])

    @cached_property
    def residuals_slope(self) -> Float[np.ndarray, "targets variables"]:
        """[-] (targets, variables)"""
        return self._slope_of([place for place, _ in self.scaled.goal.targets])

    @cached_property
    def f(self) -> float:
        """[-] The objective; infinite if the design could not be solved."""
        goal = self.scaled.goal
        if not self.ok:
            return np.inf
        if goal.objective is None:
            return float(self.residuals @ self.residuals / 2)
        return float(self.values[goal.objective]) / self.scaled.unit

    @cached_property
    def gradient(self) -> Float[np.ndarray, " variables"]:
        """[-] (variables,) of f."""
        goal = self.scaled.goal
        if goal.objective is None:
            return self.residuals @ self.residuals_slope
        return goal.sign * self._slope_of([goal.objective])[0]

    @property
    def objective(self) -> float:
        """[SI] or, with targets, f."""
        place = self.scaled.goal.objective
        if not self.ok:
            return np.nan
        return self.f if place is None else float(self.values[place])

    @cached_property
    def limits(self) -> Float[np.ndarray, " limits"]:
        """[-] (limits,) g."""
        scale = self.scaled.scale
        pairs = [(self.values[one.place] - one.bound, one) for one in self.scaled.goal.limits]
        return np.array([(one.side or 1) * away / scale[one.place] for away, one in pairs])

    @cached_property
    def limits_slope(self) -> Float[np.ndarray, "limits variables"]:
        """[-] (limits, variables)"""
        limits = self.scaled.goal.limits
        side = np.array([one.side or 1 for one in limits], float)
        return side[:, None] * self._slope_of([one.place for one in limits])

    @cached_property
    def violation(self) -> float:
        """[-] of the worst constraint."""
        broken = np.where(self.scaled.goal.equalities, np.abs(self.limits), self.limits)
        return float(np.max(broken, initial=0.0))

    @cached_property
    def multipliers(self) -> Float[np.ndarray, " limits"]:
        """[-] (limits,) for which the slope of L is smallest; those of bounds are found beside them."""
        out, equal = np.zeros(len(self.limits)), self.scaled.goal.equalities
        active = equal | (self.limits >= -10 * FEASIBLE)
        if self.ok and active.any():
            unit, at = np.eye(len(self.share)), self.share
            bounds = -unit[at <= _LEAST], unit[at >= 1 - _LEAST]
            columns = np.concatenate([self.limits_slope[active], *bounds])
            least = np.zeros(len(columns))
            least[: active.sum()][equal[active]] = -np.inf
            from scipy.optimize import lsq_linear  # half a second, for those who search

            found = lsq_linear(columns.T, -self.gradient, (least, np.inf), method="bvls")
            out[active] = found.x[: active.sum()]
        return out

    @cached_property
    def stationarity(self) -> float:
        """[-] Largest slope of L over a range that no bound holds."""
        uphill = self.gradient + self.multipliers @ self.limits_slope
        return float(np.max(np.abs(self.share - np.clip(self.share - uphill, 0.0, 1.0))))

    @property
    def feasible(self) -> bool:
        """Whether it could be solved and keeps the constraints."""
        return self.ok and self.violation <= 10 * FEASIBLE

    @property
    def rank(self) -> tuple[float, float]:
        """Lower is better: first the violation, then the objective."""
        return (max(self.violation, 10 * FEASIBLE) if self.ok else np.inf), self.f

    @property
    def optimal(self) -> bool:
        """Whether it keeps the constraints and has no slope left."""
        kept = self.ok and self.violation <= FEASIBLE
        return kept and self.stationarity <= self.scaled.tolerance


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
        self.scaled, self.start, self.max_steps = scaled, start, max_steps
        self.points: list[Point] = []
        self.path: list[Point] = []

    def run(self, method: "Method", evaluate: Evaluate) -> None:
        """Move until the optimiser, or the test of convergence, ends the search."""
        self._evaluate = evaluate
        with suppress(_Ended):
            method(self, self.scaled.ranges.shares(self.start))

    @property
    def best(self) -> Point:
        """Where the search ended."""
        return self.path[-1]

    @property
    def status(self) -> str:
        """How it ended; see `Start`."""
        best, limited = self.best, len(self.points) >= self.max_steps
        if not best.ok:
            return "start not solvable"
        if best.optimal:
            return "converged"
        if limited or not best.feasible:
            return "step limit" if limited else "no feasible design"
        smooth = best.stationarity <= _ROUGH * self.scaled.tolerance
        return "converged" if smooth else "no better step"

    def at(self, share: Float[np.ndarray, " variables"]) -> Point:
        """The design at shares of the ranges, solved once.

        Raises:
            _Ended: where the search is to end here, or before the design is solved.
        """
        share = np.clip(share, 0.0, 1.0)  # SciPy's steps reach beyond a bound by a rounding
        for point in reversed(self.points):
            if np.array_equal(point.share, share):
                return point
        close = self.path and np.max(np.abs(share - self.best.share)) < _LEAST
        if close or len(self.points) >= self.max_steps:
            raise _Ended
        solved = self._evaluate(self.scaled.ranges.values(share))
        point = Point(self.scaled, share, *solved)
        self.points.append(point)
        best = self.best if self.path else point
        optimal = point.optimal and point.rank < (best.rank[0], best.rank[1] + BETTER)
        if optimal or point.rank < best.rank:
            best = point
        self.path.append(best)
        if optimal or not best.ok:
            raise _Ended
        return point

    def value(self, share) -> float:
        """[-] the objective; a high value where the design cannot be solved."""
        point = self.at(share)
        return point.f if point.ok else self.best.f + _FAILED

    def near(self, share) -> Point:
        """The design, or the best one so far if it cannot be solved."""
        point = self.at(share)
        return point if point.ok else self.best


Method = Callable[[Descent, Float[np.ndarray, " variables"]], None]


def _slsqp(descent: Descent, start) -> None:
    """Sequential quadratic programming (Kraft 1988), for bounds and constraints."""
    equal = descent.scaled.goal.equalities
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
    from scipy.optimize import minimize  # half a second, for those who search

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
    """Gauss-Newton steps in a box as trust region, which keeps bounds (Voglis and Lagaris 2004)."""

    def residuals(u):
        point = descent.at(u)
        return point.residuals if point.ok else np.full_like(point.residuals, np.inf)

    slope = lambda u: descent.at(u).residuals_slope  # noqa: E731
    small = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-14)  # the test of convergence is `at`'s
    # SciPy's "trf" stays off the bounds, and took 800 designs where this takes 279.
    from scipy.optimize import least_squares  # half a second, for those who search

    least_squares(residuals, start, jac=slope, bounds=(0, 1), method="dogbox", **small)


def _first_order(transformation: "optax.GradientTransformation") -> Method:
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


def method_of(method: "str | optax.GradientTransformation | None", goal: Goal) -> Method:
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
    if isinstance(method, str):
        import optax

        method = optax.adam(_ADAM_STEP)
    return _first_order(method)
