"""Arguments that several commands declare alike."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._completion import complete_machine, complete_rule, complete_variable


class Accuracy(enum.StrEnum):
    """How the periodic state is solved, of many designs."""

    fine = "fine"
    fast = "fast"
    coarse = "coarse"


def analysis_solver(accuracy: Accuracy):
    """The solver of an accuracy; `None` for the one that the design chooses."""
    from ..crank import Collocation

    if accuracy == Accuracy.fine:
        return None
    nodes, tolerance = (12, 1e-10) if accuracy == Accuracy.fast else (8, 1e-5)
    return Collocation(nodes, reversals=0, tolerance=tolerance)


class Excitation(enum.StrEnum):
    """Forces on the rotor."""

    file = "file"
    crank = "crank"


Machine = Annotated[
    str,
    typer.Argument(
        help="Bundled machine (see `jaxcomp list`) or scene file.", autocompletion=complete_machine
    ),
]
AccuracyOption = Annotated[
    Accuracy,
    typer.Option(
        "--accuracy",
        help="Of the periodic state. fine: to 1e-9 of the work; fast: to 1e-5, compiles three times as "
        "fast; coarse: to 3e-5, for the most designs a second.",
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Set a value of the scene (motor.mean_speed=800rpm, or a pattern such as "
        "friction.*.coefficient=0.1; `none` takes an optional one away), a design rule (bore=120mm at "
        "fixed displacement) or a correction mass (corrections.PLANE.x). Repeatable.",
        autocompletion=complete_variable,
    ),
]
Designs = Annotated[
    list[str] | None,
    typer.Option(
        "--design",
        metavar="NAME=VALUE",
        help="The same as --set, for design rules. Repeatable.",
        autocompletion=complete_rule,
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in SI units instead of tables.")
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for report.html, pictures, result.json and scene.toml as it was run."
    ),
]
OutWithoutScene = Annotated[
    Path | None, typer.Option(help="Folder for report.html, pictures and result.json.")
]
ExcitationOption = Annotated[
    Excitation | None,
    typer.Option(
        help="Forces on the rotor: those of the file, or of the crank's periodic state. If absent, the "
        "crank where the machine joins it to the rotor."
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Scheduler of a Dask cluster whose workers solve the designs, e.g. tcp://host:8786, or its "
        "scheduler file (.json); this process if absent. Needs `pip install jaxcomp\\[dask]`.",
    ),
]
