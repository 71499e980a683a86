"""Lines and cells of CSV files, beside a scene or alone.

A section takes lists of numbers from a CSV file beside its own by the key `csv`:

    [gas]
    type = "crank_angle_table"
    csv = "indicator.csv"
    back_pressure = "1 bar"

where indicator.csv begins with `angle [deg],cylinder_pressure [bar]`.
"""

import csv
import io
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._core.files import regular
from ._text import LARGEST, SceneError, reading

KEY = "csv"
_DECIMAL_COMMA = re.compile(r"^\s*([-+]?\d*),(\d+)\s*$")
_COLUMN = re.compile(r"\s*(\w+)\s*(?:\[(.*)\])?\s*")


def read_cells(path: str | os.PathLike) -> list[list[str]]:
    """The lines of a CSV file that are not empty; with semicolons it may have decimal commas.

    Raises:
        SceneError: a file that cannot be read, is too large or no text. It names the file.
    """
    with reading(os.fspath(path)):
        with open(regular(path), encoding="utf-8-sig") as file:  # line ends of any kind
            text = file.read(LARGEST + 1)
        if len(text) > LARGEST:
            raise SceneError("", f"is larger than {LARGEST / 1e6:.0f} MB")
        try:
            return [cells for cells in _cells(text) if any(cell.strip() for cell in cells)]
        except csv.Error as error:
            raise SceneError("", f"is no table: {error}") from None


def header_cell(text: str) -> tuple[str, str] | None:
    """Name and unit of a column, the unit empty where it has none; `None` for anything else."""
    match = _COLUMN.fullmatch(text)
    return (match[1], (match[2] or "").strip()) if match else None


def lines_of(lines: list[list[str]], count: int) -> Iterator[tuple[int, list[str]]]:
    """Lines of a table below its heads, with their numbers in the file.

    Raises:
        SceneError: a line of another number of cells than heads.
    """
    for number, line in enumerate(lines, 2):
        if len(line) != count:
            raise SceneError(f"line {number}", f"must have {count} cells", len(line))
        yield number, line


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
        raise SceneError(key, problem, text) from None
    if not math.isfinite(value):
        raise SceneError(key, "must be finite", value)
    return value


def with_tables(tables: Any, folder: Path | None, path: str = "") -> Any:
    """Tables of a scene file in which every key `csv` gives way to the columns of that file.

    Args:
        tables: as read.
        folder: from which relative names count; `None` for a document without files beside it.
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
    if folder is None:
        problem = (
            "names a file, and none is read for a machine that was sent; write its columns here"
        )
        raise SceneError(f"{path}.{KEY}", problem)
    columns = _columns(folder / name)
    for column in columns:
        if column in out:
            raise SceneError(f"{path}.{column}", f'is given here and in "{name}"')
    return out | columns


def _columns(file: Path) -> dict[str, dict[str, Any]]:
    lines, columns = read_cells(file), {}
    with reading(str(file)):
        if len(lines) < 2:
            raise SceneError("", "needs a header and lines of numbers")
        for place, text in enumerate(lines[0]):
            name, unit = header_cell(text) or ("", "")
            if not name or name in columns:
                raise SceneError(text.strip(), "must be a name with its unit, as angle [deg], once")
            values = [_number(line, place, n, name) for n, line in enumerate(lines[1:], 2)]
            columns[name] = {"value": values} | ({"unit": unit} if unit else {})
            columns[name]["source"] = f"read from {file.name}"
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
    return ([_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in cells] for cells in table)
