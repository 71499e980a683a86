"""`jaxcomp balance`: correction masses, from the model of a machine or from measurements."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._completion import complete_machine
from ._errors import CommandError, reports_errors
from ._options import AsJson, Out, Sets


class Method(enum.StrEnum):
    """What is made small; `classical` balances the rotor alone, as a balancing machine does.

    With the crank's forces it carries a ring for the rotating part of the rod, which is among them.
    """

    least_squares = "least-squares"
    min_max = "min-max"
    classical = "classical"


class Excitation(enum.StrEnum):
    """What shakes the machine beside its unbalances."""

    file = "file"
    crank = "crank"


@reports_errors
def balance(
    machine: Annotated[
        str | None,
        typer.Argument(
            help="Bundled machine or scene file with a rotor; none with --measured.",
            autocompletion=complete_machine,
        ),
    ] = None,
    sets: Sets = None,
    planes: Annotated[
        str | None, typer.Option(metavar="A,B", help="Correction planes; all if absent.")
    ] = None,
    targets: Annotated[
        str | None, typer.Option(metavar="A,B", help="Target planes; all if absent.")
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="SPEEDS",
            help="Speeds, e.g. 3000rpm,3600rpm or 3000rpm:3600rpm:7; the scene's if absent.",
        ),
    ] = None,
    method: Annotated[
        Method, typer.Option(help="Weighted sum of squares, or the largest vibration.")
    ] = Method.least_squares,
    tikhonov: Annotated[
        float, typer.Option(help="Penalty on the masses, 0 for none; least squares only.")
    ] = 0.0,
    largest: Annotated[
        str | None,
        typer.Option(
            metavar="U",
            help="Bound of every correction, e.g. '800 g mm', or of single planes, e.g. "
            "'rotor-top=500 g mm, counterweight=300 g mm'.",
        ),
    ] = None,
    limit: Annotated[
        str | None,
        typer.Option(
            metavar="V",
            help="Find the least masses that keep every vibration at or below this, e.g. 5um.",
        ),
    ] = None,
    weights: Annotated[
        list[str] | None,
        typer.Option(
            "--weight",
            metavar="TARGET=W",
            help="How much the readings of a target count, e.g. TP5=2; 1 if absent. Repeatable.",
        ),
    ] = None,
    excitation: Annotated[
        Excitation,
        typer.Option(help="Forces of the file, or of the crank's periodic state at each speed."),
    ] = Excitation.file,
    without: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Leave gas, inertia, friction or fluctuation out of the forces of the crank.",
        ),
    ] = None,
    measured: Annotated[
        Path | None,
        typer.Option(help="CSV of an initial run and one run with a trial weight per plane."),
    ] = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    r"""Find the masses that balance a machine at its target planes.

    Example: [bold]jaxcomp balance hermetic-68cc --speeds 3000rpm,3600rpm --out result[/bold]

    A file for --measured has a line for each reading: of the initial run, and of a run with a trial
    weight in each plane, which gives the run its name and is taken off again, unless a further column
    "kept" says yes. Corrections count from the initial run. A trial is mass times radius, or a mass
    (trial \[g]) if all weights go to one radius; phase and angle are both measured in the direction of
    rotation (or both against it). A run named "run-out" at low speed is taken off all other readings; a
    column "weight" says how much a reading counts.

        run,target,speed \[rpm],amplitude \[mm/s],phase \[deg],trial \[g mm],angle \[deg]
        initial,bearing-1,3000,7.2,238,,
        plane-1,bearing-1,3000,4.9,114,120,0
    """
    if (machine is None) == (measured is None):
        raise CommandError("balance: needs either a machine or --measured FILE")
    given = {"--set": sets, "--speeds": speeds}
    if measured is not None and any(given.values()):
        name = next(option for option, value in given.items() if value)
        raise CommandError(f"{name}: has no meaning with --measured")
    if without and excitation is not Excitation.crank:
        raise CommandError("--without: needs --excitation crank")
    if method is Method.classical and (tikhonov or largest or planes or measured or limit):
        raise CommandError(
            "--method classical: takes no --planes, --tikhonov, --largest, --limit or --measured; it "
            "balances "
            "the rotor of a scene in both planes"
        )
    if method is Method.min_max and (tikhonov or largest):
        raise CommandError("--method min-max: takes neither --tikhonov nor --largest")
    if tikhonov and largest:
        raise CommandError("--largest: takes no --tikhonov beside it")
    if limit and (tikhonov or method is not Method.least_squares or weights):
        raise CommandError("--limit: takes no --method, --tikhonov or --weight beside it")
    from .._waits import spinner
    from ._balance_result import (
        Asked,
        balance_result,
        balance_tables,
        measured_system,
        model_system,
        solve,
    )
    from ._output import show_results, write_results
    from ._start import start_jax

    start_jax(once=True)
    with spinner("Solving (the first time it is compiled as well) ..."):
        if measured is not None:
            system = measured_system(measured)
        else:
            crank = excitation is Excitation.crank
            system = model_system(machine, sets or (), speeds, crank, _names(without) or ())
        asked = Asked(
            _names(planes),
            _names(targets),
            method.value,
            tikhonov,
            largest,
            limit,
            tuple(weights or ()),
        )
        found = solve(system, asked)
        result = balance_result(system, found)
    tables = balance_tables(result)
    if out is not None:
        from ..plot import balance_figures

        with spinner("Drawing ..."):
            figures = balance_figures(found, system.name)
            curves = {"balance": found.columns()}
            write_results(out, figures, result, system.scene, tables, curves)
    written = f"Report, pictures, curves{', scene' if machine else ''} and result"
    show_results(result, tables, as_json, out, written)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]
