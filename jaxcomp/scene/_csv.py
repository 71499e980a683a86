"""Tables of numbers beside a scene file: CSV whose header names its columns with their units.

A section takes its lists from one by the key `csv`:

    [gas]
    type = "crank_angle_table"
    csv = "indicator.csv"
    back_pressure = "1 bar"

where indicator.csv begins with `angle [deg],cylinder_pressure [bar]`.
"""

import csv
import io
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ._errors import SceneError

KEY = "csv"
_LARGEST_FILE = 4_000_000  # [bytes]
_DECIMAL_COMMA = re.compile(r"\s*([-+]?\d*),(\d+)\s*")
_HEADER = re.compile(r"\s*(\w+)\s*(?:\[(.*)\])?\s*")


def read_cells(path: str | os.PathLike) -> list[list[str]]:
    """The lines of a CSV file that are not empty; with semicolons it may have decimal commas.

    Raises:
        SceneError: a file that cannot be read, is too large or no text. It names the file.
    """
    name = os.fspath(path)
    try:
        with open(path, encoding="utf-8-sig") as file:  # line ends of any kind
            text = file.read(_LARGEST_FILE + 1)
        if len(text) > _LARGEST_FILE:
            raise SceneError("", f"is larger than {_LARGEST_FILE / 1e6:.0f} MB", file=name)
        return [cells for cells in _cells(text) if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        raise SceneError("", f"is no table: {error}", file=name) from None
    except OSError as error:
        raise SceneError("", f"cannot be read: {error.strerror}", file=name) from None
    except UnicodeDecodeError:
        raise SceneError("", "is no text in UTF-8", file=name) from None


def header_cell(text: str) -> tuple[str, str] | None:
    """Name and unit of a column, the unit empty where it has none; `None` for anything else."""
    match = _HEADER.fullmatch(text)
    return (match[1], (match[2] or "").strip()) if match else None


def with_tables(tables: Any, folder: Path, path: str = "") -> Any:
    """Tables of a scene file in which every key `csv` gives way to the columns of that file.

    Args:
        tables: as read.
        folder: from which relative names count.
        path: dotted path of the tables, for messages.

    Raises:
        SceneError: a file that cannot be read, a column without a name or given beside the file, or
            a cell that is no number.
    """
    if isinstance(tables, list):
        return [with_tables(one, folder, f"{path}.{n}") for n, one in enumerate(tables)]
    if not isinstance(tables, dict):
        return tables
    out = {
        key: with_tables(one, folder, f"{path}.{key}" if path else key)
        for key, one in tables.items()
        if key != KEY
    }
    if KEY not in tables:
        return out
    name = tables[KEY]
    if not isinstance(name, str):
        raise SceneError(f"{path}.{KEY}", "must be the name of a CSV file", name)
    columns = _columns(folder / name)
    for column in columns:
        if column in out:
            raise SceneError(f"{path}.{column}", f'is given here and in "{name}"')
    return out | columns


def _columns(file: Path) -> dict[str, dict[str, Any]]:
    lines = read_cells(file)
    try:
        if len(lines) < 2:
            raise SceneError("", "needs a header and lines of numbers")
        columns: dict[str, dict[str, Any]] = {}
        for place, text in enumerate(lines[0]):
            known = header_cell(text)
            if known is None or known[0] in columns:
                raise SceneError(text.strip(), "must be a name with its unit, as angle [deg], once")
            values = [
                _number(line, place, number, known[0]) for number, line in enumerate(lines[1:], 2)
            ]
            columns[known[0]] = {
                "value": values,
                "unit": known[1],
                "source": f"read from {file.name}",
            }
    except SceneError as error:
        raise error.in_file(str(file)) from None
    for one in columns.values():
        if not one["unit"]:
            del one["unit"]
    return columns


def _number(line: list[str], place: int, number: int, name: str) -> float:
    try:
        return float(line[place])
    except (ValueError, IndexError):
        given = line[place] if place < len(line) else ""
        raise SceneError(f"line {number}.{name}", "must be a number", given) from None


def _cells(text: str) -> Iterator[list[str]]:
    if ";" not in text.partition("\n")[0]:
        return csv.reader(io.StringIO(text))
    table = csv.reader(io.StringIO(text), delimiter=";")
    return ([_decimal_point(cell) for cell in cells] for cells in table)


def _decimal_point(cell: str) -> str:
    number = _DECIMAL_COMMA.fullmatch(cell)
    return f"{number[1]}.{number[2]}" if number else cell
