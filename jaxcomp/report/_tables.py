"""The tables of the terminal as HTML."""

from collections.abc import Iterable, Mapping
from html import escape
from itertools import pairwise
from typing import Any

from rich.table import Table
from rich.text import Text

from .._shown import behind

_CLASSES = {"bold": "strong", "red": "bad", "green": "good", "yellow": "doubt", "dim": "faint"}


def tables_html(tables: Iterable[Any]) -> str:
    """Tables and lines of text, as the terminal shows them."""
    return "\n".join(_table(one) if isinstance(one, Table) else _line(one) for one in tables)


def numbers_html(result: Mapping[str, Any]) -> str:
    """The single numbers and words of a result, where nobody made tables of it."""
    rows = [
        f"<tr><td>{escape(name)}</td><td>{escape(_shown(value))}</td></tr>"
        for name, value in _flat(result)
    ]
    head = "<tr><th>Result, in SI units</th><th></th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def rich_html(markup: Any) -> str:
    """A text with the markup of the terminal as HTML."""
    text = markup if isinstance(markup, Text) else Text.from_markup(str(markup))
    cuts = sorted({0, len(text.plain), *(n for s in text.spans for n in (s.start, s.end))})
    out = []
    for begin, end in pairwise(cuts):
        words = {
            word
            for span in text.spans
            if span.start <= begin and span.end >= end
            for word in str(span.style).split()
        }
        classes = " ".join(_CLASSES[word] for word in sorted(words) if word in _CLASSES)
        piece = escape(text.plain[begin:end])
        out.append(f'<span class="{classes}">{piece}</span>' if classes else piece)
    return "".join(out)


def _table(table: Table) -> str:
    title = f"<h3>{rich_html(table.title)}</h3>" if table.title else ""
    aligned = [f' class="{column.justify}"' for column in table.columns]
    heads = [
        f"<th{side}>{rich_html(column.header)}</th>"
        for side, column in zip(aligned, table.columns, strict=True)
    ]
    columns = [list(column.cells) for column in table.columns]
    ends = [
        behind([Text.from_markup(str(c)).plain for c in cells]) if column.justify == "right" else []
        for column, cells in zip(table.columns, columns, strict=True)
    ]
    body = []
    for number, row in enumerate(table.rows):
        cells = "".join(
            f"<td{side}>{rich_html(cells[number])}{_blank(end[number] if end else 0)}</td>"
            for side, cells, end in zip(aligned, columns, ends, strict=True)
        )
        last = ' class="last"' if row.end_section else ""
        body.append(f"<tr{last}>{cells}</tr>")
    head = (
        f"<thead><tr>{''.join(heads)}</tr></thead>" if any(c.header for c in table.columns) else ""
    )
    return f"{title}<table>{head}<tbody>{''.join(body)}</tbody></table>"


def _blank(count: int) -> str:
    """Room of so many characters behind a number, as wide as digits."""
    return count * "\u2007"


def _line(text: Any) -> str:
    return f"<p>{rich_html(str(text).strip())}</p>"


def _flat(result: Mapping[str, Any], above: str = ""):
    for key, value in result.items():
        name = f"{above}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}, ")
        elif isinstance(value, str | int | float | bool) and value != "":
            yield name, value


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)
