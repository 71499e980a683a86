"""The values of a scene with their sources, as HTML."""

import re
from collections import Counter
from html import escape
from itertools import groupby

import numpy as np

from ..scene import Row, Scene, describe


def sources_html(scene: Scene) -> str:
    """All values of a scene by section: as given, in SI units, where they come from."""
    rows = describe(scene)
    heads = "".join(f"<th>{word}</th>" for word in ("Value", "Given", "SI", "Source", "Meaning"))
    bodies = []
    for section, group in groupby(rows, lambda row: row.path.partition(".")[0]):
        title = f'<tr class="section"><th colspan="5">{escape(section)}</th></tr>'
        bodies.append(f"<tbody>{title}{''.join(map(_row, group))}</tbody>")
    table = f'<table class="sources"><thead><tr>{heads}</tr></thead>{"".join(bodies)}</table>'
    return f"<p>{escape(tally(rows))}</p>{table}"


def tally(rows: tuple[Row, ...]) -> str:
    """How many values come from where, by the first word of the source."""
    words = Counter(
        row.source.partition(",")[0].strip() or "without a source"
        for row in rows
        if not row.path.endswith(".type")
    )
    parts = ", ".join(f"{count} {word}" for word, count in words.most_common())
    return f"{words.total()} values: {parts}."


def _row(row: Row) -> str:
    given = "" if row.given is None else str(row.given)
    cells = (row.path, given, _si(row), row.source, row.doc)
    faint = ' class="faint"' if row.given is None else ""
    path, *others = (f"<td>{escape(cell)}</td>" for cell in cells)
    path = re.sub(r"([._])", r"\1<wbr>", path)  # a long path breaks between its words
    return f"<tr{faint}>{path}{''.join(others)}</tr>"


def _si(row: Row) -> str:
    if not isinstance(row.value, np.ndarray):
        word = str(row.value)
        return "" if row.given is not None else word.lower() if word in ("True", "False") else word
    if row.value.ndim == 1 and row.value.size > 1 and np.all(row.value == row.value[0]):
        return f"{row.value.size} × {row.value[0]:.6g} {row.unit}".strip()
    text = np.array2string(row.value, precision=6, separator=", ", threshold=60)
    return f"{text if row.value.ndim else format(row.value.item(), '.6g')} {row.unit}".strip()
