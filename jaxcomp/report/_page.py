"""The page: what was asked, whether it can be trusted, what came out, and what it stands on."""

import base64
import datetime
import platform
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from importlib import resources
from importlib.metadata import version
from io import BytesIO
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from rich.table import Column, Table
from rich.text import Text

from .._core.display import behind
from .._core.evidence import Check
from ..scene import Scene, describe
from ..scene._describe import DescribedValue

_CLASSES = {"bold": "strong", "red": "bad", "green": "good", "yellow": "warning", "dim": "faint"}
# A drawing with more lines than this is smaller, and faster to show, as pixels.
_LARGEST_SVG = 400_000  # bytes
_DPI = 130


class Provenance(NamedTuple):
    """Origin of a report: command, time and libraries.

    Attributes:
        command: the command line.
        versions: version by name of the library.
        at: date and time.
    """

    command: str
    versions: Mapping[str, str]
    at: str

    @classmethod
    def of_this_process(cls, command: str) -> "Provenance":
        """Provenance with the libraries of this process, at this moment."""
        versions = {name: version(name) for name in ("jaxcomp", "jax", "jaxlib", "numpy")}
        versions["Python"] = platform.python_version()
        return cls(command, versions, datetime.datetime.now().strftime("%Y-%m-%d %H:%M"))


def report(
    result: Mapping[str, Any],
    tables: Iterable[Any],
    pictures: Mapping[str, Figure | bytes],
    scene: Scene | None,
    provenance: Provenance,
    evidence: Iterable[Check] = (),
) -> str:
    """A report as one HTML document that loads nothing else.

    Args:
        result: what the command found, as plain numbers.
        tables: tables and lines of `rich`; the single numbers of `result` if there are none.
        pictures: figures, or the bytes of a GIF, by name.
        scene: what was worked on; its values are listed with their sources.
        provenance: how this came about.
        evidence: checks of the result.
    """
    name = str(result.get("machine", "jaxcomp"))
    lead = ""
    sources = ""
    if scene is not None:
        name = scene.name
        lead = f'<p class="lead">{escape(scene.description)}</p>'
        sources = _section("The machine and its sources", sources_html(scene))
    shown = tables_html(tables) or numbers_html(result)
    versions = ", ".join(map(" ".join, provenance.versions.items()))
    origin = f'<pre class="command">{escape(provenance.command)}</pre>'
    origin += f'<p class="faint">{escape(provenance.at)}, {escape(versions)}</p>'
    parts = [
        f"<header><h1>{escape(name)}</h1>{lead}{origin}</header>",
        _section("Results", shown),
        _section("Pictures", "".join(map(picture_html, pictures, pictures.values()))),
        _checks(evidence),
        sources,
    ]
    titles = re.findall(r"<h2 id=\"([^\"]*)\">(.*?)</h2>", "".join(parts))
    links = ""
    for place, title in titles:
        links += f'<a href="#{place}">{title}</a>'
    parts.insert(1, f"<nav>{links}</nav>")
    style = (resources.files("jaxcomp.report") / "style.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(name)}: jaxcomp</title><style>{style}</style></head>\n"
        f"<body>{''.join(parts)}</body></html>\n"
    )


