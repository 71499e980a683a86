"""Tables on the terminal."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from .._registry import Quantity
from .._shown import Shown, behind, shown, units_of

if TYPE_CHECKING:
    from ..scene import Bundled, Row, Scene

# Characters of a value as it was given; JSON has all of it.
_LONGEST = 120


def machine_table(machines: Iterable["Bundled"]) -> Table:
    """The bundled machines."""
    table = _table("Bundled machines", "Name", "Description")
    table.columns[0].no_wrap = True
    for machine in machines:
        table.add_row(f"[bold]{escape(machine.name)}[/bold]", escape(machine.description))
    return table


def fluid_table(fluids: Iterable[dict[str, Any]]) -> Table:
    """The real gases of the library with the publications of their equations of state."""
    table = _table("Fluids", "Name", "What it is", "Equation of state")
    table.columns[0].no_wrap = True
    for fluid in fluids:
        texts = (fluid["description"], fluid["source"])
        table.add_row(f"[bold]{fluid['name']}[/bold]", *map(escape, texts))
    return table


def quantity_table(quantities: Mapping[str, Quantity], title: str) -> Table:
    """Quantities with the units in which they are shown."""
    table = _table(escape(title), "Quantity", "Unit", "Better", "Needs", "Meaning")
    table.columns[0].no_wrap = True
    for name, one in quantities.items():
        texts = (units_of(one.unit, one.percent), one.better, ", ".join(one.sections), one.doc)
        table.add_row(f"[bold]{escape(name)}[/bold]", *map(escape, texts))
    return table


def variable_table(title: str, variables: Mapping[str, dict[str, Any]]) -> Table:
    """The numbers that studies can change."""
    table = _table(escape(title), "Variable", "Value", "Bound, SI", "Meaning")
    table.columns[0].no_wrap = True
    for name, one in variables.items():
        value = shown(name, one["unit"], one["value"]).text(one["value"])
        table.add_row(*(escape(s) for s in (name, value, one["bound"], one["doc"])))
    return table


def value_table(scene: "Scene", rows: Sequence["Row"]) -> Table:
    """Every value of a scene with its source."""
    title = escape(f"{scene.name}: {scene.description}")
    table = _table(title, "Value", "Given", "Source", "Meaning")
    table.columns[0].no_wrap = True
    for row in rows:
        given = row.given if row.given is not None else f"{row.value} {row.unit}".strip()
        given = str(given)
        if len(given) > _LONGEST:
            given = f"{given[: _LONGEST // 2]} ... {given[-_LONGEST // 2 :]}"
        table.add_row(*(escape(str(text)) for text in (row.path, given, row.source, row.doc)))
    return table


def _table(title: str | None, *columns: str, numbers: bool = False) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, title_style="bold", title_justify="left")
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if numbers and place else "left")
    return table


def row_table(
    title: str | None, heads: Sequence[str], rows: Iterable[Sequence[Any]], texts: int = 1
) -> Table:
    """A table from its rows.

    Args:
        title: plain text above it.
        heads: of the columns.
        rows: cells in the markup of rich; `None` and `False` are empty ones. An empty row separates.
        texts: how many columns from the left hold texts; the others are set to the right.
    """
    table = _table(title and escape(title), *heads, numbers=True)
    for column in table.columns[1:texts]:
        column.justify = "left"
    for row in rows:
        if row:
            table.add_row(*("" if cell is None or cell is False else str(cell) for cell in row))
        else:
            table.add_section()
    return table


def column_table(
    title: str | None, columns: Mapping[str, Iterable[Any]], texts: int = 1, keep: bool = False
) -> Table:
    """A table from its columns; columns without any entry are left out.

    Args:
        title, texts: as in `row_table`.
        columns: cells by header.
        keep: whether columns without any entry are kept.
    """
    cells = {head: list(column) for head, column in columns.items()}
    cells = {head: column for head, column in cells.items() if keep or any(column)}
    return row_table(title, tuple(cells), zip(*cells.values(), strict=True), texts)


def beside_table(
    rows: Sequence[Mapping[str, Any]], labels: Sequence[str], title: str | None = None
) -> Table:
    """Losses, forces and dimensions of designs, and the change of each against the first.

    Args:
        rows: with `name`, `unit` and the `values` of all designs, `None` where one has none.
        labels: of the designs.
        title: above the table.
    """
    first, *others = map(escape, labels)
    heads = [head for label in others for head in (label, "Change")]
    table = _table(title, "Losses, forces, dimensions", first, *heads, numbers=True)
    for one in rows:
        before, *after = one["values"]
        given = [value for value in one["values"] if value is not None]
        look = shown(one["name"], one["unit"], given)
        cells = [text for x in after for text in (_text(look, x), _change(look, before, x))]
        table.add_row(escape(look.words), _text(look, before), *cells)
    return table


def _text(look: Shown, value: float | None) -> str:
    return "" if value is None else look.text(value)


def _change(look: Shown, before: float | None, after: float | None) -> str:
    if before is None or after is None:
        return ""
    if look.unit == "%":
        return f"{100 * (after - before):+.2f} points"
    return f"{100 * (after / before - 1):+.2f} %" if before else ""


# A header that is repeated before every row, where rows become lines.
_SHORT = 12


def words(name: str) -> str:
    """A name of the code as words."""
    return name.replace("_", " ").capitalize()


def fitted(table: Table, width: int) -> Table | str:
    """A table that no terminal of this width cuts: columns wrap between words and never in a number.

    Points of numbers stand below each other. Where even that leaves no room, every row becomes lines
    of their own, one for each column.

    Args:
        table: made by `_table`.
        width: of the terminal, in characters.
    """
    headers = [Text.from_markup(str(column.header)).plain for column in table.columns]
    wide, least = [], []
    for column, header in zip(table.columns, headers, strict=True):
        texts = _pointed(column)
        whole = column.justify == "right"
        pieces = [w for t in texts for w in ([t] if whole else t.split())] + header.split()
        least.append(max(map(cell_len, pieces), default=1))
        wide.append(max(map(cell_len, [*texts, header]), default=1))
    room = width - 2 - 2 * len(wide) - (len(wide) - 1)
    if sum(least) > room:
        return _stacked(table, headers)
    over = sum(wide) - room
    narrow = over > 0
    while over > 0:  # the widest column that can give way does
        place = max((i for i in range(len(wide)) if wide[i] > least[i]), key=lambda i: wide[i])
        wide[place] -= 1
        over -= 1
    for column, size in zip(table.columns, wide, strict=True):
        if narrow:
            column.min_width = column.max_width = size
            column.no_wrap = False
        for cell in column._cells if column.justify == "right" else ():
            if isinstance(cell, Text):  # rich takes spaces off the end of what it sets to the right
                cell.pad_left(size - cell_len(cell.plain))
                cell.justify = "left"
    return table


def _pointed(column: Column) -> list[str]:
    """The texts of a column; numbers with spaces behind them that put their points in line."""

    plain = [Text.from_markup(str(cell)).plain for cell in column.cells]
    missing = behind(plain) if column.justify == "right" else [0]
    if any(missing):
        column._cells = [
            Text.from_markup(str(cell) + count * " ")
            for cell, count in zip(column.cells, missing, strict=True)
        ]
        return [Text.from_markup(str(cell)).plain for cell in column._cells]
    return plain


def _stacked(table: Table, headers: list[str]) -> str:
    lines = [f"[bold]{table.title}[/bold]"] if table.title else []
    short = len(headers[0]) <= _SHORT
    if not short:
        lines.append(f"[bold]{escape(headers[0])}[/bold]")
    above = ""
    for row in zip(*(column.cells for column in table.columns), strict=True):
        if any(str(cell) for cell in row):
            first, *others = (escape(c.plain) if isinstance(c, Text) else str(c) for c in row)
            first = above = first or above  # an empty cell stands for the one above
            lines.append(
                f"[bold]{headers[0]}[/bold] {first}".strip() if short and headers[0] else first
            )
            lines += [
                f"  {escape(header)} {cell.strip()}".rstrip()
                for header, cell in zip(headers[1:], others, strict=True)
                if cell
            ]
    return "\n".join([*lines, *([str(table.caption)] if table.caption else []), ""])
