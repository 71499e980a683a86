r"""The best design by gradients from several starts, with the evidence that it is one.

All variables are moved inside their ranges, which hold throughout. One compiled program solves designs
with their derivatives, a batch at a time, for the sample of the whole range and for every method. The
sample scales the objective and the constraints, offers the starts, and is what the result is compared
with: if a sample is better than what all starts found, the search goes on from it.
"""

from collections.abc import Mapping

import numpy as np
import optax
from jaxtyping import ArrayLike

from .._fields import BadInput
from .._status import SolveFailed, Status
from ._goal import Interval, Wanted, goal_of
from ._methods import method_of
from ._optimum import Optimum, optimum_of
from ._problem import Asked, Problem
from ._search import (
    Callback,
    Frame,
    Search,
    begin,
    found_in,
    numbers_of,
    restored,
    sampled,
    search_all,
)
from ._transform import Ranges, ranges_of, scattered


def optimise(
    problem: Problem,
    objective: Wanted | None = None,
    *,
    maximise: bool | None = None,
    constraints: Mapping[Asked, Interval] | None = None,
    starts: int | ArrayLike = 8,
    method: str | optax.GradientTransformation = "bfgs",
    max_steps: int = 100,
    tolerance: float = 1e-5,
    samples: int = 256,
    seed: int = 0,
    batch: int = 8,
    callback: Callback | None = None,
    resume: Mapping[str, np.ndarray] | None = None,
) -> Optimum:
    """The best design of a problem.

    Args:
        problem: whose variables all have ranges.
        objective: a quantity by name, a function of a `DesignResult`, or values to meet by quantity
            (least squares, each miss in spreads of its quantity); the first of the problem if absent.
        maximise: whether to make it large; if absent what `Quantity.better` says, small for functions.
        constraints: [SI] (low, high) by quantity, `None` for an open end, twice the same for a value
            to be met.
        starts: how many, of which the first is the present design (if it can be solved and lies in the
            ranges), or designs (starts, variables) in SI units.
        method: "bfgs" (Optimistix), "least-squares" (Levenberg-Marquardt, for targets), "adam", or a
            gradient transformation of Optax, which moves the unbounded numbers of `Ranges`.
        max_steps: after which to stop, in all.
        tolerance: [-] of `Optimum.stationarity`; relative to the spread of the objective.
        samples: designs of the comparison; at least as many as starts.
        seed: of the sample.
        batch: designs solved at once.
        callback: called with the `Search` after each step; what it raises ends the search.
        resume: `Search.kept` of a search of the same problem, method and sample.

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
    solver = method_of(method)
    if solver.squares and not goal.targets:
        raise BadInput("method", str(method), "'bfgs' for an objective without targets to meet")
    for name, number in {"max_steps": max_steps, "batch": batch}.items():
        if number < 1:
            raise BadInput(name, number, ">= 1")
    if not 0 < tolerance < 1:
        raise BadInput("tolerance", tolerance, "> 0 and < 1")
    if resume is not None:
        found = found_in(resume)
        _check_same(resume["sample"], problem, found)
        frame = Frame(goal, solver, ranges, numbers_of(goal, found, tolerance), batch)
        search = restored(frame, resume)
    else:
        first, count = _given_starts(starts, problem, ranges)
        points = np.asarray(scattered(ranges, max(samples, count), seed))
        search = sampled(goal, np.concatenate([first, points]), batch, callback)
        assert search.found is not None
        if not np.any(search.found.ok):
            details = f"none of {len(search.sample)} designs could be solved"
            raise SolveFailed(Status.not_converged, details)
        frame = Frame(goal, solver, ranges, numbers_of(goal, search.found, tolerance), batch)
        search.done = 0
        begin(frame, search, first if count == 0 else _solvable(search, count))
    search_all(frame, search, max_steps, callback)
    return optimum_of(frame, search)


def _given_starts(starts, problem: Problem, ranges: Ranges) -> tuple[np.ndarray, int]:
    """Designs to begin from, and how many starts to choose from the sample (none if they are given)."""
    if isinstance(starts, int):
        if starts < 1:
            raise BadInput("starts", starts, ">= 1")
        return first_starts(problem, ranges), starts
    low, high = np.asarray(ranges.low), np.asarray(ranges.high)
    given = np.atleast_2d(np.asarray(starts, float))
    if given.ndim != 2 or given.shape[1] != len(problem.variables):
        raise BadInput("starts", given, f"of shape (starts, {len(problem.variables)})")
    for number, one in enumerate(problem.variables):
        bad = given[:, number][
            ~((given[:, number] >= low[number]) & (given[:, number] <= high[number]))
        ]
        if bad.size:
            raise BadInput(f"starts.{one.name}", bad[0], f">= {one.low:g} and <= {one.high:g}")
    return given, 0


def first_starts(problem: Problem, ranges: Ranges) -> np.ndarray:
    """(1, variables) the present design, or (0, variables) if it lies outside the ranges."""
    low, high = np.asarray(ranges.low), np.asarray(ranges.high)
    now = np.asarray(problem.current)[None]
    return now[np.all((now >= low) & (now <= high), axis=1)]


def _solvable(search: Search, count: int) -> np.ndarray:
    """The first designs of the sample that could be solved: the present one, then an even scatter."""
    assert search.found is not None
    return search.sample[np.flatnonzero(np.asarray(search.found.ok))[:count]]


def _check_same(sample: np.ndarray, problem: Problem, found) -> None:
    shape = found.values.shape[1], sample.shape[1]
    if shape[1] != len(problem.variables):
        raise BadInput(
            "resume", f"of {shape[1]} variables", f"a search of {len(problem.variables)}"
        )
