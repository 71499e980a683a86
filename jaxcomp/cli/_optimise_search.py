"""The work behind `jaxcomp optimise`: reading the problem, searching, writing."""

import time
from pathlib import Path
from typing import Any

from .._waits import progress_of, spinner
from ..design import (
    AnalysisOptions,
    ParetoFront,
    Problem,
    by_name,
    optimise,
    pareto,
    problem,
    quantity,
    variable,
)
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
from ._options import analysis_solver
from ._output import hand_out


def searched(asked: dict[str, Any], as_json: bool, out: Path | None) -> None:
    """Search for an optimum or trace a front, write and show it.

    Args:
        asked: what was typed, by the names of the options.
        as_json: whether to print JSON.
        out: folder of the files.
    """
    begun = time.perf_counter()
    varied = [*asked["variables"], *asked["scatter"]]
    scene = changed_scene(asked["machine"], asked["sets"], (), varied)
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
    seconds = time.perf_counter() - begun

    def figures():
        from ..plot import optimum_figures, pareto_front

        return {"pareto": pareto_front(found)} if other else optimum_figures(found)

    if isinstance(found, ParetoFront):
        result, tables = front_result(scene, asked, found, seconds), front_tables
        curves, written = "front", "Report, picture, result and scene"
    else:
        result, tables = optimum_result(scene, asked, found, seconds), optimum_tables
        curves, written = "designs", "Report, pictures, designs, result and optimised scene"
        with spinner("Comparing with the present design ..."):
            result["comparison"] = comparison(found)
        scene, result["not_in_scene"] = optimised_scene(scene, found)
    columns = {curves: found.columns()}
    hand_out(result, tables(result), as_json, out, figures, scene, columns, written)


def _problem(asked: dict[str, Any], design: Machine, others: list[str]) -> Problem:
    ranges = {}
    for name, text in by_name(design, assignments(asked["variables"], "--variable")).items():
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
    options = AnalysisOptions(analysis_solver(asked["accuracy"]))
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
