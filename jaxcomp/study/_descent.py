r"""The search from one start, moved by an optimiser of SciPy or Optax."""

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Float

from .._core.errors import BadInput
from ._goal import SHORTEST_STEP, Goal, Point

if TYPE_CHECKING:
    import optax

METHODS = ("slsqp", "least-squares", "adam")
# [-] a design counts as better beyond this share of the objective's spread: above the roughness of
# solutions with few panels (2e-5 of the spread for the efficiency over the bore).
BETTER = 1e-4
# [-] of a range: the first step; a step of Adam.
_FIRST = 0.25
_ADAM_STEP = 0.02
# A search that cannot move is at the optimum as well as the solutions are smooth if its slope is
# below this times the tolerance.
_ROUGH = 1e3
# [spreads] what a design that cannot be solved counts more than the best one, so that a line search
# goes back to a tenth of its step.
_FAILED = 1e3

# Solves one design [SI]: values, whether they can be relied on, slope.
Evaluate = Callable[[np.ndarray], Any]


class _Ended(Exception):
    """The search of a start has ended."""


class Descent:
    """The search from one start [SI], with at most so many solved designs.

    Attributes:
        points: solved designs in turn.
        path: the best of them up to each of them.
    """

    def __init__(self, goal: Goal, start: Float[np.ndarray, " variables"], max_steps: int):
        self.goal = goal
        self.start = start
        self.max_steps = max_steps
        self.points: list[Point] = []
        self.path: list[Point] = []

    def run(self, method: "Method", evaluate: Evaluate) -> None:
        """Move until the optimiser, or the test of convergence, ends the search."""
        self._evaluate = evaluate
        with suppress(_Ended):
            method(self, self.goal.ranges.shares(self.start))

    @property
    def best(self) -> Point:
        """Where the search ended."""
        return self.path[-1]

    @property
    def status(self) -> str:
        """End of the descent in words; see `Start`."""
        best = self.best
        limited = len(self.points) >= self.max_steps
        if not best.ok:
            return "start not solvable"
        if best.optimal:
            return "converged"
        if limited or not best.feasible:
            if limited:
                return "step limit"
            return "no feasible design"
        smooth = best.stationarity <= _ROUGH * self.goal.tolerance
        return "converged" if smooth else "no better step"

    def at(self, share: Float[np.ndarray, " variables"]) -> Point:
        """The design at shares of the ranges, solved once.

        Raises:
            _Ended: where the search is to end here, or before the design is solved.
        """
        share = np.clip(share, 0.0, 1.0)  # SciPy's steps reach beyond a bound by a rounding
        # SciPy asks for value, slope and constraints of one design in turn, and mostly of the last.
        for point in reversed(self.points):
            if np.array_equal(point.share, share):
                return point
        close = self.path and np.max(np.abs(share - self.best.share)) < SHORTEST_STEP
        if close or len(self.points) >= self.max_steps:
            raise _Ended
        solved = self._evaluate(self.goal.ranges.values(share))
        point = Point(self.goal, share, *solved)
        self.points.append(point)
        best = self.best if self.path else point
        # An optimum may be worse than the best by the roughness of solutions.
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
        if point.ok:
            return point.f
        return self.best.f + _FAILED

    def near(self, share) -> Point:
        """The design, or the best one so far if it cannot be solved."""
        point = self.at(share)
        return point if point.ok else self.best


Method = Callable[[Descent, Float[np.ndarray, " variables"]], None]


def _slsqp(descent: Descent, start) -> None:
    """Sequential quadratic programming (Kraft 1988), for bounds and constraints."""
    equal = descent.goal.equalities
    constraints = []
    for kind, rows in (("eq", equal), ("ineq", ~equal)):
        if rows.any():
            constraints.append(_constraint(descent, kind, rows))
    steep = np.max(np.abs(descent.near(start).gradient))
    # SLSQP begins with a unit Hessian, so that its first step is minus the slope: at most `_FIRST`.
    gain = min(1.0, _FIRST / max(steep, 1e-300))
    from scipy.optimize import minimize  # half a second, for those who search

    minimize(
        lambda u: gain * descent.value(u),
        start,
        jac=lambda u: gain * descent.near(u).gradient,
        bounds=[(0, 1)] * len(start),
        constraints=constraints,
        method="SLSQP",
        # The test of convergence and the number of steps are `at`'s.
        options={"ftol": 1e-14, "maxiter": 10_000},
    )


def _constraint(descent: Descent, kind: str, rows) -> dict[str, Any]:
    """Some of the limits of a goal for SciPy, which keeps fun >= 0, while a goal keeps g <= 0."""
    return {
        "type": kind,
        "fun": lambda u: -descent.near(u).limits.values[rows],
        "jac": lambda u: -descent.near(u).limits.slope[rows],
    }


def keep_limits(descent: Descent, start) -> None:
    """Steps that lessen the sum of the squares by which constraints are broken, until all are kept."""

    def broken(u):
        point = descent.at(u)
        misses = descent.near(u).limits
        over = np.where(descent.goal.equalities, misses.values, np.maximum(misses.values, 0.0))
        value = over @ over / 2
        if point.feasible:
            raise _Ended
        if not point.ok:
            value = value + _FAILED
        return value, over @ misses.slope

    from scipy.optimize import minimize  # half a second, for those who search

    # The number of steps is `at`'s.
    options = {"ftol": 1e-14, "gtol": 1e-9, "maxiter": 10_000}
    bounds = [(0, 1)] * len(start)
    minimize(broken, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options)


def _least_squares(descent: Descent, start) -> None:
    """Gauss-Newton steps in a box as trust region, which keeps bounds (Voglis and Lagaris 2004)."""

    def residuals(u):
        point = descent.at(u)
        # SciPy shrinks its box where residuals are not finite.
        return np.where(point.ok, point.residuals.values, np.inf)

    def slope(u):
        return descent.at(u).residuals.slope

    small = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-14)  # the test of convergence is `at`'s
    # SciPy's "trf" stays off the bounds, and took 800 designs where this takes 279.
    from scipy.optimize import least_squares  # half a second, for those who search

    least_squares(residuals, start, jac=slope, bounds=(0, 1), method="dogbox", **small)


def _first_order(transformation: "optax.GradientTransformation") -> Method:
    """Steps of Optax, cut off at the bounds; half of the way back from where nothing can be solved."""
    update = jax.jit(transformation.update)

    def method(descent: Descent, start) -> None:
        previous = start
        share = start
        state = transformation.init(start)
        while True:
            point = descent.at(share)
            if not point.ok:
                share = (previous + share) / 2
                continue
            step, state = update(point.gradient, state, share)
            previous = share
            share = np.clip(share + np.asarray(step), 0.0, 1.0)

    return method


def _is_method(method: "str | optax.GradientTransformation") -> bool:
    if isinstance(method, str):
        return method in METHODS
    return hasattr(method, "update")


def method_of(method: "str | optax.GradientTransformation | None", goal: Goal) -> Method:
    """A method by name, or any transformation of Optax.

    Raises:
        BadInput: no such method, or one that does not suit the goal.
    """
    if method is None:
        method = "slsqp"
        if goal.targets and not goal.limits:
            method = "least-squares"
    named = "a transformation of optax"
    if isinstance(method, str):
        named = method
    if named == "slsqp":
        return _slsqp
    if not _is_method(method):
        raise BadInput("method", str(method), f"one of {', '.join(METHODS)}, or of optax")
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
