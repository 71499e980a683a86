r"""The best design by gradients from several starts, and how it compares with a coarse sample.

All variables stay inside their ranges throughout. One compiled program solves designs with their
derivatives, a batch at a time, for the sample of the whole range and for every start. The sample scales
the objective and the constraints, offers the starts, and is what the result is compared with.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike, Float

from .._fields import BadInput
from .._status import SolveFailed, Status
from ._descent import Descent, Method, Point, Scaled, method_of
from ._goal import Goal, Interval, Objective, Solved, goal_of, solved
from ._optimum import Optimum, Sample, optimum_of
from ._problem import Asked, Problem
from ._ranges import Ranges, even_sample, ranges_of
from ._together import run_together

if TYPE_CHECKING:
    import optax

# Called with "sample" or "descent", the designs solved (from each start) and the largest number of them.
Callback = Callable[[str, int, int], None]


def optimise(
    problem: Problem,
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
    batch: int = 8,
    callback: Callback | None = None,
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
        batch: designs solved at once.
        callback: called as work goes on with "sample" or "descent", the designs solved (from each
            start) and the largest number of them; what it raises ends the search.

    Raises:
        BadInput: a variable without finite range, an unknown quantity, an impossible bound.
        SolveFailed: no design of the sample can be solved.

    >>> from jaxcomp import load, problem
    >>> bore = problem(load("mayekawa-wbhe"), {"bore": (0.1, 0.16)}, ["mechanical_efficiency"])
    >>> best = optimise(bore, samples=16)
    >>> print(f"{1e3 * best.values['bore']:.1f} mm, {100 * best.objective:.2f} %, {best.status}")
    130.9 mm, 91.17 %, converged
    """
    ranges = ranges_of(problem.variables)
    goal = goal_of(problem, objective, maximise, constraints)
    chosen = method_of(method, goal)
    for name, number in {"max_steps": max_steps, "batch": batch}.items():
        if number < 1:
            raise BadInput(name, number, ">= 1")
    if not 0 < tolerance < 1:
        raise BadInput("tolerance", tolerance, "> 0 and < 1")
    given, count = _given_starts(starts, problem, ranges)
    first = present_design(problem, ranges) if given is None else given
    points = np.concatenate([first, even_sample(ranges, max(samples, count), seed)])
    found = solved_sample(goal, points, batch, callback)
    scaled = Scaled(goal, ranges, spreads(found), tolerance)
    sample = sample_of(scaled, points, found)
    begin = sample.starts(count) if given is None else given
    descents = [Descent(scaled, start, max_steps) for start in begin]
    descend(descents, chosen, batch, callback)
    return optimum_of(scaled, sample, descents)


def _given_starts(starts, problem: Problem, ranges: Ranges) -> tuple[np.ndarray | None, int]:
    """Designs to begin from, if they are given, and their number."""
    if isinstance(starts, int):
        if starts < 1:
            raise BadInput("starts", starts, ">= 1")
        return None, starts
    given = np.atleast_2d(np.asarray(starts, float))
    if given.ndim != 2 or given.shape[1] != len(problem.variables):
        raise BadInput("starts", given, f"of shape (starts, {len(problem.variables)})")
    for one, column in zip(problem.variables, given.T, strict=True):
        bad = column[~((column >= one.low) & (column <= one.high))]
        if bad.size:
            raise BadInput(f"starts.{one.name}", bad[0], f">= {one.low:g} and <= {one.high:g}")
    return given, len(given)


def present_design(problem: Problem, ranges: Ranges) -> Float[np.ndarray, "n variables"]:
    """(1, variables) the present design, or (0, variables) if it lies outside the ranges."""
    now = np.asarray(problem.current)[None]
    return now[ranges.contain(now)]


def solved_sample(goal: Goal, points, batch: int, callback: Callback | None) -> Solved:
    """Solve the sample, some designs at a time.

    Raises:
        SolveFailed: none of them can be solved.
    """
    parts = []
    for first in range(0, len(points), 4 * batch):
        parts.append(solved(goal.problem, points[first : first + 4 * batch], batch))
        if callback is not None:
            callback("sample", min(first + 4 * batch, len(points)), len(points))
    found = Solved(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    if not np.any(found.ok):
        details = f"none of {len(points)} designs could be solved"
        raise SolveFailed(Status.not_converged, details)
    return found


def spreads(found: Solved) -> Float[np.ndarray, " quantities"]:
    """[SI] Standard deviation of each quantity over the solved designs of a sample."""
    good = np.asarray(found.values)[np.asarray(found.ok)]
    spread, size = good.std(axis=0), np.abs(good.mean(axis=0))
    # A quantity that does not change over the sample has no scale but its size.
    return np.where(spread <= 1e-12 * size, np.where(size > 0, size, 1.0), spread)


def sample_of(scaled: Scaled, points, found: Solved) -> Sample:
    """A solved sample with its objective and whether it keeps the constraints."""
    values, ok = np.asarray(found.values), np.asarray(found.ok)
    rows = zip(points, values, ok, np.asarray(found.slope), strict=True)
    designs = [Point(scaled, *row) for row in rows]
    feasible = np.array([one.feasible for one in designs])
    worth = np.array([one.f if one.feasible else np.inf for one in designs])
    best = int(np.argmin(worth)) if feasible.any() else None
    objective = np.array([one.objective for one in designs])
    return Sample(points, values, objective, ok, feasible, best)


def descend(
    descents: Sequence[Descent], method: Method, batch: int, callback: Callback | None
) -> None:
    """Move all starts side by side, their designs solved in batches."""
    problem = descents[0].scaled.goal.problem
    most = descents[0].max_steps
    done = 0

    def solve(points):
        nonlocal done
        found = solved(problem, points, batch)
        done += 1
        if callback is not None:
            callback("descent", done, most)
        return list(zip(*(np.asarray(column) for column in found), strict=True))

    with warnings.catch_warnings():
        # which they are by a rounding
        warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
        run_together([partial(one.run, method) for one in descents], solve)
