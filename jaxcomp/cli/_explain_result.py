"""Results of `jaxcomp explain`: a table of entries, and a section as it is typed."""

from typing import Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ..scene import Explained, part_places
from ..scene._annotate import summary
from ._tables import _table


def parts_table() -> tuple[Table, list[dict[str, Any]]]:
    """Every kind of part: a table, and the same for JSON."""
    table, rows = _table("Parts of a machine file", "Type", "Sections", "What it is"), []
    table.columns[0].no_wrap = True
    for part, where in part_places().items():
        row = {"kind": where.kind, "places": where.titles, "summary": summary(part)}
        rows.append(row)
        table.add_row(where.kind, *(escape(t) for t in (", ".join(where.titles), row["summary"])))
    return table, rows


def explained_lines(one: Explained) -> list[Table | Text]:
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
