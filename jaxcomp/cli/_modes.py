"""`jaxcomp modes`: natural frequencies, damping, critical speeds and the Campbell diagram."""

from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets


@reports_errors
def modes(
    machine: Machine,
    sets: Sets = None,
    speed: Annotated[
        list[str] | None,
        typer.Option(
            "--speed",
            metavar="SPEED",
            help="Spin speed, e.g. 3000rpm; those of the scene if absent. May be repeated.",
        ),
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO:COUNT",
            help="Range for Campbell diagram and critical speeds, e.g. 300rpm:6000rpm:60.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(help="Number of modes.")] = 12,
    free: Annotated[
        bool, typer.Option("--free", help="Without bearings, mounts and side pull (free-free).")
    ] = False,
    overdamped: Annotated[
        bool,
        typer.Option("--overdamped", help="Show modes with a damping above 70 % as well."),
    ] = False,
    undamped: Annotated[bool, typer.Option("--undamped", help="Without damping.")] = False,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Find the modes of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp modes hermetic-68cc --speeds 300rpm:6000rpm:60 --out result[/bold]
    """
    from .._waits import spinner
    from ._arguments import assignments, changed_scene
    from ._output import show_results
    from ._rotor_result import campbell_result, modes_result
    from ._rotor_tables import modes_tables
    from ._speeds import rotor_of, single_speeds, speed_range
    from ._start import start_jax

    if speeds is not None and free:
        raise CommandError("--free: has no Campbell diagram here; leave out --speeds")
    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    points = single_speeds(speed or (), scene)
    range_ = None if speeds is None else speed_range(speeds)
    model = rotor_of(scene, *(() if free else (points, range_)))
    with spinner("Solving (the first time it is compiled as well) ..."):
        result, found = modes_result(scene, model, points, count, free, not undamped)
        if range_ is not None:
            result["campbell"] = campbell_result(model, range_, count, not undamped)
    result["set"] = assignments(sets or (), "--set")
    tables = modes_tables(result, overdamped)
    if out is not None:
        with spinner("Drawing ..."):
            _write(out, scene, model, found, result, tables)
    show_results(result, tables, as_json, out)


def _write(folder: Path, scene, model, found, result, tables) -> None:
    from ..plot import campbell_diagram, mode_shapes, rotor_drawing
    from ._output import write_results
    from ._rotor_result import modes_columns

    figures = {"rotor": rotor_drawing(model), "modes": mode_shapes(model, found[0], result)}
    if "campbell" in result:
        figures["campbell"] = campbell_diagram(result["campbell"])
    tabled = {"modes": modes_columns(result, False)}
    if "campbell" in result:
        tabled["campbell"] = modes_columns(result, True)
    write_results(folder, figures, result, scene, tables, tabled)
