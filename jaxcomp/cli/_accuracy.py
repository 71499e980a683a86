"""`jaxcomp accuracy`: error against run time, and what each part of a scene costs."""

import enum
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets


class Of(enum.StrEnum):
    """What is studied."""

    orbit = "orbit"
    order = "order"


# What the errors are of if nothing is said.
_QUANTITY = {Of.order: "mean_speed"}


@reports_errors
def accuracy(
    machine: Machine,
    study: Annotated[
        Of,
        typer.Option(help="orbit: solvers of the periodic state; order: fixed steps of diffrax."),
    ] = Of.orbit,
    quantity: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What the errors are of, e.g. loss_power.wall; if absent, mechanical_efficiency or "
            "what suits the study.",
        ),
    ] = None,
    variable: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="What to differentiate by, for the study of gradients."),
    ] = None,
    error: Annotated[
        float, typer.Option(help="Relative error for which the cheapest setting is named.")
    ] = 1e-6,
    sets: Sets = None,
    thorough: Annotated[
        bool,
        typer.Option("--thorough", help="All methods and settings; takes several times as long."),
    ] = False,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Measure error against run time and name the cheapest setting for an error.

    Errors are relative to a reference on which two independent methods agree; where they differ is
    the floor below which no error is claimed. Times are those of warm calls, compiling apart.

    Example: [bold]jaxcomp accuracy mayekawa-wbhe --quantity loss_power.wall --error 1e-5
    --out result[/bold]
    """
    if not 0 < error < 1:
        raise CommandError(f"--error {error:g}: must be > 0 and < 1")
    from ._accuracy_result import accuracy_result, accuracy_tables
    from ._arguments import changed_scene
    from ._output import show_results, write_results
    from ._progress import pieces_bar, progress

    scene = changed_scene(machine, sets or (), ())
    from ..work_precision import accuracy as measure

    asked = quantity or _QUANTITY.get(study, "mechanical_efficiency")
    with pieces_bar("Measuring") as tell:
        report = measure(scene, asked, study.value, variable=variable, thorough=thorough, tell=tell)
    result = accuracy_result(report, error)
    tables = list(accuracy_tables(report, error))
    if out is not None:
        from ..plot import accuracy_figures

        with progress("Drawing ..."):
            write_results(out, accuracy_figures(report, error), result, scene, tables)
    show_results(result, tables, as_json, out)
