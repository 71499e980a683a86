"""`jaxcomp compare`: machines, or variants of one, beside each other."""

from typing import Annotated, Any

import typer

import jaxcomp as jc

from ._arguments import assignments, changed_scene
from ._completion import complete_machine, complete_variable
from ._errors import CommandError, reports_errors
from ._options import AsJson, OutWithoutScene, Sets
from ._output import hand_out
from ._start import start_jax
from ._tables import beside_table


@reports_errors
def compare(
    machines: Annotated[
        list[str],
        typer.Argument(
            help="Bundled machines (see `jaxcomp list`) or scene files; one alone with --with.",
            autocompletion=complete_machine,
        ),
    ],
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="NAME=VALUE",
            help="A variant of the machine: a value as for --set, or a design rule such as bore=120mm "
            "(at fixed displacement). Repeatable: each is a design of its own.",
            autocompletion=complete_variable,
        ),
    ] = None,
    sets: Sets = None,
    as_json: AsJson = False,
    out: OutWithoutScene = None,
) -> None:
    """Show efficiency, power, losses, forces and dimensions of designs beside each other.

    Changes are those against the first design. `--set` holds for all of them.

    Example: [bold]jaxcomp compare mayekawa-wbhe --with bore=120mm --with bore=140mm[/bold]
    """
    if len(machines) + len(variants or ()) < 2:
        raise CommandError("compare: needs a second machine, or a variant by --with NAME=VALUE")
    if variants and len(machines) > 1:
        raise CommandError("--with: is for one machine alone")
    from .._status import SolveFailed
    from .._waits import spinner

    start_jax(once=True)
    scenes, orbits = _scenes(machines, variants or (), sets or ()), []
    with spinner("Solving the periodic states (the first time they are compiled as well) ..."):
        for label, scene in scenes.items():
            try:
                orbits.append(jc.solve_orbit(scene.as_compressor()))
            except SolveFailed as error:
                raise CommandError(f"{label}: {error}") from None
    designs = [one.machine for one in scenes.values()]
    rows = [one._asdict() for one in jc.design.compared_designs(designs, orbits)]
    result: dict[str, Any] = {
        "machines": [
            {"label": label, "machine": scene.name, "file": scene.file}
            for label, scene in scenes.items()
        ],
        "set": list(sets or ()),
        "figures": rows,
    }

    def figures():
        return {"losses": jc.plot.compared_losses(rows, list(scenes))}

    tables, written = [beside_table(rows, list(scenes))], "Report, picture and result"
    hand_out(result, tables, as_json, out, figures, written=written)


def _scenes(machines, variants, sets) -> dict[str, Any]:
    """The designs by their labels."""
    found = {}
    for place, machine in enumerate(machines, 1):
        scene = changed_scene(machine, sets)
        label = f"{scene.name} ({place})" if scene.name in found else scene.name
        found[label] = scene
    for text in variants:
        (name,) = assignments([text], "--with")
        if text in found:
            raise CommandError(f"--with {text}: is given twice")
        kept = [one for one in sets if one.partition("=")[0].strip() != name]
        found[text] = changed_scene(machines[0], [*kept, text])
    return found