def _checks(evidence: Iterable[Check]) -> str:
    rows = "".join(map(_check_row, evidence))
    if not rows:
        return ""
    head = "<tr><th></th><th>Check</th><th>Found</th><th>Wanted</th></tr>"
    return _section("Checks", f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>")


def _check_row(check: Check) -> str:
    verdict = "good" if check.good else "bad"
    return (
        f'<tr><td class="{verdict}">{verdict}</td>'
        f"<td>{escape(check.name)}</td><td>{escape(check.answer)}</td>"
        f'<td class="faint">{escape(check.bound)}</td></tr>'
    )


def _section(title: str, inside: str) -> str:
    if not inside:
        return ""
    place = re.sub(r"\W+", "-", title.lower())
    inside = re.sub(r"(?s)<table\b.*?</table>", r'<div class="wide">\g<0></div>', inside)
    return f'<section><h2 id="{place}">{title}</h2>{inside}</section>\n'


# ---------------------------------------------------------------- tables of the terminal


def tables_html(tables: Iterable[Any]) -> str:
    """Tables and lines of text, as the terminal shows them."""
    pieces = []
    for entry in tables:
        if isinstance(entry, Table):
            pieces.append(_table(entry))
        else:
            pieces.append(f"<p>{rich_html(str(entry).strip())}</p>")
    return "\n".join(pieces)


def numbers_html(result: Mapping[str, Any]) -> str:
    """The single numbers and words of a result, where nobody made tables of it."""
    rows = ""
    for name, value in _flat(result):
        rows += f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>"
    head = "<tr><th>Result, in SI units</th><th></th></tr>"
    return f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>"


def rich_html(markup: Any) -> str:
    """A text with the markup of the terminal as HTML."""
    text = markup
    if not isinstance(markup, Text):
        text = Text.from_markup(str(markup))
    # spans may overlap: between two ends of any of them the look is one
    cuts = {0, len(text.plain)}
    for span in text.spans:
        cuts |= {span.start, span.end}
    out = []
    for begin, end in pairwise(sorted(cuts)):
        words: set[str] = set()
        for span in text.spans:
            if span.start <= begin and span.end >= end:
                words.update(str(span.style).split())
        classes = []
        for word in sorted(words):
            if word in _CLASSES:
                classes.append(_CLASSES[word])
        piece = escape(text.plain[begin:end])
        if classes:
            piece = f'<span class="{" ".join(classes)}">{piece}</span>'
        out.append(piece)
    return "".join(out)


def _table(table: Table) -> str:
    headers = [rich_html(column.header) for column in table.columns]
    title = rich_html(table.title or "")
    if not title and table.columns and _names_rows(table.columns[0]):
        # the head of a column of names says what the table is about
        title = headers[0]
        headers[0] = ""
    if title:
        title = f"<h3>{title}</h3>"
    heads = []
    columns = []
    for column, header in zip(table.columns, headers, strict=True):
        heads.append(f'<th class="{column.justify}">{header}</th>')
        columns.append(_cells(column))
    body = []
    for number, row in enumerate(table.rows):
        cells = "".join(column[number] for column in columns)
        cells = re.sub(r"(?<=\d) (?=[^\d\s<]\S{0,5}<)", "&nbsp;", cells)  # a number and its unit
        opening = "<tr>"
        if row.end_section:
            opening = '<tr class="last">'
        body.append(f"{opening}{cells}</tr>")
    head = ""
    if any(headers):
        head = f"<thead><tr>{''.join(heads)}</tr></thead>"
    caption = ""
    if table.caption:
        caption = f'<p class="faint">{rich_html(table.caption)}</p>'
    return f"{title}<table>{head}<tbody>{''.join(body)}</tbody></table>{caption}"


def _cells(column: Column) -> list[str]:
    """Cells of a column, with room behind numbers that stand to the right."""
    texts = list(column.cells)
    rooms = [""] * len(texts)
    if column.justify == "right":
        rooms = _rooms(texts)
    side = f' class="{column.justify}"'
    cells = []
    for text, room in zip(texts, rooms, strict=True):
        cells.append(f"<td{side}>{rich_html(text)}{room}</td>")
    return cells


def _names_rows(column: Column) -> bool:
    """Whether the cells of a column are names of the rows, and no numbers."""
    filled = [*filter(None, _plain_texts(column.cells))]
    return bool(filled) and not all(re.match(r"[+-]?\d", text) for text in filled)


def _rooms(cells: Iterable[Any]) -> list[str]:
    """Room behind the numbers of a column, so that their points stand below each other in any font.

    It is set in the same letters, which are neither shown nor copied with the number.
    """
    rooms = []
    for room in behind(_plain_texts(cells)):
        if room:
            room = f'<i class="room" data-room="{escape(room)}"></i>'
        rooms.append(room)
    return rooms


def _plain_texts(cells: Iterable[Any]) -> list[str]:
    """Texts of cells without the markup of the terminal."""
    return [Text.from_markup(str(cell)).plain for cell in cells]


def _flat(result: Mapping[str, Any], above: str = ""):
    """Names and texts of single numbers and words, those of parts behind the name of the whole."""
    for key, value in result.items():
        name = f"{above}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}, ")
        elif isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif isinstance(value, float):
            yield name, f"{value:.6g}"
        elif isinstance(value, str | int) and value != "":
            yield name, str(value)


