"""`jaxcomp list`: machines, fluids and quantities, and the values and variables of a machine."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .._registry import DESIGN_RULES, Quantity, registered
from .._shown import units_of
from ._completion import complete_machine
from ._errors import CommandError, reports_errors

# Coordinates of correction masses, which no file has.
_OTHERS = {
    "x": "Correction mass times radius along x.",
    "y": "Correction mass times radius along y.",
    "magnitude": "Correction mass times radius.",
    "angle": "Angle of the correction mass from x.",
}


@reports_errors
def list_machines(
    machine: Annotated[
        str | None,
        typer.Argument(
            help="Machine or scene file whose values and sources to show, or `fluids`.",
            autocompletion=complete_machine,
        ),
    ] = None,
    quantities: Annotated[
        bool,
        typer.Option(
            "--quantities",
            help="Quantities that studies know, with unit and meaning; of a machine joint by joint.",
        ),
    ] = False,
    variables: Annotated[
        bool,
        typer.Option(
            "--variables", help="Numbers of a machine that studies can change, and design rules."
        ),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False,
) -> None:
    """List the bundled machines, the fluids, the quantities, or what one machine has.

    Example: [bold]jaxcomp list mayekawa-wbhe[/bold], [bold]jaxcomp list fluids[/bold], [bold]jaxcomp
    list --quantities[/bold], [bold]jaxcomp list --variables mayekawa-wbhe[/bold]
    """
    if variables and (machine is None or quantities):
        raise CommandError("--variables: needs a machine, and goes without --quantities")
    from ._output import show_results

    found, table = _listed(machine, quantities, variables)
    show_results(found, [table], as_json, None)


def _listed(machine: str | None, quantities: bool, variables: bool) -> tuple[dict[str, Any], Any]:
    """What is listed, and a table of it."""
    from ..scene import describe, did_you_mean, load, machines
    from . import _tables

    known = machines()
    if machine == "fluids" and not quantities:
        from ..fluid import fluid_data, fluids

        data = [fluid_data(name) for name in fluids()]
        keys = ("name", "description", "source", "licence")
        return {"fluids": [{k: fluid[k] for k in keys} for fluid in data]}, _tables.fluid_table(
            data
        )
    if machine is None and not quantities:
        return {"machines": [one._asdict() for one in known]}, _tables.machine_table(known)
    if machine is None:
        rows = {one.name: one for one in registered()}
        return {"quantities": _quantities(rows)}, _tables.quantity_table(rows, "Quantities")
    names = [one.name for one in known]
    if machine not in names and not Path(machine).exists() and not machine.endswith(".toml"):
        near = did_you_mean(machine, [*names, "fluids"])
        raise CommandError(f"list {machine}: is no machine, no file and not `fluids`{near}")
    from ._start import start_jax

    start_jax()
    scene = load(machine)
    if quantities:
        from ..design import available_quantities

        rows = available_quantities(scene.machine, members=True)
        return {"quantities": _quantities(rows)}, _tables.quantity_table(rows, scene.name)
    rows = describe(scene)
    if variables:
        from ..design import variable, variable_names

        docs = {row.path: row.doc for row in rows} | DESIGN_RULES
        listed = [variable(scene.machine, name) for name in variable_names(scene.machine)]
        entries = {
            one.name: {
                "unit": one.unit,
                "value": float(one.current(scene.machine)),
                "bound": str(one.bound),
                "doc": _meaning(scene.machine, one.name, docs),
            }
            for one in listed
        }
        return {"variables": entries}, _tables.variable_table(scene.name, entries)
    values = {
        row.path: {
            "value": row.value.tolist() if hasattr(row.value, "tolist") else row.value,
            "unit": row.unit,
            "given": row.given,
            "source": row.source,
            "doc": row.doc,
        }
        for row in rows
    }
    found = {"name": scene.name, "description": scene.description, "values": values}
    return found, _tables.value_table(scene, rows)


def _meaning(machine: Any, name: str, docs: dict[str, str]) -> str:
    from ..design import list_length

    if name.startswith("corrections."):
        return _OTHERS[name.rpartition(".")[2]]
    count, doc = list_length(machine, name), docs.get(name, "")
    return f"{doc} (factor on all {count})".strip() if count else doc


def _quantities(rows: dict[str, Quantity]) -> dict[str, Any]:
    return {
        name: {
            "unit": one.unit,
            "shown": units_of(one.unit, one.percent),
            "better": one.better,
            "needs": list(one.sections),
            "doc": one.doc,
        }
        for name, one in rows.items()
    }
