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
from ._problem import Asked, Problem, Solved, given_problem, solved

if TYPE_CHECKING:
    import optax

# Called with "sample" or "descent", the designs solved and the largest number of them.
Callback = Callable[[str, int, int], None]
# Called with the problem, with those of the constraints, designs [SI] (n, variables) and what was solved.
Keep = Callable[[Problem, np.ndarray, Solved], None]
# Designs of the sample between two words on its progress.
_AT_ONCE = 32


def optimise(
    problem: Problem | None = None,
    objective: Objective | None = None,
    *,
    maximise: bool | None = None,
    constraints: Mapping[Asked, Interval] | None = None,
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
    problem = given_problem(problem)
    goal = goal_of(problem, objective, maximise, constraints)
    chosen = method_of(method, goal)
    given, count = _given_starts(starts, problem)
    points = space(problem, goal.ranges, max(counted("samples", samples, 0), count), seed, given)
    search = Search(goal.problem, points, batch, max_steps, tolerance, callback, keep)
    goal, sample = search.sampled(goal)
    begin = sample.starts(count) if given is None else given
    descents = search.descents([(goal, start) for start in begin], chosen)
    ends = [one.best for one in descents]
    solvable = any(end.ok for end in ends)  # starts that were given may all fail
    if sample.best is None and solvable and not any(end.feasible for end in ends):
        descents += search.nearest(goal, descents, chosen)
    return optimum_of(goal, sample, descents)


def _given_starts(starts, problem: Problem) -> tuple[np.ndarray | None, int]:
    """Designs to begin from, if they are given, and their number."""
    if isinstance(starts, int):
        return None, counted("starts", starts, high=10_000)
    given = np.atleast_2d(np.asarray(starts, float))
    if given.ndim != 2 or given.shape[1] != len(problem.variables):
        raise BadInput("starts", given, f"of shape (starts, {len(problem.variables)})")
    for one, column in zip(problem.variables, given.T, strict=True):
        bad = column[~((column >= one.low) & (column <= one.high))]
        if bad.size:
            raise BadInput(f"starts.{one.name}", bad[0], f">= {one.low:g} and <= {one.high:g}")
    return given, len(given)


def space(
    problem: Problem, ranges: Ranges, count: int, seed: int, first: np.ndarray | None = None
) -> Float[np.ndarray, "n variables"]:
    """[SI] The given designs, or the present one if it lies inside the ranges, and an even sample."""
    if first is None:
        now = np.asarray(problem.current)[None]
        first = now[ranges.contain(now)]
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
        self.tell = callback or (lambda stage, done, most: None)
        parts = []
        at_once = max(batch, _AT_ONCE)
        for first in range(0, len(points), at_once):
            parts.append(self.solved(points[first : first + at_once], batch))
            self.tell("sample", min(first + at_once, len(points)), len(points))
        self.found = Solved(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        if not np.any(self.found.ok):
            details = f"none of {len(points)} designs could be solved"
            raise SolveFailed(Status.not_converged, details)

    def solved(self, points: Float[np.ndarray, "n variables"], batch: int = 1) -> Solved:
        """Solve designs, and let them be kept."""
        found = solved(self.problem, points, batch)
        if self.keep is not None:
            self.keep(self.problem, points, found)
        return found

    def sampled(self, goal: Goal) -> tuple[Goal, Sample]:
        """A goal in spreads of the quantities over the sample, and the sample as it judges it."""
        values, ok, _ = self.found
        spread = values[ok].std(axis=0)
        size = np.abs(values[ok].mean(axis=0))
        # A quantity that does not change over the sample has no scale but its size.
        scale = np.where(spread <= 1e-12 * size, np.where(size > 0, size, 1.0), spread)
        goal = dataclasses.replace(goal, scale=scale, tolerance=self.tolerance)
        rows = zip(self.points, *self.found, strict=True)
        designs = [Point(goal, *row) for row in rows]
        feasible = np.array([one.feasible for one in designs])
        worth = np.array([one.f if one.feasible else np.inf for one in designs])
        best = int(np.argmin(worth)) if feasible.any() else None
        objective = np.array([one.objective for one in designs])
        return goal, Sample(self.points, values, objective, ok, feasible, best)

    def nearest(self, goal: Goal, descents: Sequence[Descent], method: Method) -> list[Descent]:
        """Move from the design that breaks the constraints least to where they are kept, and on.

        Args:
            goal: whose constraints no design keeps so far.
            descents: that ended without.
            method: of the search once they are kept.
        """
        solved_designs = [
            Point(goal, goal.ranges.shares(design), *row)
            for design, *row in zip(self.points, *self.found, strict=True)
        ]
        ends = [one.best for one in descents]
        least = min([*ends, *solved_designs], key=lambda point: point.rank)
        made = self.descents([(goal, goal.ranges.values(least.share))], keep_limits)
        if made[0].best.feasible:
            made += self.descents([(goal, goal.ranges.values(made[0].best.share))], method)
        return made

    def descents(self, begin: Sequence[tuple[Goal, np.ndarray]], method: Method) -> list[Descent]:
        """Move from all starts, one after the other, each to its goal."""
        made = []
        done = 0

        def solve(point):
            nonlocal done
            found = self.solved(point[None])
            done += 1
            self.tell("descent", done, self.max_steps * len(begin))
            return [np.asarray(one)[0] for one in found]

        with warnings.catch_warnings():
            # which they are by a rounding
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            for goal, start in begin:
                made.append(Descent(goal, start, self.max_steps))
                made[-1].run(method, solve)
        return made
