"""`jaxcomp new`, `list` and `explain`: a machine file to start from, what there is, and what it means."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.table import Table
from rich.text import Text

import jaxcomp as jc

from .._core.display import shown, units_of
from .._core.files import write_whole
from .._core.registry import Quantity, registered
from .._core.words import did_you_mean
from . import _options as opt
from ._fluids import list_fluid, list_fluids
from ._listed import ListedValue, ListedValues, StoredPrograms
from ._output import show_results
from ._start import CommandError, refuse, start_jax
from ._tables import bold, row_table

if TYPE_CHECKING:
    from ..scene._explain import Explained
    from ..scene.contents import ListedVariables

# Titles of the schemas that `schema` writes.
_SCHEMAS = ("A machine for jaxcomp", "Results of jaxcomp")
# Characters of a value as it was given; JSON has all of it.
_LONGEST = 120
# What a new machine is; each has a file in `jaxcomp/scene/starts`.
Kind = Literal[
    "slider-crank", "v-twin", "slider-link", "refrigeration", "blend", "semi-hermetic", "pipes",
    "muffler", "rotor",
]  # fmt: skip


def new(
    file: Annotated[Path, typer.Argument()] = Path("my-machine.toml"),
    kind: Kind = "slider-crank",
    machine: Annotated[
        str | None, typer.Option("--from", autocompletion=opt.complete_machine)
    ] = None,
    force: bool = False,
) -> None:
    """Write a machine file to start from, with a comment on every entry.

    Example: [bold]jaxcomp new my-machine.toml --kind refrigeration[/bold], [bold]jaxcomp new
    my-machine.toml --from r290-6cc[/bold]

    Args:
        file: File to write; - prints it.
        kind: What to start from.
        machine (MACHINE): Bundled machine or machine file to start from, with its numbers.
        force: Write over a file.
    """
    to_screen = str(file) == "-"
    refuse(not to_screen and file.suffix != ".toml", f"{file}: must end in .toml")
    would_overwrite = not to_screen and file.exists() and not force
    refuse(would_overwrite, f"{file}: is there already; --force writes over it")
    name = file.stem
    if to_screen:
        name = "my-machine"
    if machine is None:
        text = jc.scene.start(kind, name)
        has_crank = kind != "rotor"
    else:
        from ..scene._annotated import start_from

        scene = jc.scene.load(machine)
        text = start_from(scene, name)
        has_crank = scene.compressor is not None
    if to_screen:
        typer.echo(text, nl=False)
        return
    write_whole(file, text.encode())
    verb = "run" if has_crank else "respond"
    typer.echo(f"{file} is written. Change it, then: jaxcomp check {file}; jaxcomp {verb} {file}")


# ------------------------------------------------------------------ cache
def cache(empty: bool = False, as_json: opt.AsJson = False) -> None:
    """Show where compiled programs are kept for the next start, and how large they are.

    Kept are programs of jaxcomp, of the command line, scripts and notebooks. The environment variable
    [bold]JAXCOMP_CACHE[/bold] names another folder; [bold]JAXCOMP_CACHE=off[/bold] keeps none.

    Example: [bold]jaxcomp cache[/bold], [bold]jaxcomp cache --empty[/bold]

    Args:
        empty: Remove them; they are compiled again when they are needed.
    """
    from .._core.programs import cache_status, empty_cache

    if empty:
        empty_cache()
    stored = cache_status()
    folder = str(stored.folder)
    if not stored.folder:
        folder = f"none: {stored.why}"
    rows = (
        ("folder", folder),
        ("programs", f"{stored.programs}"),
        ("size", f"{stored.size / 2**20:.1f} MiB"),
        ("emptied by", "jaxcomp cache --empty"),
    )
    table = _word_table("Compiled programs", ("", ""), rows)
    content = StoredPrograms(
        folder=stored.folder and folder,
        why=stored.why,
        programs=stored.programs,
        size=stored.size,
    )
    show_results(content, [table], as_json)


# ------------------------------------------------------------------- list
def list_machines(
    machine: Annotated[str | None, typer.Argument(autocompletion=opt.complete_machine)] = None,
    fluid: Annotated[str | None, typer.Argument()] = None,
    quantities: bool = False,
    variables: bool = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """List the bundled machines, the fluids, the quantities, or what one machine has.

    Example: [bold]jaxcomp list mayekawa-wbhe[/bold], [bold]jaxcomp list fluids[/bold], [bold]jaxcomp
    list --quantities[/bold], [bold]jaxcomp list --variables mayekawa-wbhe[/bold], [bold]jaxcomp list
    fluids R455A[/bold]

    Args:
        machine: Bundled machine or machine file whose values and sources to show, or `fluids`.
        fluid: Behind `fluids`: the one whose composition, pairs and sources to show.
        quantities: Quantities that studies know, with unit and meaning; of a machine joint by joint.
        variables: Numbers of a machine that studies can change, and design rules.
        as_json: Print one JSON object instead of a table.
    """
    if variables and (machine is None or quantities):
        raise CommandError("--variables: needs a machine, and goes without --quantities")
    if fluid is not None and (machine != "fluids" or quantities):
        raise CommandError(f"list {machine} {fluid}: a second name stands behind `fluids` alone")
    if machine == "fluids" and not quantities:
        if fluid is None:
            content, tables = list_fluids()
        else:
            content, tables = list_fluid(fluid)
        show_results(content, tables, as_json)
        return
    if machine is None and quantities:
        content, table = _quantities()
    elif machine is None:
        content, table = _machines()
    else:
        scene = _known_scene(machine)
        listing = _values
        if quantities:
            listing = _quantities
        elif variables:
            listing = _variables
        content, table = listing(scene)
    show_results(content, [table], as_json)


def _machines() -> tuple[dict[str, Any], Table]:
    machines = jc.scene.machines()
    rows = ((bold(machine.name), machine.description) for machine in machines)
    table = _word_table("Bundled machines", ("Name", "Description"), rows)
    return {"machines": machines}, table


def _known_scene(machine: str) -> jc.scene.Scene:
    names = [bundled.name for bundled in jc.scene.machines()]
    if machine not in names and not Path(machine).exists() and not machine.endswith(".toml"):
        near = did_you_mean(machine, [*names, "fluids"])
        raise CommandError(f"list {machine}: is no machine, no file and not `fluids`{near}")
    start_jax()
    return jc.scene.load(machine)


def _quantities(scene: jc.scene.Scene | None = None) -> tuple[dict[str, Any], Table]:
    """All quantities, or those of a machine joint by joint."""
    quantities: Mapping[str, Quantity]
    if scene is None:
        title = "Quantities"
        quantities = {quantity.name: quantity for quantity in registered()}
    else:
        title = scene.name
        quantities = jc.study.available_quantities(scene.machine, members=True)
    entries = {}
    rows = []
    for name, quantity in quantities.items():
        unit = units_of(quantity.unit, quantity.percent)
        needs = ", ".join(quantity.sections)
        rows.append((bold(name), unit, quantity.better, needs, quantity.doc))
        entries[name] = {
            "unit": quantity.unit,
            "shown": unit,
            "better": quantity.better,
            "needs": list(quantity.sections),
            "doc": quantity.doc,
        }
    heads = ("Quantity", "Unit", "Better", "Needs", "Meaning")
    return {"quantities": entries}, _word_table(title, heads, rows)


def _variables(scene: jc.scene.Scene) -> tuple[ListedVariables, Table]:
    """The numbers that studies can change."""
    from ..scene.contents import ListedVariables, describe_variables

    variables = describe_variables(scene)
    rows = []
    for name, variable in variables.items():
        text = shown(name, variable.unit, variable.value).text(variable.value)
        rows.append((name, text, variable.bound, variable.doc))
    heads = ("Variable", "Value", "Bound, SI", "Meaning")
    return ListedVariables(variables), _word_table(scene.name, heads, rows)


def _values(scene: jc.scene.Scene) -> tuple[ListedValues, Table]:
    """Every value of a scene with its source."""
    entries = {}
    rows = []
    for row in jc.scene.describe(scene):
        _, *columns = row
        entries[row.path] = ListedValue(*columns)
        value_text = str(row.given)
        if row.given is None:
            value_text = f"{row.value} {row.unit}".strip()
        if len(value_text) > _LONGEST:
            value_text = f"{value_text[: _LONGEST // 2]} ... {value_text[-_LONGEST // 2 :]}"
        rows.append((row.path, value_text, str(row.source), str(row.doc)))
    title = f"{scene.name}: {scene.description}"
    table = _word_table(title, ("Value", "Given", "Source", "Meaning"), rows)
    return ListedValues(scene.name, scene.description, entries), table


# ------------------------------------------------------------------- explain
def explain(
    part: Annotated[str | None, typer.Argument()] = None,
    as_json: opt.AsJson = False,
) -> None:
    """Explain a part of a machine file: its entries, units, bounds, defaults, and where it may stand.

    Example: [bold]jaxcomp explain slider-crank[/bold], [bold]jaxcomp explain film[/bold]

    Args:
        part: Type of a part, or name of a section; all types if left out.
    """
    from ..scene._explain import explained

    if part is None:
        rows, table = _parts()
        show_results({"parts": rows}, [table], as_json)
        return
    explanations = explained(part)
    lines = chain.from_iterable(map(_explained_lines, explanations))
    show_results({"word": part, "parts": explanations}, lines, as_json)


def schema(
    file: Annotated[Path | None, typer.Argument()] = None,
    results: bool = False,
    force: bool = False,
) -> None:
    """Print or write the JSON schema of machine files, with which editors complete and check them.

    An editor that knows TOML, such as Visual Studio Code with "Even Better TOML", takes it where the
    first line of a machine file is `#:schema ./jaxcomp.schema.json`. It has laws of other packages too.

    Example: [bold]jaxcomp schema jaxcomp.schema.json[/bold], [bold]jaxcomp schema --results[/bold]

    Args:
        file: File to write; printed if left out.
        results: Schema of what commands print with --json and write to result.json, each under its name.
        force: Write over a file that is no schema of this program.
    """
    if results:
        from ._answers import results_schema

        content = results_schema()
    else:
        content = jc.scene.json_schema()
    text = json.dumps(content, indent=1, ensure_ascii=False)
    if file is None:
        typer.echo(text)
        return
    refuse(
        file.exists() and not force and _schema_title(file) not in _SCHEMAS,
        f"{file}: is there already, and is no schema of this program; --force writes over it",
    )
    write_whole(file, f"{text}\n".encode())


def _schema_title(file: Path) -> str:
    """Title of a JSON schema, "" of any other file."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return ""
    if not isinstance(content, dict):
        return ""
    return str(content.get("title", ""))


