"""`jaxcomp list`: the bundled machines or fluids, or the values of a machine with their sources."""

from typing import Annotated

import typer

from ._completion import complete_machine
from ._errors import reports_errors


@reports_errors
def list_machines(
    machine: Annotated[
        str | None,
        typer.Argument(
            help="Machine or scene file whose values and sources to show, or `fluids`.",
            autocompletion=complete_machine,
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False,
) -> None:
    """List the bundled machines, the fluids, or every value of one machine with its source.

    Example: [bold]jaxcomp list mayekawa-wbhe[/bold], [bold]jaxcomp list fluids[/bold]
    """

    from ..scene import describe, load, machines
    from ._output import show_results
    from ._start import start_jax
    from ._tables import fluid_table, machine_table, value_table

    if machine == "fluids":
        from ..fluid import fluid_data, fluids

        data = [fluid_data(name) for name in fluids()]
        keys = ("name", "description", "source", "licence")
        found = {"fluids": [{key: fluid[key] for key in keys} for fluid in data]}
        show_results(found, [fluid_table(data)], as_json, None)
        return
    if machine is None:
        known = machines()
        found = {"machines": [m._asdict() for m in known]}
        show_results(found, [machine_table(known)], as_json, None)
        return
    start_jax()
    scene = load(machine)
    rows = describe(scene)
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
    show_results(found, [value_table(scene, rows)], as_json, None)
