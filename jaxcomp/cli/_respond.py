"""`jaxcomp respond`: harmonic response of rotor, crankcase and housing to unbalances and forces."""

from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets


@reports_errors
def respond(
    machine: Machine,
    sets: Sets = None,
    speed: Annotated[
        list[str] | None,
        typer.Option(
            "--speed",
            metavar="SPEED",
            help="Speed to solve, e.g. 3000rpm; those of the scene if absent. May be repeated.",
        ),
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO:COUNT", help="Range for response curves, e.g. 600rpm:6000rpm:200."
        ),
    ] = None,
    orders: Annotated[
        str | None,
        typer.Option(metavar="N,N,...", help="Orders of the speed; all that are loaded if absent."),
    ] = None,
    node: Annotated[
        list[str] | None,
        typer.Option(
            "--node", help="Node to report; the target planes (or all) if absent. May be repeated."
        ),
    ] = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Find the vibration of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp respond hermetic-68cc --speed 3000rpm --speeds 300rpm:6000rpm:200 --out
    result[/bold]
    """
    from .._waits import spinner
    from ..rotor import LoadCase
    from ._arguments import assignments, changed_scene
    from ._output import show_results
    from ._rotor_result import Watched, curve_result, respond_result, watched_nodes, whole_orders
    from ._rotor_tables import response_tables
    from ._speeds import rotor_of, single_speeds, speed_range
    from ._start import start_jax

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    rotor_of(scene)
    case = scene.parts.get("loads")
    if not isinstance(case, LoadCase) or not case.loads:
        raise CommandError(f"{scene.file}: loads: is missing; nothing shakes this rotor")
    loads = case.loads
    wanted = whole_orders(orders, loads)
    points = single_speeds(speed or (), scene)
    range_ = None if speeds is None else speed_range(speeds)
    model = rotor_of(scene, points, range_)
    watched: Watched = watched_nodes(scene, model, node or ())
    with spinner("Solving (the first time it is compiled as well) ..."):
        result, response = respond_result(scene, model, loads, points, wanted, watched)
        if range_ is not None:
            result["curves"] = curve_result(model, loads, range_, wanted, watched)
    result["set"] = assignments(sets or (), "--set")
    tables = response_tables(result)
    if out is not None:
        with spinner("Drawing ..."):
            _write(out, scene, model, response, result, tables)
    show_results(result, tables, as_json, out)


def _write(folder: Path, scene, model, response, result, tables) -> None:
    from ..plot import deflection_shape, response_curves, response_orbits, rotor_drawing
    from ._output import write_results
    from ._rotor_result import curve_columns, response_columns

    figures = {
        "rotor": rotor_drawing(model),
        "shape": deflection_shape(model, response),
        "orbits": response_orbits(result),
    }
    if "curves" in result:
        figures["curves"] = response_curves(result)
    tabled = {"response": response_columns(result)}
    if "curves" in result:
        tabled["curves"] = curve_columns(result)
    write_results(folder, figures, result, scene, tables, tabled)
