"""`jaxcomp update`: numbers of a rotor fitted to measured natural frequencies."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets


@reports_errors
def update(
    machine: Machine,
    measured: Annotated[
        Path,
        typer.Argument(
            help='CSV with a column "frequency [Hz]" and, where not the lowest ones were measured, '
            '"mode", counted from 1 with every pair of equal frequencies as one.'
        ),
    ],
    variable: Annotated[
        list[str],
        typer.Option(
            "--variable",
            metavar="PATH",
            help="Numbers that get one common factor, e.g. rotor.shafts.5.young_modulus, or one of "
            "a list, e.g. rotor.shafts.5.outer_diameter.0. Repeatable.",
        ),
    ],
    sets: Sets = None,
    within: Annotated[
        str, typer.Option("--range", metavar="LOW:HIGH", help="Bounds of every factor.")
    ] = "0.5:2",
    held: Annotated[
        bool, typer.Option("--held", help="Measured in its bearings, not hanging free.")
    ] = False,
    regularisation: Annotated[
        float, typer.Option(help="Penalty on the distance from the scene's values, 0 for none.")
    ] = 0.0,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Fit numbers of a rotor, such as elastic moduli or springs, to a modal test.

    Example: [bold]jaxcomp update hermetic-68cc modes.csv --variable rotor.shafts.5.outer_diameter
    [/bold]
    """
    from .._waits import spinner
    from ._arguments import assignments, changed_scene
    from ._output import show_results, write_results
    from ._rotor import rotor_of
    from ._start import start_jax
    from ._update_result import read_frequencies, update_result, update_tables

    try:
        low, high = (float(part) for part in within.split(":"))
    except ValueError:
        raise CommandError(f"--range {within}: must have the form low:high") from None
    if not 0 < low < 1 < high < float("inf"):
        raise CommandError(f"--range {within}: must be positive and hold the factor 1")
    frequencies, modes = read_frequencies(measured)
    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    model = rotor_of(scene)
    with spinner("Fitting (the first time it is compiled as well) ..."):
        result: dict[str, Any]
        result, scene = update_result(
            scene, model, variable, frequencies, modes, (low, high), not held, regularisation
        )
    result["set"] = assignments(sets or (), "--set")
    tables = update_tables(result)
    if out is not None:
        with spinner("Drawing ..."):
            from ..plot import rotor_drawing

            write_results(out, {"rotor": rotor_drawing(rotor_of(scene))}, result, scene, tables)
    show_results(result, tables, as_json, out)