# ---------------------------------------------------------------- pictures


def picture_html(name: str, picture: Figure | bytes) -> str:
    """A figure, which carries its title, or a moving picture (GIF) with its name below."""
    caption = ""
    if isinstance(picture, bytes):
        kind = "gif"
        data = picture
        title = name.replace("_", " ").capitalize()
        caption = f"<figcaption>{escape(title)}</figcaption>"
    else:
        kind = "svg+xml"
        data = _saved(picture, "svg")
        if len(data) > _LARGEST_SVG:
            kind = "png"
            data = _saved(picture, "png")
        title = picture.get_suptitle() or name
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
    image = f'<img src="{source}" alt="{escape(title, quote=True)}">'
    return f"<figure>{image}{caption}</figure>"


def _saved(figure: Figure, kind: str) -> bytes:
    out = BytesIO()
    # letters as outlines: the reader's machine may not have the font
    options = {"svg.fonttype": "path", "svg.hashsalt": "jaxcomp"}
    metadata = None
    if kind == "svg":
        metadata = {"Date": None}
    with matplotlib.rc_context(options):
        figure.savefig(out, format=kind, dpi=_DPI, metadata=metadata)
    return out.getvalue()


# ---------------------------------------------------------------- values with their sources


def sources_html(scene: Scene) -> str:
    """All values of a scene by section: as given, in SI units, where they come from."""
    rows = describe(scene)
    heads = "<th>Value</th><th>Given</th><th>SI</th><th>Source</th><th>Meaning</th>"
    bodies = []
    for section, group in groupby(rows, lambda row: row.path.partition(".")[0]):
        title = f'<tr class="section"><th colspan="5">{escape(section)}</th></tr>'
        bodies.append(f"<tbody>{title}{''.join(map(_row, group))}</tbody>")
    table = f'<table class="sources"><thead><tr>{heads}</tr></thead>{"".join(bodies)}</table>'
    return f"<p>{escape(_tally(rows))}</p>{table}"


def _tally(rows: tuple[DescribedValue, ...]) -> str:
    """Numbers of values by where they come from, by the first word of the source."""
    words = Counter()
    for row in rows:
        if not row.path.endswith(".type"):
            words[row.source.partition(",")[0].strip() or "without a source"] += 1
    parts = ", ".join(f"{count} {word}" for word, count in words.most_common())
    return f"{words.total()} values: {parts}."


def _row(row: DescribedValue) -> str:
    opening = "<tr>"
    written = str(row.given)
    if row.given is None:
        opening = '<tr class="faint">'
        written = ""
    # a long path breaks between its words
    path = re.sub(r"([._])", r"\1<wbr>", f"<td>{escape(row.path)}</td>")
    cells = map(escape, (written, _si(row), row.source, row.doc))
    return f"{opening}{path}<td>{'</td><td>'.join(cells)}</td></tr>"


def _si(row: DescribedValue) -> str:
    if not isinstance(row.value, np.ndarray):
        word = str(row.value)
        if row.given is not None:
            return ""
        return {"True": "true", "False": "false"}.get(word, word)
    if row.value.ndim == 1 and row.value.size > 1 and np.all(row.value == row.value[0]):
        return f"{row.value.size} × {row.value[0]:.6g} {row.unit}".strip()
    if row.value.ndim == 0:
        return f"{row.value.item():.6g} {row.unit}".strip()
    text = np.array2string(row.value, precision=6, separator=", ", threshold=60)
    return f"{text} {row.unit}".strip()
