"""`jaxcomp sensitivity`: how much quantities change with every number of a machine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import typer
from rich.markup import escape

import jaxcomp as jc

from .._shown import shown
from ._arguments import changed_scene
from ._completion import complete_quantity
from ._errors import CommandError, reports_errors
from ._options import (
    Accuracy,
    AccuracyOption,
    AsJson,
    Designs,
    ExcitationOption,
    Machine,
    Out,
    Sets,
    analysis_solver,
)
from ._output import hand_out
from ._start import start_jax
from ._sweep import default_quantities
from ._tables import row_table


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
    excitation: ExcitationOption = None,
    accuracy: AccuracyOption = Accuracy.fast,
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

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), designs or ())
    options = jc.AnalysisOptions(analysis_solver(accuracy), excitation and excitation.value)
    names = list(dict.fromkeys(quantity or default_quantities(scene)))
    with spinner("Solving (the first time it is compiled as well) ..."):
        found = jc.design.sensitivity(scene, names, options=options)
    if not found.ok:
        raise CommandError(
            f"{machine}: is not solved, so that it has no derivatives; `jaxcomp run` says why"
        )
    result, tables = sensitivity_result(found, scene.name), sensitivity_tables(found, rows)

    def figures():
        return jc.plot.sensitivity_figures(found, scene.name)

    curves = None if out is None else {"sensitivity": found.columns()}
    hand_out(result, tables, as_json, out, figures, scene, curves)


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


def sensitivity_tables(found: jc.design.Sensitivity, rows: int) -> Iterator[Any]:
    """For each quantity the numbers with the largest influence."""
    for name, unit, value in zip(found.quantities, found.quantity_units, found.value, strict=True):
        look, ranked = shown(name, unit, value), found.ranking(name)
        listed = []
        for relative in (True, False):
            kind = [one for one in ranked if one.relative is relative]
            listed += [(escape(one.part), one.value, one.change) for one in kind[:rows]]
            listed += [(f"and {len(kind) - rows} more with less", "", "")] * (len(kind) > rows)
            listed.append(())
        title = f"{look.words} {look.text(float(value))}: its change with every number"
        table = row_table(title, ("Number", "Value", "Change"), listed)
        idle = len(found.numbers) - len(ranked)
        if idle:
            what = "number of the machine has" if idle == 1 else "numbers of the machine have"
            table.caption = f"{idle} other {what} no influence."
            table.caption_justify = "left"
        yield table
