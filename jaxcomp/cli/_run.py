"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors


class Solver(enum.StrEnum):
    """How the periodic state is found."""

    shooting = "shooting"
    collocation = "collocation"


@reports_errors
def run(
    machine: Annotated[
        str, typer.Argument(help="Bundled machine (see `jaxcomp list`) or scene file.")
    ],
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Set a value of the scene, e.g. motor.mean_speed=800rpm; `none` takes an optional "
            "one away. May be repeated.",
        ),
    ] = None,
    designs: Annotated[
        list[str] | None,
        typer.Option(
            "--design",
            metavar="NAME=VALUE",
            help="Set a design variable by its rule, e.g. bore=120mm at fixed displacement.",
        ),
    ] = None,
    solver: Annotated[
        Solver | None,
        typer.Option(
            help="Shooting with diffrax (default), or collocation, which compiles faster (default for "
            "a slider-link, whose many changes of side cost shooting its accuracy)."
        ),
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Tolerance of the solver; its own default if absent.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object in SI units instead of tables.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for pictures, result.json and the scene as it was run."),
    ] = None,
) -> None:
    """Find the periodic state of a machine and print efficiency, losses and forces.

    Example: [bold]jaxcomp run mayekawa-wbhe --set motor.mean_speed=800rpm --design bore=120mm --out
    result[/bold]
    """
    if tolerance is not None and not 0 < tolerance < 1:
        raise CommandError(f"--tolerance {tolerance:g}: must be > 0 and < 1")
    from rich.console import Console

    from ..crank import solve_orbit
    from ._arguments import assignments, changed_scene
    from ._cache import enable_compilation_cache
    from ._progress import progress
    from ._result import run_result
    from ._tables import print_json, result_tables
    from ._vibration import vibration_result, vibration_table

    enable_compilation_cache()
    scene = changed_scene(machine, sets or (), designs or ())
    method = _method(scene.machine.mechanism, solver, tolerance)
    with progress("Solving the periodic state (the first time it is compiled as well) ..."):
        orbit = solve_orbit(scene.machine, method)
        result = run_result(scene, orbit)
        if "suspension" in scene.parts:
            result["vibration"] = vibration_result(scene, orbit)
    result["tolerance"] = method.tolerance
    result["set"] = assignments(sets or (), "--set")
    result["design"] = assignments(designs or (), "--design")
    if out is not None:
        with progress("Drawing ..."):
            _write(out, scene, orbit, result)
    if as_json:
        print_json(result)
        return
    console = Console()
    for table in result_tables(scene, result):
        console.print(table)
    if "vibration" in result:
        console.print(vibration_table(result["vibration"]))
    if out is not None:
        console.print(f"Pictures, result and scene are in {out}", soft_wrap=True, markup=False)


def _method(mechanism, solver: Solver | None, tolerance: float | None):
    from ..crank import Collocation, Shooting
    from ..mechanism import SliderLink

    if solver is None:
        solver = Solver.collocation if isinstance(mechanism, SliderLink) else Solver.shooting
    options = {"kinks": mechanism.side_changes}
    if tolerance is not None:
        options["tolerance"] = tolerance
    return {"shooting": Shooting, "collocation": Collocation}[solver](**options)


def _write(folder: Path, scene, orbit, result) -> None:
    from ..plot import orbit_figures
    from ..scene import dump
    from ._tables import json_text

    folder.mkdir(parents=True, exist_ok=True)
    figures = orbit_figures(scene.machine, orbit, scene.parts.get("suspension"))
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=150)
    (folder / "result.json").write_text(json_text(result) + "\n", encoding="utf-8")
    (folder / "scene.toml").write_text(dump(scene), encoding="utf-8")
