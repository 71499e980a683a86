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
    from rich.console import Console

    from ..scene import describe, load, machines
    from ._json import print_json
    from ._start import start_jax
    from ._tables import fluid_table, machine_table, value_table

    if machine == "fluids":
        from ..fluid import fluid_data, fluids

        data = [fluid_data(name) for name in fluids()]
        if as_json:
            keys = ("name", "description", "source", "licence")
            print_json({"fluids": [{key: fluid[key] for key in keys} for fluid in data]})
        else:
            Console().print(fluid_table(data))
        return
    if machine is None:
        known = machines()
        if as_json:
            print_json({"machines": [m._asdict() for m in known]})
        else:
            Console().print(machine_table(known))
        return
    start_jax()
    scene = load(machine)
    rows = describe(scene)
    if as_json:
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
        print_json({"name": scene.name, "description": scene.description, "values": values})
    else:
        Console().print(value_table(scene, rows))
