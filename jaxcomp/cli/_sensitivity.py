"""`jaxcomp sensitivity`: how much quantities change with every number of a machine."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

import jaxcomp as jc

from ._arguments import changed_scene
from ._completion import complete_quantity
from ._errors import CommandError, reports_errors
from ._optimise import Accuracy
from ._options import AsJson, Designs, Excitation, Machine, Out, Sets
from ._output import show_results, write_results
from ._start import start_jax
from ._tables import _table


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
    from ._optimise_search import SOLVERS
    from ._sweep import default_quantities

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


def sensitivity_result(found: jc.design.Sensitivity, machine: str) -> dict[str, Any]:
    """The answer in SI units, the largest influence first. The keys are stable."""
    return {
        "machine": machine,
        "quantities": [
            {
                "name": name,
                "unit": unit,
                "value": float(value),
                "numbers": [
                    {
                        "name": one.number,
                        "words": one.part,
                        "unit": one.unit,
                        "value": one.present,
                        "elasticity": one.elasticity if one.relative else None,
                        "derivative": one.derivative,
                    }
                    for one in found.ranking(name)
                ],
            }
            for name, unit, value in zip(
                found.quantities, found.quantity_units, found.value, strict=True
            )
        ],
    }


def sensitivity_tables(found: jc.design.Sensitivity, rows: int) -> list[Table]:
    """For each quantity the numbers with the largest influence."""
    from .._shown import shown

    tables = []
    for name, unit, value in zip(found.quantities, found.quantity_units, found.value, strict=True):
        look, ranked = shown(name, unit, value), found.ranking(name)
        title = f"{look.words} {look.text(float(value))}: its change with every number"
        table = _table(title, "Number", "Value", "Change", numbers=True)
        for part in (True, False):
            kind = [one for one in ranked if one.relative is part]
            for one in kind[:rows]:
                table.add_row(escape(one.part), one.value, one.change)
            if len(kind) > rows:
                table.add_row(f"and {len(kind) - rows} more with less", "", "")
            table.add_section()
        idle = len(found.numbers) - len(ranked)
        if idle:
            what = "number of the machine has" if idle == 1 else "numbers of the machine have"
            table.caption = f"{idle} other {what} no influence."
            table.caption_justify = "left"
        tables.append(table)
    return tables
