"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, Designs, Machine, Out, Sets


class Solver(enum.StrEnum):
    """How the periodic state is found."""

    collocation = "collocation"
    shooting = "shooting"


@reports_errors
def run(
    machine: Machine,
    sets: Sets = None,
    designs: Designs = None,
    solver: Annotated[
        Solver,
        typer.Option(
            help="Collocation of the whole turn, or shooting with diffrax: an independent check that "
            "compiles longer."
        ),
    ] = Solver.collocation,
    tolerance: Annotated[
        float | None, typer.Option(help="Tolerance of the solver; its own default if absent.")
    ] = None,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="March one revolution from the result with diffrax, independently, and print the "
            "errors that it finds; always done with --out.",
        ),
    ] = False,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Find the periodic state of a machine and print efficiency, losses and forces.

    Example: [bold]jaxcomp run mayekawa-wbhe --set motor.mean_speed=800rpm --design bore=120mm --out
    result[/bold]
    """
    if tolerance is not None and not 0 < tolerance < 1:
        raise CommandError(f"--tolerance {tolerance:g}: must be > 0 and < 1")
    from .._waits import spinner
    from ..crank import solve_orbit
    from ._arguments import assignments, changed_scene
    from ._output import show_results
    from ._result import run_result
    from ._start import start_jax
    from ._tables import result_tables
    from ._vibration import vibration_result, vibration_table

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), designs or ())
    method = _method(scene.as_compressor().mechanism, solver, tolerance)
    with spinner("Solving the periodic state (the first time it is compiled as well) ..."):
        verify = verify or out is not None
        orbit = solve_orbit(scene.as_compressor(), method, verify=verify)
        result = run_result(scene, orbit)
        if "suspension" in scene.parts:
            result["vibration"] = vibration_result(scene, orbit)
    result["tolerance"] = method.tolerance
    result["set"] = assignments(sets or (), "--set")
    result["design"] = assignments(designs or (), "--design")
    tables = result_tables(scene, result)
    if "vibration" in result:
        tables.append(vibration_table(result["vibration"]))
    if out is not None:
        with spinner("Drawing ..."):
            _write(out, scene, orbit, result, tables)
    show_results(result, tables, as_json, out)


def _method(mechanism, solver: Solver, tolerance: float | None):
    from ..crank import Collocation, Shooting

    options = {"reversals": mechanism.load_reversals}
    if tolerance is not None:
        options["tolerance"] = tolerance
    return {"shooting": Shooting, "collocation": Collocation}[solver](**options)


def _write(folder: Path, scene, orbit, result, tables) -> None:
    from ..plot import orbit_figures
    from ._output import write_results
    from ._result import orbit_curves

    figures = orbit_figures(scene.as_compressor(), orbit, scene.parts.get("suspension"))
    write_results(folder, figures, result, scene, tables, {"curves": orbit_curves(scene, orbit)})
