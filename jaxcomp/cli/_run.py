"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

from __future__ import annotations

import dataclasses
from typing import Any

import jaxcomp as jc

from . import _options as opt
from ._output import Output, header, print_tables
from ._run_tables import run_tables, undelivered_tables
from ._start import refuse, waiting


def run(
    *,
    case: opt.DesignCase,
    solver: opt.Solver = "collocation",
    tolerance: float | None = None,
    cycle: opt.CycleOption = None,
    verify: bool = False,
    moving_films: bool = False,
    output: Output,
) -> None:
    """Find the periodic state of a machine and print efficiency, losses and forces.

    Example: [bold]jaxcomp run mayekawa-wbhe --set motor.mean_speed=800rpm --design bore=120mm --out
    result[/bold]

    Args:
        tolerance: Tolerance of the solver; its own default if absent.
        verify: March one revolution from the result with diffrax, independently, and print the errors
            that it finds; always done with --out.
        moving_films: Show as well what the journals with steady films would do if they moved.
    """
    if tolerance is not None:
        refuse(not 0 < tolerance < 1, f"--tolerance {tolerance:g}: must be > 0 and < 1")
    scene = case.scene(once=True)
    compressor = scene.as_compressor()
    method = opt.with_cycle(opt.solver_of(solver, compressor), cycle)
    if tolerance is not None:
        method = dataclasses.replace(method, tolerance=tolerance)
    with waiting("Solving the periodic state (the first time it is compiled as well) ..."):
        found = _solved(scene, method, verify or output.out is not None, moving_films, output)
    output.emit(
        found,
        lambda whole: run_tables(scene, whole),
        lambda: jc.plot.interface.steady_state_figures(found),
        scene,
        {"curves": lambda: _curves(found)},
        beside={**header(scene), "tolerance": method.tolerance, **case.changes},
    )


def _curves(found: jc.study.SteadyState) -> dict[str, Any]:
    """The columns of a result with the crank angle in degrees in front."""
    import numpy as np

    columns = found.columns()
    named = {f"{k} []" if k.startswith("eccentricity.") else k: v for k, v in columns.items()}
    return {"crank_angle [deg]": np.rad2deg(columns["crank_angle [rad]"]), **named}


def _solved(
    scene: jc.scene.Scene, method: Any, verify: bool, moving_films: bool, output: Output
) -> jc.study.SteadyState:
    """The periodic state; of a machine that delivers nothing the cylinder is shown before the error."""
    from .._core.status import SolveFailed, Status

    try:
        return jc.study.steady_state(scene, method, verify=verify, moving_films=moving_films)
    except SolveFailed as error:
        if error.status == Status.no_delivery and not output.as_json:
            print_tables(undelivered_tables(error.result))
        raise
