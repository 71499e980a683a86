"""`jaxcomp compare` and `sensitivity`: designs beside each other, and what every number does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer

import jaxcomp as jc

from .._core.display import shown
from . import _options as opt
from ._arguments import assignments, changed_scene
from ._output import Output, OutputWithoutScene
from ._start import CommandError, refuse, start_jax, waiting
from ._sweep import default_quantities
from ._tables import beside_table, row_table


def compare(
    *,
    machines: Annotated[list[str], typer.Argument(autocompletion=opt.complete_machine)],
    variants: Annotated[
        list[str] | None, typer.Option("--with", autocompletion=opt.complete_variable)
    ] = None,
    sets: opt.Sets = None,
    quantity: opt.Quantities = None,
    output: OutputWithoutScene,
) -> None:
    """Show efficiency, power, losses, forces and dimensions of designs beside each other.

    Of machines with valves COP, capacity, electric power and what it is spent on as well.

    Changes are those against the first design. `--set` holds for all of them.

    Example: [bold]jaxcomp compare mayekawa-wbhe --with bore_at_displacement=120mm --with
    motor.mean_speed=800rpm[/bold]

    Args:
        machines: Bundled machines (see `jaxcomp list`) or machine files; one alone with --with.
        variants (NAME=VALUE): A variant of the machine: a value as for --set, or a design rule such as
            bore_at_displacement=120mm. Repeatable: each is a design of its own.
        quantity (NAME): Show this quantity and the dimensions alone, e.g. cop or peak_force.crank_pin.
            Repeatable.
    """
    if len(machines) + len(variants or ()) < 2:
        raise CommandError("compare: needs a second machine, or a variant by --with NAME=VALUE")
    refuse(variants and len(machines) > 1, "--with: is for one machine alone")
    start_jax(once=True)
    scenes = _scenes(machines, variants or (), sets or ())
    with waiting("Solving the periodic states (the first time they are compiled as well) ..."):
        found = jc.study.compare(scenes, quantities=quantity)
    machines_used = [
        {"label": label, "machine": scene.name, "file": scene.file}
        for label, scene in scenes.items()
    ]
    output.emit(
        found,
        lambda _: [beside_table(found)],
        lambda: jc.plot.interface.compared_figures(found),
        written="Report, pictures and result",
        beside={"machines": machines_used, "set": list(sets or ())},
    )


def _scenes(
    machines: Sequence[str], variants: Sequence[str], sets: Sequence[str]
) -> dict[str, jc.scene.Scene]:
    """The designs by their labels."""
    found = {}
    for place, machine in enumerate(machines, 1):
        scene = changed_scene(machine, sets)
        label = f"{scene.name} ({place})" if scene.name in found else scene.name
        found[label] = scene
    for text in variants:
        (name,) = assignments([text], "--with")
        refuse(text in found, f"--with {text}: is given twice")
        kept = [one for one in sets if one.partition("=")[0].strip() != name]
        found[text] = changed_scene(machines[0], [*kept, text])
    return found


def sensitivity(
    *,
    quantity: opt.Quantities = None,
    case: opt.DesignCase,
    excitation: opt.ExcitationOption = None,
    analysis: opt.FastAnalysis,
    rows: Annotated[int, typer.Option(min=1)] = 20,
    output: Output,
) -> None:
    """Show by how many per cent quantities change when each number of the machine rises by 1 %.

    Numbers that are zero, angles and temperatures are changed by one unit instead. All derivatives come
    from one reverse pass.

    Example: [bold]jaxcomp sensitivity mayekawa-wbhe --quantity mechanical_efficiency --out result[/bold]

    Args:
        quantity (NAME): Quantity, e.g. motor_power or loss_power.crank_pin; efficiency, or vibration of
            a rotor, if absent. Repeatable.
        rows: Rows of each table; JSON and CSV have every number.
    """
    scene = case.scene(once=True)
    names = list(dict.fromkeys(quantity or default_quantities(scene)))
    with waiting():
        options = analysis.options(scene, excitation)
        found = jc.study.sensitivity(scene, names, options=options)
    if not found.ok:
        raise CommandError(
            f"{case.machine}: is not solved, so that it has no derivatives; `jaxcomp run` says why"
        )
    output.emit(
        found,
        lambda _: sensitivity_tables(found, rows),
        lambda: jc.plot.interface.sensitivity_figures(found, scene.name),
        scene,
        {"sensitivity": found.columns},
        beside={"machine": scene.name},
    )


def sensitivity_tables(found: jc.study.Sensitivity, rows: int) -> Iterator[Any]:
    """For each quantity the numbers with the largest influence."""
    rows_of = zip(found.quantities, found.quantity_units, found.value, strict=True)
    for name, unit, value in rows_of:
        look = shown(name, unit, value)
        ranked = found.ranking(name)
        listed = []
        for relative in (True, False):
            kind = [one for one in ranked if one.relative is relative]
            listed += [(one.part, one.value, one.change) for one in kind[:rows]]
            listed += [(f"and {len(kind) - rows} more with less", "", "")] * (len(kind) > rows)
            listed.append(())
        title = f"{look.words} {look.text(float(value))}: its change with every number"
        table = row_table(title, ("Number", "Value", "Change"), listed)
        idle = len(found.numbers) - len(ranked)
        if idle:
            what = "number of the machine has" if idle == 1 else "numbers of the machine have"
            table.caption = f"{idle} other {what} no influence."
        yield table
