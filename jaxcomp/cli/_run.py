"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

from __future__ import annotations

import dataclasses
from typing import Any

import jaxcomp as jc

from .._core.declared import Record, reading
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
    load_steps: bool = False,
    step: float | None = None,
    output: Output,
) -> None:
    """Find the periodic state of a machine and print efficiency, losses and forces.

    Example: [bold]jaxcomp run mayekawa-wbhe --set motor.mean_speed=800rpm --design
    bore_at_displacement=120mm --out result[/bold]

    Args:
        tolerance: Tolerance of the solver; its own default if absent.
        verify: March one revolution from the result with diffrax, independently, and print the errors
            that it finds; always done with --out.
        moving_films: Show as well what the journals with steady films would do if they moved.
        load_steps: Solve the machine at each of its load steps as well: flow, power, rod loads, reversal.
        step (DEGREES): Of the crank angle in curves.csv, from -180 to 180, e.g. 1; at the nodes of the
            solver if absent.
    """
    if tolerance is not None:
        refuse(not 0 < tolerance < 1, f"--tolerance {tolerance:g}: must be > 0 and < 1")
    even = step is None or (0.01 <= step <= 90 and abs(360 / step - round(360 / step)) < 1e-9)
    refuse(
        not even, f"--step {step}: must divide 360 degrees and be from 0.01 to 90, such as 1 or 0.5"
    )
    refuse(
        step is not None and output.out is None, "--step: is for curves.csv, and needs --out FOLDER"
    )
    scene = case.scene(once=True)
    compressor = scene.as_compressor()
    refuse(
        load_steps and not getattr(compressor.gas, "load_steps", ()),
        "--load-steps: needs [[gas.load_steps]] in the machine file, each with a `name` and its "
        "`unloaded` or `pockets`, as in process-two-stage",
    )
    method = opt.with_cycle(opt.solver_of(solver, compressor), cycle)
    if tolerance is not None:
        method = dataclasses.replace(method, tolerance=tolerance)
    with waiting("Solving the periodic state (the first time it is compiled as well) ..."):
        state = _solved(scene, method, verify or output.out is not None, moving_films, output)
        if load_steps:
            state = dataclasses.replace(state, load_steps=jc.study.load_steps(scene, method))

    def pictures():
        from ..plot._crank import steady_state_figures

        return steady_state_figures(state)

    output.emit(
        state,
        lambda result: run_tables(scene, result),
        pictures,
        scene,
        {"curves": lambda: _curves(state, step)},
        metadata={**header(scene), **case.changes},
        numbers=RunSettings(method.tolerance),
    )


@dataclasses.dataclass(frozen=True)
class RunSettings(Record):
    """The tolerance [-] of the periodic state."""

    tolerance: float = reading("")


def _curves(state: jc.study.SteadyState, step: float | None) -> dict[str, Any]:
    from ._curves import curves  # imports JAX, which help and completion do without

    return curves(state, step)


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
