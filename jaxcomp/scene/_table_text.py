"""Text of tables of every kind in CSV and workbooks: settings, heads with units, and lines of cells.

Lines that begin with `#` stand beside the table: `# speed = 900 rpm` is a setting, any other a remark.
Cells are parted by commas, semicolons or tabs, of which the line of heads decides; beside semicolons and
tabs decimals may have commas, in the whole file or nowhere. Units stand in brackets behind their names,
or in a line of their own below.
"""

import codecs
import csv
import math
import os
import re
from collections.abc import Sequence
from typing import NamedTuple

from .._core.files import regular
from ._text import LARGEST, SceneError, reading
from ._workbook import SUFFIXES, sheet_text

_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_LONGEST_HEAD = 200  # characters
_SAVE = "save the table as CSV in UTF-8"
_SEPARATORS = ";\t"  # of cells, where a line of heads has them; commas otherwise
# Spreadsheets write it in front of a table whose cells are not parted by commas.
_SEPARATOR_LINE = re.compile(r"\s*sep=(.)\s*", re.IGNORECASE)
# What spreadsheets write for a formula that fails stands in a cell and begins no remark.
_FAILED_FORMULA = re.compile(r'#(?:N/A|NV|N/D|[^\s,;"=]*[!?])(?=[\s,;"]|$)', re.IGNORECASE)
# A line of separators alone is empty.
_CONTENT = re.compile(r'[^\s,;"]')
_HEAD = re.compile(r"\s*(sd\s*\(.*?\)|[^\[\](){}]*?)\s*(?:\[(.*)\]|\((.*)\)|\{(.*)\})?\s*")
_BRACKETS = re.compile(r"[\[({](.*)[\])}]")
_EXPONENT = r"(?:[eE][-+]?\d+)?"
_DECIMAL_COMMA = re.compile(rf"\s*([-+]?\d*),(\d+{_EXPONENT})\s*")
_DECIMAL_POINT = re.compile(rf"\s*[-+]?\d*\.\d+{_EXPONENT}\s*")
_THOUSANDS = re.compile(r"\s*[-+]?\d+(?:,\d+)+(?:\.\d*)?\s*")


class SettingLine(NamedTuple):
    """A line that begins with `#`.

    Attributes:
        number: of the line in the file.
        key: in front of the sign.
        sign: "=" or ":" between key and value; "" in a remark without either.
        value: behind the sign.
    """

    number: int
    key: str
    sign: str
    value: str


class Head(NamedTuple):
    """Name and unit of a column, the unit empty where it has none."""

    name: str
    unit: str


class Row(NamedTuple):
    """Cells of a line below the heads, and its number in the file."""

    number: int
    cells: list[str]


class TableText(NamedTuple):
    """Content of a file; without heads it is empty."""

    settings: tuple[SettingLine, ...] = ()
    heads: tuple[Head, ...] = ()
    rows: tuple[Row, ...] = ()


def read_table_text(path: str | os.PathLike) -> TableText:
    """Content of a CSV file, or of a sheet of a workbook: `readings.xlsx`, or `readings.xlsx#sheet`.

    Raises:
        SceneError: a file that cannot be read, is too large or no text, a line with more or fewer cells
            than heads, or numbers with decimal commas and decimal points in one file; of a workbook as
            `sheet_text`. It names the file.
    """
    with reading(os.fspath(path)):
        name, _, sheet = os.fspath(path).partition("#")
        is_workbook = name.lower().endswith(SUFFIXES)
        file_path = name if is_workbook else path
        with open(regular(file_path), "rb") as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise SceneError("", f"is larger than {LARGEST / 1e6:.0f} MB")
        if is_workbook:
            return table_text(sheet_text(content, sheet))
        return table_text(decoded(content))


