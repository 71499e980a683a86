"""The work behind `jaxcomp optimise`: reading the problem, searching, writing."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from .._waits import progress_of, spinner
from ..crank import Collocation
from ..design import AnalysisOptions, Problem, optimise, pareto, problem, quantity, variable
from ..design._optimise import Callback
from ..machine import Machine, machine_of
from ..scene.tolerances import tolerances_of
from ..tolerancing import Robust, robust
from ._arguments import assignments, changed_scene, with_one_unit
from ._constraints import bounds_of, si, value_of
from ._errors import CommandError
from ._optimise_result import (
    comparison,
    front_result,
    front_tables,
    optimised_scene,
    optimum_result,
    optimum_tables,
)
from ._output import show_results, write_results

# Of the periodic state by `--accuracy`; the fine one is chosen by the design.
SOLVERS = {"fast": Collocation(nodes=12, reversals=0, tolerance=1e-10), "fine": None}


class Asked(NamedTuple):
    """What was typed."""

    machine: str
    sets: tuple[str, ...]
    variables: tuple[str, ...]
    objective: str | None
    targets: tuple[str, ...]
    maximise: bool | None
    constraints: tuple[str, ...]
    method: str | None
    starts: int
    samples: int
    seed: int
    tolerance: float
    accuracy: str
    scatter: tuple[str, ...] = ()
    sigmas: float | None = None
    quantile: float | None = None


def searched_optimum(asked: Asked, max_steps: int, as_json: bool, out: Path | None) -> None:
    """Search for an optimum, write and show it."""
    begun = time.perf_counter()
    scene, made = _problem(asked)
    goals = {}
    for name, text in assignments(asked.targets, "--target").items():
        goals[name] = value_of(name, text, f"--target {name}")
    with _progress() as callback:
        found = optimise(
            made,
            goals or made.quantities[0],
            maximise=_maximise(asked),
            constraints=bounds_of(asked.constraints, "--constraint"),
            starts=asked.starts,
            method=asked.method,
            max_steps=max_steps,
            tolerance=asked.tolerance,
            samples=asked.samples,
            seed=asked.seed,
            callback=callback,
        )
    with spinner("Comparing with the present design ..."):
        beside = comparison(found)
    result = optimum_result(scene, asked._asdict(), found, time.perf_counter() - begun)
    result["comparison"] = beside
    tables = list(optimum_tables(result))
    if out is not None:
        from ..plot import optimum_figures

        with spinner("Drawing ..."):
            new, left = optimised_scene(scene, found)
            result["not_in_scene"] = left
            write_results(
                out, optimum_figures(found), result, new, tables, {"designs": found.columns()}
            )
    show_results(
        result, tables, as_json, out, "Report, pictures, designs, result and optimised scene"
    )


def searched_front(asked: Asked, other: str, points: int, max_steps, as_json, out) -> None:
    """Trace a front, write and show it."""
    begun = time.perf_counter()
    scene, made = _problem(asked, other)
    with _progress() as callback:
        found = pareto(
            made,
            (made.quantities[0], other),
            maximise=(_maximise(asked), None),
            constraints=bounds_of(asked.constraints, "--constraint"),
            points=points,
            starts=asked.starts,
            max_steps=max_steps,
            tolerance=asked.tolerance,
            samples=asked.samples,
            seed=asked.seed,
            callback=callback,
        )
    result = front_result(scene, asked._asdict(), found, time.perf_counter() - begun)
    tables = list(front_tables(result))
    if out is not None:
        from ..plot import pareto_front

        with spinner("Drawing ..."):
            figures = {"pareto": pareto_front(found)}
            write_results(out, figures, result, scene, tables, {"front": found.columns()})
    show_results(result, tables, as_json, out, "Report, picture, result and scene")


def _problem(asked: Asked, *others: str) -> tuple[Any, Problem]:
    scene = changed_scene(asked.machine, asked.sets, ())
    design = machine_of(scene)
    ranges = {}
    for name, text in assignments(asked.variables, "--variable").items():
        unit = variable(design, name).unit
        low, colon, high = text.partition(":")
        if not colon:
            raise CommandError(f"--variable {name}={text}: must have the form NAME=LOW:HIGH")
        ends = (si(end, unit, f"--variable {name}") for end in with_one_unit((low, high)))
        ranges[name] = tuple(ends)
    if asked.objective:
        quantities = [_robust(asked, design) if asked.scatter else asked.objective]
    else:
        quantities = list(assignments(asked.targets, "--target"))
    return scene, problem(
        design, ranges, [*quantities, *others], AnalysisOptions(SOLVERS[asked.accuracy])
    )


def _maximise(asked: Asked) -> bool | None:
    """Which way; a robust objective goes the way of what it is made of."""
    if not asked.scatter or asked.maximise is not None:
        return asked.maximise
    better = quantity(asked.objective or "").better
    if not better:
        raise CommandError("--maximise: is missing; the objective is not better in one direction")
    return better == "more"


def _robust(asked: Asked, design: Machine) -> Robust:
    """The objective at the worse end of its scatter."""
    tolerances = tolerances_of(design, assignments(asked.scatter, "--scatter"))
    largest, share, sigmas = _maximise(asked), asked.quantile, asked.sigmas
    if share is not None:
        share = 1 - share if largest else share
    else:
        sigmas = (-1 if largest else 1) * (3.0 if sigmas is None else sigmas)
    return robust(design, asked.objective or "", tolerances, sigmas=sigmas, quantile=share)


@contextmanager
def _progress() -> Iterator[Callback]:
    """A bar on standard error."""
    with progress_of("Compiling and sampling") as progress:

        def callback(stage: str, done: int, total: int) -> None:
            words = "Sampling the ranges" if stage == "sample" else "Searching, designs a start"
            progress.at(done, total, words)

        yield callback
