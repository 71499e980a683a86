"""`jaxcomp compare` and `sensitivity`: designs beside each other, and what every number does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer

import jaxcomp as jc

from .._core.display import shown
from . import _options as opt
from ._arguments import assignments, changed_scene, split_at
from ._output import Output, OutputWithoutScene
from ._start import CommandError, refuse, start_jax, waiting
from ._sweep import default_quantities
from ._tables import comparison_table, row_table


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
        comparison = jc.study.compare(scenes, quantities=quantity)
    machines_used = []
    for label, scene in scenes.items():
        machines_used.append({"label": label, "machine": scene.name, "file": scene.file})

    def pictures():
        from ..plot._designs import compared_figures

        return compared_figures(comparison)

    output.emit(
        comparison,
        lambda _: [comparison_table(comparison)],
        pictures,
        written="Report, pictures and result",
        metadata={"machines": machines_used, "set": list(sets or ())},
    )


def _scenes(
    machines: Sequence[str], variants: Sequence[str], sets: Sequence[str]
) -> dict[str, jc.scene.Scene]:
    """The designs by their labels."""
    scenes = {}
    for place, machine in enumerate(machines, 1):
        scene = changed_scene(machine, sets)
        label = scene.name
        if label in scenes:
            label = f"{label} ({place})"
        scenes[label] = scene
    for text in variants:
        (name,) = assignments([text], "--with")
        refuse(text in scenes, f"--with {text}: is given twice")
        base_settings = [setting for setting in sets if split_at("=", setting)[0] != name]
        scenes[text] = changed_scene(machines[0], [*base_settings, text])
    return scenes


def sensitivity(
    *,
    quantity: opt.Quantities = None,
    case: opt.DesignCase,
    excitation: opt.ExcitationOption = None,
    analysis: opt.FastAnalysis,
    rows: Annotated[int, typer.Option(min=1)] = 20,
    verify: Annotated[bool, typer.Option("--verify")] = False,
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
        verify: State the error of every change, by a second solution with more nodes on every panel.
    """
    scene = case.scene(once=True)
    names = list(dict.fromkeys(quantity or default_quantities(scene)))
    with waiting():
        options = analysis.options(scene, excitation)
        sensitivities = jc.study.sensitivity(scene, names, options=options, verify=verify)
    if not sensitivities.ok:
        raise CommandError(
            f"{case.machine}: is not solved, so that it has no derivatives; `jaxcomp run` says why"
        )

    def pictures():
        from ..plot._designs import sensitivity_figures

        return sensitivity_figures(sensitivities, scene.name)

    output.emit(
        sensitivities,
        lambda _: sensitivity_tables(sensitivities, rows),
        pictures,
        scene,
        {"sensitivity": sensitivities.columns},
        metadata={"machine": scene.name},
    )


def sensitivity_tables(sensitivities: jc.study.Sensitivity, rows: int) -> Iterator[Any]:
    """For each quantity the numbers with the largest influence."""
    rows_of = zip(
        sensitivities.quantities, sensitivities.quantity_units, sensitivities.value, strict=True
    )
    headings = ("Number", "Value", "Change")
    if sensitivities.derivative_error is not None:
        headings = (*headings, "Error of it")
    for name, unit, value in rows_of:
        look = shown(name, unit, value)
        ranked = sensitivities.ranking(name)
        table_rows = []
        for relative in (True, False):
            entries = [entry for entry in ranked if entry.relative is relative]
            for entry in entries[:rows]:
                cells = (entry.part, entry.value, entry.change, f"{entry.error_share:.0e}")
                table_rows.append(cells[: len(headings)])
            if len(entries) > rows:
                blanks = ("",) * (len(headings) - 1)
                table_rows.append((f"and {len(entries) - rows} more with less", *blanks))
            table_rows.append(())
        title = f"{look.words} {look.text(float(value))}: its change with every number"
        table = row_table(title, headings, table_rows)
        idle = len(sensitivities.numbers) - len(ranked)
        if idle:
            table.caption = f"{idle} other numbers of the machine have no influence."
            if idle == 1:
                table.caption = "1 other number of the machine has no influence."
        yield table
