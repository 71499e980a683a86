"""`jaxcomp sensitivity`: how much quantities change with every number of a machine."""

from typing import Annotated

import typer

from ._balance import Excitation
from ._completion import complete_quantity
from ._errors import CommandError, reports_errors
from ._optimise import Accuracy
from ._options import AsJson, Designs, Machine, Out, Sets


@reports_errors
def sensitivity(
    machine: Machine,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Quantity, e.g. motor_power or loss_power.crank_pin; efficiency, or vibration of a "
            "rotor, if absent. Repeatable.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    sets: Sets = None,
    designs: Designs = None,
    excitation: Annotated[
        Excitation | None,
        typer.Option(help="What shakes a rotor: forces of the file, or of the crank."),
    ] = None,
    accuracy: Annotated[
        Accuracy,
        typer.Option(help="fast: efficiency to 1e-5, compiles three times as fast."),
    ] = Accuracy.fast,
    rows: Annotated[
        int, typer.Option(help="Rows of each table; JSON and CSV have every number.", min=1)
    ] = 20,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Show by how many per cent quantities change when each number of the machine rises by 1 %.

    Numbers that are zero, and angles, are changed by one unit instead. All derivatives come from one
    reverse pass.

    Example: [bold]jaxcomp sensitivity mayekawa-wbhe --quantity mechanical_efficiency --out result[/bold]
    """
    from .._waits import spinner
    from ..design import AnalysisOptions
    from ..design import sensitivity as study
    from ..plot import sensitivity_figures
    from ._arguments import changed_scene
    from ._optimise_search import SOLVERS
    from ._output import show_results, write_results
    from ._sensitivity_result import sensitivity_result, sensitivity_tables
    from ._start import start_jax
    from ._sweep_options import default_quantities

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), designs or ())
    options = AnalysisOptions(SOLVERS[accuracy.value], excitation and excitation.value)
    asked = list(dict.fromkeys(quantity or default_quantities(scene)))
    with spinner("Solving (the first time it is compiled as well) ..."):
        found = study(scene, asked, options=options)
    if not found.ok:
        raise CommandError(
            f"{machine}: is not solved, so that it has no derivatives; `jaxcomp run` says why"
        )
    result, tables = sensitivity_result(found, scene.name), sensitivity_tables(found, rows)
    if out is not None:
        figures = sensitivity_figures(found, scene.name)
        write_results(out, figures, result, scene, tables, {"sensitivity": found.columns()})
    show_results(result, tables, as_json, out)
