"""The work behind `jaxcomp optimise`: reading the problem, searching, writing."""

import time
from pathlib import Path
from typing import Any

from .._waits import progress_of, spinner
from ..crank import Collocation
from ..design import (
    AnalysisOptions,
    Front,
    Optimum,
    Problem,
    optimise,
    pareto,
    problem,
    quantity,
    variable,
)
from ..machine import Machine, machine_of
from ..scene import Scene
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


def searched(asked: dict[str, Any], as_json: bool, out: Path | None) -> None:
    """Search for an optimum or trace a front, write and show it.

    Args:
        asked: what was typed, by the names of the options.
        as_json: whether to print JSON.
        out: folder of the files.
    """
    begun = time.perf_counter()
    scene = changed_scene(asked["machine"], asked["sets"], ())
    other = asked["pareto"]
    made = _problem(asked, machine_of(scene), [other] if other else [])
    names = ("starts", "max_steps", "tolerance", "samples", "seed")
    options: dict[str, Any] = {name: asked[name] for name in names}
    options["constraints"] = bounds_of(asked["constraints"], "--constraint")
    with progress_of("Compiling and sampling") as progress:

        def callback(stage: str, done: int, total: int) -> None:
            words = "Sampling the ranges" if stage == "sample" else "Searching, designs a start"
            progress.at(done, total, words)

        options["callback"] = callback
        main = made.quantities[0]
        if other:
            ways = _maximise(asked), None
            found = pareto(made, (main, other), maximise=ways, points=asked["points"], **options)
        else:
            targets = {
                name: value_of(name, text, f"--target {name}")
                for name, text in assignments(asked["targets"], "--target").items()
            }
            options |= {"maximise": _maximise(asked), "method": asked["method"]}
            found = optimise(made, targets or main, **options)
    show = _show_front if isinstance(found, Front) else _show_optimum
    show(scene, asked, found, time.perf_counter() - begun, as_json, out)


def _show_optimum(scene: Scene, asked, found: Optimum, seconds: float, as_json, out) -> None:
    result = optimum_result(scene, asked, found, seconds)
    with spinner("Comparing with the present design ..."):
        result["comparison"] = comparison(found)
    tables = list(optimum_tables(result))
    if out is not None:
        from ..plot import optimum_figures

        with spinner("Drawing ..."):
            new, result["not_in_scene"] = optimised_scene(scene, found)
            curves = {"designs": found.columns()}
            write_results(out, optimum_figures(found), result, new, tables, curves)
    written = "Report, pictures, designs, result and optimised scene"
    show_results(result, tables, as_json, out, written)


def _show_front(scene: Scene, asked, found: Front, seconds: float, as_json, out) -> None:
    result = front_result(scene, asked, found, seconds)
    tables = list(front_tables(result))
    if out is not None:
        from ..plot import pareto_front

        with spinner("Drawing ..."):
            figures, curves = {"pareto": pareto_front(found)}, {"front": found.columns()}
            write_results(out, figures, result, scene, tables, curves)
    show_results(result, tables, as_json, out, "Report, picture, result and scene")


def _problem(asked: dict[str, Any], design: Machine, others: list[str]) -> Problem:
    ranges = {}
    for name, text in assignments(asked["variables"], "--variable").items():
        unit = variable(design, name).unit
        low, colon, high = text.partition(":")
        if not colon:
            raise CommandError(f"--variable {name}={text}: must have the form NAME=LOW:HIGH")
        ends = (si(end, unit, f"--variable {name}") for end in with_one_unit((low, high)))
        ranges[name] = tuple(ends)
    if asked["objective"]:
        quantities = [_robust(asked, design) if asked["scatter"] else asked["objective"]]
    else:
        quantities = list(assignments(asked["targets"], "--target"))
    options = AnalysisOptions(SOLVERS[asked["accuracy"]])
    return problem(design, ranges, [*quantities, *others], options)


def _maximise(asked: dict[str, Any]) -> bool | None:
    """Which way; a robust objective goes the way of what it is made of."""
    if not asked["scatter"] or asked["maximise"] is not None:
        return asked["maximise"]
    better = quantity(asked["objective"]).better
    if not better:
        raise CommandError("--maximise: is missing; the objective is not better in one direction")
    return better == "more"


def _robust(asked: dict[str, Any], design: Machine) -> Robust:
    """The objective at the worse end of its scatter."""
    tolerances = tolerances_of(design, assignments(asked["scatter"], "--scatter"))
    largest, share, sigmas = _maximise(asked), asked["quantile"], asked["sigmas"]
    if share is not None:
        share = 1 - share if largest else share
    else:
        sigmas = (-1 if largest else 1) * (3.0 if sigmas is None else sigmas)
    return robust(design, asked["objective"], tolerances, sigmas=sigmas, quantile=share)
