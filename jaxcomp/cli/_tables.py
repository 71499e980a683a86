"""Tables on the terminal."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from itertools import chain, starmap
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from .._core.display import SHOWN_FACTORS, Shown, behind, shown

if TYPE_CHECKING:
    from ..study import Comparison


class Markup(str):
    """A cell with markup of rich; other texts are shown as they are."""


def bold(text: str) -> Markup:
    """A cell in bold letters."""
    return Markup(f"[bold]{escape(text)}[/bold]")


def number_text(value: float | None, form: str) -> str:
    """A number in a format; "" where it is absent or not finite."""
    if value is None or not math.isfinite(value):
        return ""
    return f"{value:{form}}"


def quantity_text(look: Shown, value: float | None, digits: int = 5) -> str:
    """A value of a quantity with its unit; "" where it is absent."""
    if value is None:
        return ""
    return look.text(value, digits)


def percent_text(part: float, total: float, form: str = ".2f") -> str:
    """A share in per cent; "" of a total of zero."""
    if not total:
        return ""
    return f"{100 * part / total:{form}} %"


def as_note(text: str) -> str:
    """A remark of a line of its own."""
    return f"[yellow]Note:[/yellow] {text}"


def words(name: str) -> str:
    """A name of the code as words."""
    return name.replace("_", " ").capitalize()


def number_heads(form: str, *names: str) -> list[tuple[str, str]]:
    """Heads of columns of numbers in one format."""
    return [(name, form) for name in names]


def row_table(
    title: str | None,
    heads: Sequence[str | tuple[str, str]],
    rows: Iterable[Sequence[Any]],
    texts: int = 1,
    *,
    unbroken: Sequence[int] = (),
    caption: str | None = None,
) -> Table:
    """A table from its rows.

    Args:
        title: above it.
        heads: of the columns, with the format of the numbers beneath where they need one.
        rows: cells; `None` and `False` are empty ones. An empty row separates.
        texts: how many columns from the left hold texts; the others are set to the right.
        unbroken: columns that no narrow terminal breaks.
        caption: below it.
    """
    table = Table(
        title=title and escape(title),
        caption=caption,
        box=box.SIMPLE_HEAD,
    )
    forms = []
    for place, head in enumerate(heads):
        form = ""
        if not isinstance(head, str):
            head, form = head
        forms.append(form)
        justify = "left" if place < max(texts, 1) else "right"
        table.add_column(escape(head), justify=justify, no_wrap=place in unbroken)
    for row in rows:
        if row:
            table.add_row(*starmap(_cell, zip(row, forms, strict=True)))
        else:
            table.add_section()
    return table


def value_rows(
    result: Mapping[str, Any], rows: Iterable[Sequence[str]], digits: int = 5
) -> Iterator[Sequence[str]]:
    """Rows (words, value with its unit, note ...) of those (words, key, unit, note ...) that are known.

    Args:
        result: numbers in SI units by key.
        rows: with the unit in which a value is shown; empty ones separate.
        digits: of the values.
    """
    for row in rows:
        if not row:
            yield ()
            continue
        words, key, unit, *note = row
        value = result.get(key)
        if value is not None:
            text = f"{value * SHOWN_FACTORS.get(unit, 1.0):.{digits}g} {unit}".strip()
            yield words, text, *note


def _cell(value: Any, form: str) -> str:
    if value is None or value is False:
        return ""
    if isinstance(value, Markup):
        return value
    if isinstance(value, str):
        return escape(value)
    return f"{value:{form}}"


def column_table(
    title: str | None,
    columns: Mapping[str, Iterable[Any]],
    texts: int = 1,
    unbroken: Sequence[int] = (),
) -> Table:
    """A table from its columns, the cells by header; columns without any entry are left out.

    Args:
        title, texts, unbroken: as in `row_table`.
        columns: cells by header.
    """
    cells = {}
    for head, column in columns.items():
        entries = list(column)
        if any(entries):
            cells[head] = entries
    return row_table(
        title, tuple(cells), zip(*cells.values(), strict=True), texts, unbroken=unbroken
    )


def by_column(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The cells of each column, of rows that have them by header."""
    columns = {}
    for row in rows:
        for head, cell in row.items():
            columns.setdefault(head, []).append(cell)
    return columns


