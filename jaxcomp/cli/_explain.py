"""`jaxcomp explain`: one part of a machine file, with all that its section may hold."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

import jaxcomp as jc

from ._errors import reports_errors
from ._options import AsJson
from ._output import show_results
from ._tables import _table


@reports_errors
def explain(
    part: Annotated[
        str | None,
        typer.Argument(help="Type of a part, or name of a section; all types if left out."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Explain a part of a machine file: its entries, units, bounds, defaults, and where it may stand.

    Example: [bold]jaxcomp explain slider-crank[/bold], [bold]jaxcomp explain film[/bold]
    """
    from ..scene import explained

    if part is None:
        table, rows = parts_table()
        show_results({"parts": rows}, [table], as_json, None)
        return
    found = explained(part)
    shown = [one._asdict() | {"entries": [e._asdict() for e in one.entries]} for one in found]
    lines = [] if as_json else [line for one in found for line in explained_lines(one)]
    show_results({"word": part, "parts": shown}, lines, as_json, None)


def parts_table() -> tuple[Table, list[dict[str, Any]]]:
    """Every kind of part: a table, and the same for JSON."""
    from ..scene._explain import summary

    table, rows = _table("Parts of a machine file", "Type", "Sections", "What it is"), []
    table.columns[0].no_wrap = True
    for part, where in jc.scene.part_places().items():
        row = {"kind": where.kind, "places": where.titles, "summary": summary(part)}
        rows.append(row)
        table.add_row(where.kind, *(escape(t) for t in (", ".join(where.titles), row["summary"])))
    return table, rows


def explained_lines(one: jc.scene.Explained) -> list[Table | Text]:
    """What it is, where it may stand, its entries, and how it is typed."""
    where = Text("May stand as ").append(", ".join(one.places))
    title = escape(f"{one.kind}: {one.summary}")
    table = _table(title, "Entry", "Unit", "Must be", "Default", "Meaning")
    table.columns[0].no_wrap = True
    for entry in one.entries:
        default = "required" if entry.required else entry.default or "none"
        cells = (entry.name, entry.unit, entry.bound, default, entry.doc)
        table.add_row(*map(escape, cells))
    example = Text(one.example + "\n", no_wrap=True, overflow="ignore")
    return [table, where, Text("As typed in a file, with optional lines behind #:\n"), example]