def _parts() -> tuple[list[dict[str, Any]], Table]:
    """Every kind of part."""
    from ..scene._annotated import summary
    from ..scene._explain import part_places

    parts = []
    rows = []
    for kind, where in part_places().items():
        meaning = summary(kind)
        parts.append({"kind": where.kind, "places": where.titles, "summary": meaning})
        rows.append((where.kind, ", ".join(where.titles), meaning))
    heads = ("Type", "Sections", "What it is")
    return parts, _word_table("Parts of a machine file", heads, rows)


def _explained_lines(explanation: Explained) -> list[Table | Text]:
    """Lines on a part: its meaning, where it may stand, its entries, and how it is typed."""
    rows = []
    for entry in explanation.entries:
        default = entry.default or "none"
        if entry.required:
            default = "required"
        rows.append((entry.name, entry.unit, entry.bound, default, entry.doc))
    heads = ("Entry", "Unit", "Must be", "Default", "Meaning")
    where = Text("May stand as ").append(", ".join(explanation.places))
    example = Text(explanation.example + "\n", no_wrap=True, overflow="ignore")
    return [
        _word_table(f"{explanation.kind}: {explanation.summary}", heads, rows),
        where,
        Text("As typed in a file, with optional lines behind #:\n"),
        example,
    ]


def _word_table(title: str, heads: Sequence[str], rows) -> Table:
    """A table of words, of which the first column is not broken."""
    return row_table(title, heads, rows, texts=len(heads), unbroken=(0,))
