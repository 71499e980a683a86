r"""The best design by gradients from several starts, and how it compares with a coarse sample.

All variables stay inside their ranges throughout. One compiled program solves designs with their
derivatives, for the sample of the whole range and for every start. The sample scales the objective and
the constraints, offers the starts, and is what the result is compared with.
"""

import dataclasses
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike, Float

from .._core.arguments import counted
from .._core.errors import BadInput
from .._core.status import SolveFailed, Status
from ._descent import Descent, Method, keep_limits, method_of
from ._goal import Goal, Interval, Objective, Point, Ranges, goal_of
from ._optimum import Optimum, Sample, optimum_of
from ._problem import Problem, RequestedQuantity, Solved, checked_problem, solved

if TYPE_CHECKING:
    import optax

# Called with "sample" or "descent", the designs solved and the largest number of them.
Callback = Callable[[str, int, int], None]
# Called with the problem, with those of the constraints, designs [SI] (n, variables) and what was solved.
Keep = Callable[[Problem, np.ndarray, Solved], None]
# Designs of the sample between two words on its progress.
_AT_ONCE = 8


def optimise(
    problem: Problem | None = None,
    objective: Objective | None = None,
    *,
    maximise: bool | None = None,
    constraints: Mapping[RequestedQuantity, Interval] | None = None,
    starts: int | ArrayLike = 8,
    method: "str | optax.GradientTransformation | None" = None,
    max_steps: int = 100,
    tolerance: float = 1e-5,
    samples: int = 256,
    seed: int = 0,
    batch: int = 1,
    callback: Callback | None = None,
    keep: Keep | None = None,
) -> Optimum:
    """The best design of a problem.

    Args:
        problem: whose variables all have ranges.
        objective: a quantity by name, a function of a `DesignResult`, or values to meet by quantity
            (least squares, each residual in spreads of its quantity); the first of the problem if
            absent.
        maximise: whether to make it large; if absent what `Quantity.better` says, small for functions.
        constraints: [SI] (low, high) by quantity, `None` for an open end, twice the same for a value
            to be met.
        starts: how many: the best design of the sample, the present one, and others spread evenly; or
            designs (starts, variables) in SI units.
        method: "slsqp" (SciPy; keeps constraints), "least-squares" (SciPy's dogbox, for targets
            without constraints), "adam", or a gradient transformation of Optax, which moves shares of
            the ranges; if absent the first of these that suits.
        max_steps: largest number of designs solved from each start.
        tolerance: [-] of `Optimum.stationarity`; relative to the spread of the objective.
        samples: designs of the comparison, of a Sobol sequence; at least as many as starts.
        seed: of the sample.
        batch: designs of the sample solved at once; more than one is quicker on a GPU alone, and those
            of the search, which are solved one by one, then have a program of their own.
        callback: called as work goes on with "sample" or "descent", the designs solved and the largest
            number of them; what it raises ends the search.
        keep: called as work goes on with the problem, whose quantities those of the constraints are as
            well, designs [SI] (n, variables), and what was solved of them.

    Raises:
        BadInput: a variable without finite range, an unknown quantity, an impossible bound.
        SolveFailed: no design of the sample can be solved.

    >>> from jaxcomp import load, problem
    >>> ranges = {"bore_at_displacement": (0.1, 0.16)}  # [m]
    >>> best = optimise(problem(load("mayekawa-wbhe"), ranges, ["mechanical_efficiency"]), samples=16)
    >>> (bore,) = best.values.values()
    >>> print(f"{1e3 * bore:.1f} mm, {100 * best.objective:.2f} %, {best.status}")
    130.9 mm, 91.17 %, converged
    """
    if not isinstance(objective, str | Mapping | None) and not callable(objective):
        bound = 'one quantity by name, such as "motor_power", a function, or values to meet by name'
        raise BadInput("objective", str(objective), bound)
    problem = checked_problem(problem)
    goal = goal_of(problem, objective, maximise, constraints)
    search_method = method_of(method, goal)
    start_designs, count = _start_designs(starts, problem)
    count_of_samples = max(counted("samples", samples, 0), count)
    points = space(problem, goal.ranges, count_of_samples, seed, start_designs)
    search = Search(goal.problem, points, batch, max_steps, tolerance, callback, keep)
    goal, sample = search.sampled(goal)
    begin = start_designs
    if begin is None:
        begin = sample.starts(count)
    descents = search.descents([(goal, start) for start in begin], search_method)
    ends = [descent.best for descent in descents]
    solvable = any(end.ok for end in ends)  # starts that were given may all fail
    if sample.best is None and solvable and not any(end.feasible for end in ends):
        descents += search.nearest(goal, descents, search_method)
    return optimum_of(goal, sample, descents)


def _start_designs(starts, problem: Problem) -> tuple[np.ndarray | None, int]:
    """Designs to begin from, if they are given, and their number."""
    if isinstance(starts, int):
        return None, counted("starts", starts, high=10_000)
    designs = np.atleast_2d(np.asarray(starts, float))
    if designs.ndim != 2 or designs.shape[1] != len(problem.variables):
        raise BadInput("starts", designs, f"of shape (starts, {len(problem.variables)})")
    for variable, column in zip(problem.variables, designs.T, strict=True):
        bad = column[~((column >= variable.low) & (column <= variable.high))]
        if bad.size:
            bound = f">= {variable.low:g} and <= {variable.high:g}"
            raise BadInput(f"starts.{variable.name}", bad[0], bound)
    return designs, len(designs)