def comparison_table(comparison: "Comparison") -> Table:
    """Losses, forces and dimensions of designs, and the change of each against the first."""
    first, *variants = comparison.labels
    heads = ("Quantities, dimensions", first, *_alternating(variants, ["Change"] * len(variants)))
    cells = []
    for row in comparison.rows:
        values = row.values
        # a design without a quantity, as one without valves, has None there
        look = shown(row.name, row.unit, [value for value in values if value is not None])
        before, *after = (quantity_text(look, value) for value in values)
        changes = [_change(look, values[0], value) for value in values[1:]]
        cells.append((look.words, before, *_alternating(after, changes)))
    return row_table(None, heads, cells)


def _alternating(*lists: Sequence[Any]) -> Iterable[Any]:
    return chain.from_iterable(zip(*lists, strict=True))


def _change(look: Shown, before: float | None, after: float | None) -> str:
    if before is None or after is None:
        return ""
    if look.unit == "%":
        return f"{100 * (after - before):+.2f} points"
    if look.level:
        return f"{look.factor * (after - before):+.2f} {look.unit}"
    if not before:
        return ""
    return f"{100 * (after / before - 1):+.2f} %"


# A header that is repeated before every row, where rows become lines.
_SHORT = 12


def fitted(table: Table, width: int) -> Table | str:
    """A table that no terminal of this width cuts: columns wrap between words and never in a number.

    Points of numbers stand below each other. Where even that leaves no room, every row becomes lines
    of their own, one for each column.

    Args:
        table: made by `row_table`.
        width: of the terminal, in characters.
    """
    headers = [Text.from_markup(str(column.header)).plain for column in table.columns]
    cells = [_pointed(column) for column in table.columns]
    wide = []
    least = []
    for column, column_cells, header in zip(table.columns, cells, headers, strict=True):
        texts = [cell.plain for cell in column_cells]
        # a number is not broken, words are, and so is every header
        pieces = header.split()
        if column.justify == "right":
            pieces += texts
        else:
            pieces += " ".join(texts).split()
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
    resized = copy(table)
    resized.columns = [column.copy() for column in table.columns]
    resized.rows = []
    for column, column_cells, size in zip(resized.columns, cells, wide, strict=True):
        if narrow:
            column.min_width = column.max_width = size
            column.no_wrap = False
        if column.justify == "right":
            for cell in column_cells:
                # rich takes spaces off the end of what it sets to the right
                cell.pad_left(size - cell_len(cell.plain))
                cell.justify = "left"
    for row, column_cells in zip(table.rows, zip(*cells, strict=True), strict=True):
        resized.add_row(*column_cells, end_section=row.end_section)
    return resized


def _pointed(column: Column) -> list[Text]:
    """The cells of a column; numbers with spaces behind them that put their points in line."""
    cells = [Text.from_markup(str(cell)) for cell in column.cells]
    if column.justify == "right":
        for cell, lacking in zip(cells, behind([cell.plain for cell in cells]), strict=True):
            cell.pad_right(len(lacking))
    return cells


def _line_text(cell: Any) -> str:
    """A cell in a line, with its markup."""
    if isinstance(cell, Text):
        return escape(cell.plain)
    return str(cell)


def _stacked(table: Table, headers: list[str]) -> str:
    lines = []
    short = len(headers[0]) <= _SHORT
    if not short:
        lines.append(f"[bold]{escape(headers[0])}[/bold]")
    above = ""
    for row in zip(*(column.cells for column in table.columns), strict=True):
        if any(str(cell) for cell in row):
            first, *values = map(_line_text, row)
            first = above = first or above  # an empty cell stands for the one above
            if short and headers[0]:
                first = f"[bold]{headers[0]}[/bold] {first}".strip()
            lines.append(first)
            for header, cell in zip(headers[1:], values, strict=True):
                if cell:
                    lines.append(f"  {escape(header)} {cell.strip()}".rstrip())
    return "\n".join([*lines, ""])