def decoded(content: bytes) -> str:
    """The text of a file in UTF-8, or in UTF-16 with its mark in front; line ends are those of Python.

    Raises:
        SceneError: neither.
    """
    encoding = "utf-8"
    for mark, of_mark in _MARKS.items():
        if content.startswith(mark):
            content = content.removeprefix(mark)
            encoding = of_mark
            break
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        raise SceneError("", f"is no text in {encoding.upper()}; {_SAVE}") from None
    if "\0" in text:
        raise SceneError("", f"is no table: it holds zero bytes; {_SAVE}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def table_text(text: str) -> TableText:
    """Settings, heads and rows of a text; see `read_table_text`."""
    lines = []
    settings = []
    separator = None
    for number, line in enumerate(text.split("\n"), 1):
        hash_line = _line_beside_table(line)
        if hash_line is not None:
            settings.append(_setting_line(number, hash_line))
        elif not lines and (match := _SEPARATOR_LINE.fullmatch(line)):
            separator = match[1]
        elif _CONTENT.search(line):
            lines.append((number, line))
    if not lines:
        return TableText(tuple(settings))
    if separator is None:
        separator = _separator_in(lines[0][1])
    head, *rows = _rows(lines, separator)
    heads = [head_of(cell) or Head(cell.strip(), "") for cell in head.cells]
    rows = _fitted(heads, rows)
    if separator != ",":
        rows = _with_decimal_points(rows)
    heads, rows = _with_line_of_units(heads, rows)
    return TableText(tuple(settings), tuple(heads), tuple(rows))


def _separator_in(line: str) -> str:
    """The sign between the cells of a line of heads."""
    for sign in _SEPARATORS:
        if sign in line:
            return sign
    return ","


def head_of(text: str) -> Head | None:
    """Name and unit of a column, as of `power [kW]`; `None` for anything else."""
    if len(text) > _LONGEST_HEAD:
        return None
    match = _HEAD.fullmatch(text)
    if match is None:
        return None
    unit = match[2] or match[3] or match[4] or ""
    return Head(match[1].strip(), unit.strip())


def cell_number(text: str, key: str, empty: float | None = None) -> float:
    """The finite number in a cell.

    Args:
        text: of the cell.
        key: its place, for the message.
        empty: what an empty cell stands for; absent: it must not be empty.

    Raises:
        SceneError: no number, or one that is not finite.
    """
    if empty is not None and not text.strip():
        return empty
    try:
        value = float(text)
    except ValueError:
        problem = "must be a number" if empty is None else "must be a number, or empty"
        if _THOUSANDS.fullmatch(text):
            problem += "; a comma may part thousands or decimals here: write it without"
        raise SceneError(key, problem, text) from None
    if not math.isfinite(value):
        raise SceneError(key, "must be finite", value)
    return value


def _line_beside_table(line: str) -> str | None:
    """A line that begins with `#`, without what a spreadsheet adds to it; `None` for one of the table."""
    text = line.strip()
    if text.startswith('"#'):
        text = text.rstrip(",;\t ").strip('"').replace('""', '"')
    if not text.startswith("#") or _FAILED_FORMULA.match(text):
        return None
    return text.rstrip(",;\t ")


def _setting_line(number: int, text: str) -> SettingLine:
    text = text.lstrip("# \t")
    for sign in ("=", ":"):
        if sign in text:
            key, _, value = text.partition(sign)
            return SettingLine(number, key.strip(), sign, value.strip())
    return SettingLine(number, text.strip(), "", "")


def _rows(lines: Sequence[tuple[int, str]], separator: str) -> list[Row]:
    rows = []
    reader = csv.reader((f"{line}\n" for _, line in lines), delimiter=separator)
    try:
        while True:
            # a cell in quotes may go over several lines; the first of them is named
            number = lines[min(reader.line_num, len(lines) - 1)][0]
            cells = next(reader)
            if any(cell.strip() for cell in cells):
                rows.append(Row(number, cells))
    except StopIteration:
        return rows
    except csv.Error as error:
        raise SceneError("", f"is no table: {error}") from None


def _fitted(heads: list[Head], rows: list[Row]) -> list[Row]:
    """Rows with as many cells as heads; empty columns at the end, which spreadsheets add, are dropped."""
    while len(heads) > 1 and not heads[-1].name:
        heads.pop()
    count = len(heads)
    fitted = []
    for row in rows:
        cells = list(row.cells)
        while len(cells) > count and not cells[-1].strip():
            cells.pop()
        if len(cells) != count:
            raise SceneError(f"line {row.number}", f"must have {count} cells", len(cells))
        fitted.append(Row(row.number, cells))
    return fitted


def _with_decimal_points(rows: list[Row]) -> list[Row]:
    """Rows whose numbers have decimal points, if all of them had commas.

    Raises:
        SceneError: numbers of both kinds, of which nobody knows which are thousands.
    """
    with_comma = _first_cell(rows, _DECIMAL_COMMA)
    if with_comma is None:
        return rows
    with_point = _first_cell(rows, _DECIMAL_POINT)
    if with_point is not None:
        number, cell = with_comma
        other = f'"{with_point[1].strip()}" in line {with_point[0]}'
        problem = f"has a decimal comma, and {other} a decimal point; a file has one of the two"
        raise SceneError(f"line {number}", problem, cell.strip())
    with_points = []
    for row in rows:
        cells = [_with_point(cell) for cell in row.cells]
        with_points.append(Row(row.number, cells))
    return with_points


def _with_point(cell: str) -> str:
    """A number with a decimal point for its comma; any other text as it stands."""
    match = _DECIMAL_COMMA.fullmatch(cell)
    if match is None:
        return cell
    return f"{match[1]}.{match[2]}"


def _first_cell(rows: Sequence[Row], pattern: re.Pattern) -> tuple[int, str] | None:
    """Line and text of the first cell that is as a whole of a pattern."""
    for row in rows:
        for cell in row.cells:
            if pattern.fullmatch(cell):
                return row.number, cell
    return None


def _with_line_of_units(heads: list[Head], rows: list[Row]) -> tuple[list[Head], list[Row]]:
    """Heads with the units of a line below them, where no head has its own, and the rows below."""
    if not rows or any(head.unit for head in heads):
        return heads, rows
    cells = list(map(str.strip, rows[0].cells))
    if any(cell.startswith("#") or _is_number(cell) for cell in cells):
        return heads, rows
    # a line of words alone would be one of readings, were it not that all of these have a number
    with_units = []
    for head, cell in zip(heads, cells, strict=True):
        with_units.append(Head(head.name, _unit_of(cell)))
    return with_units, rows[1:]


def _unit_of(cell: str) -> str:
    unit = cell
    match = _BRACKETS.fullmatch(cell)
    if match is not None:
        unit = match[1].strip()
    return "" if unit == "-" else unit


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