def space(
    problem: Problem, ranges: Ranges, count: int, seed: int, first: np.ndarray | None = None
) -> Float[np.ndarray, "n variables"]:
    """[SI] The given designs, or the present one if it lies inside the ranges, and an even sample."""
    if first is None:
        present = np.asarray(problem.current)[None]
        first = present[ranges.contain(present)]
    return np.concatenate([first, even_sample(ranges, count, seed)])


def even_sample(ranges: Ranges, count: int, seed: int) -> Float[np.ndarray, "count variables"]:
    """[SI] Designs of a scrambled Sobol sequence, of which the first few are spread evenly as well."""
    from scipy.stats import qmc  # a second, for those who draw

    engine = qmc.Sobol(len(ranges.low), rng=seed)
    return ranges.values(engine.random_base2(math.ceil(math.log2(count)))[:count])


class Search:
    """A sample that is solved, and starts that are moved by the same program.

    Args:
        problem: of the goal or goals.
        points: [SI] (n, variables) designs of the sample.
        batch, max_steps, tolerance, callback, keep: as in `optimise`.

    Raises:
        BadInput: an option out of bounds.
        SolveFailed: no design of the sample can be solved.
    """

    def __init__(
        self,
        problem: Problem,
        points: Float[np.ndarray, "n variables"],
        batch: int,
        max_steps: int,
        tolerance: float,
        callback: Callback | None,
        keep: Keep | None = None,
    ):
        for name, number in {"max_steps": max_steps, "batch": batch}.items():
            if number < 1:
                raise BadInput(name, number, ">= 1")
        if not 0 < tolerance < 1:
            raise BadInput("tolerance", tolerance, "> 0 and < 1")
        self.problem = problem
        self.keep = keep
        self.points = points
        self.max_steps = max_steps
        self.tolerance = tolerance
        self.report = callback or (lambda stage, count, limit: None)
        parts = []
        at_once = max(batch, _AT_ONCE)
        for first in range(0, len(points), at_once):
            parts.append(self.solved(points[first : first + at_once], batch))
            self.report("sample", min(first + at_once, len(points)), len(points))
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        self.solutions = Solved(*columns)
        if not np.any(self.solutions.ok):
            details = f"none of {len(points)} designs could be solved"
            raise SolveFailed(Status.not_converged, details)

    def solved(self, points: Float[np.ndarray, "n variables"], batch: int = 1) -> Solved:
        """Solve designs, and let them be kept."""
        answers = solved(self.problem, points, batch)
        if self.keep is not None:
            self.keep(self.problem, points, answers)
        return answers

    def sampled(self, goal: Goal) -> tuple[Goal, Sample]:
        """A goal in spreads of the quantities over the sample, and the sample as it judges it."""
        values, ok, _ = self.solutions
        spread = values[ok].std(axis=0)
        size = np.abs(values[ok].mean(axis=0))
        # A quantity that does not change over the sample has no scale but its size.
        scale = np.where(spread <= 1e-12 * size, np.where(size > 0, size, 1.0), spread)
        goal = dataclasses.replace(goal, scale=scale, tolerance=self.tolerance)
        designs = []
        objectives = []
        keeps_constraints = []
        for row in zip(self.points, *self.solutions, strict=True):
            design = Point(goal, *row)
            designs.append(design)
            objectives.append(design.objective)
            keeps_constraints.append(design.feasible)
        feasible = np.array(keeps_constraints)
        best = None
        if feasible.any():
            best = int(np.argmin(np.where(feasible, [design.f for design in designs], np.inf)))
        sample = Sample(
            values=self.points,
            quantities=values,
            objective=np.array(objectives),
            ok=ok,
            feasible=feasible,
            best=best,
        )
        return goal, sample

    def nearest(self, goal: Goal, descents: Sequence[Descent], method: Method) -> list[Descent]:
        """Move from the design that breaks the constraints least to where they are kept, and on.

        Args:
            goal: whose constraints no design keeps so far.
            descents: that ended without.
            method: of the search once they are kept.
        """
        solved_designs = []
        for design, *solution in zip(self.points, *self.solutions, strict=True):
            solved_designs.append(Point(goal, goal.ranges.shares(design), *solution))
        ends = [descent.best for descent in descents]
        nearest = min([*ends, *solved_designs], key=lambda point: point.rank)
        repaired = self.descents([(goal, goal.ranges.values(nearest.share))], keep_limits)
        if repaired[0].best.feasible:
            repaired += self.descents([(goal, goal.ranges.values(repaired[0].best.share))], method)
        return repaired

    def descents(self, begin: Sequence[tuple[Goal, np.ndarray]], method: Method) -> list[Descent]:
        """Move from all starts, one after the other, each to its goal."""
        descents = []
        count = 0

        def solve(point):
            nonlocal count
            answer = self.solved(point[None])
            count += 1
            self.report("descent", count, self.max_steps * len(begin))
            return [np.asarray(column)[0] for column in answer]

        with warnings.catch_warnings():
            # SciPy warns of steps that leave the bounds, which they do by a rounding.
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            for goal, start in begin:
                descents.append(Descent(goal, start, self.max_steps))
                descents[-1].run(method, solve)
        return descents
