"""The numbers and tables of a command as a workbook, by openpyxl."""

import io
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

# Cells beyond which a table is left to its CSV file: a second of writing for each hundred thousand.
_LARGEST = 200_000
_LONGEST_NAME = 31  # characters of the name of a sheet, in every spreadsheet
_FORBIDDEN = str.maketrans("[]:*?/\\", "_______")


def workbook(numbers: Mapping[str, Any], tables: Mapping[str, Mapping[str, Any]]) -> bytes:
    """A workbook with a sheet of all numbers and words, and one for each table.

    Args:
        numbers: with units in their keys, perhaps nested.
        tables: columns with units in their names, by the name of the table.
    """
    from openpyxl import Workbook
    from openpyxl.styles import Font

    book = Workbook(write_only=True)

    def add(name: str, rows: Iterator[list[Any]], width: int) -> None:
        sheet = book.create_sheet(name.translate(_FORBIDDEN)[:_LONGEST_NAME])
        sheet.freeze_panes = "A2"
        sheet.column_dimensions["A"].width = width
        for number, row in enumerate(rows):
            cells = [_cell(sheet, value) for value in row]
            if number == 0:
                for cell in cells:
                    cell.font = Font(bold=True)
            sheet.append(cells)

    add("result", _numbers(numbers), 50)
    for name, columns in tables.items():
        add(name, _rows(columns, name), 20)
    text = io.BytesIO()
    book.save(text)
    return text.getvalue()


def _cell(sheet: Any, value: Any) -> Any:
    """A cell; words that look like a formula stay words, and what is no number stays empty."""
    from openpyxl.cell import WriteOnlyCell

    if isinstance(value, float) and not math.isfinite(value):
        value = None
    cell = WriteOnlyCell(sheet, value)
    if isinstance(value, str):
        cell.data_type = "s"
    return cell


def _numbers(numbers: Mapping[str, Any]) -> Iterator[list[Any]]:
    yield ["quantity", "unit", "value"]
    yield from _flattened(numbers, "")


def _flattened(value: Any, path: str) -> Iterator[list[Any]]:
    """Rows of a nested result: dotted name, unit, and a number or word; a list goes on to the right."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flattened(inner, f"{path}.{key}" if path else str(key))
        return
    is_list = isinstance(value, list | tuple)
    if is_list and any(isinstance(inner, Mapping | list | tuple) for inner in value):
        for place, inner in enumerate(value):
            yield from _flattened(inner, f"{path}.{place}")
        return
    name, _, unit = path.partition(" [")
    values = list(value) if is_list else [value]
    unit, _, suffix = unit.partition("]")
    yield [name + suffix, unit, *values]


def _rows(columns: Mapping[str, Any], name: str) -> Iterator[list[Any]]:
    """The heads of a table and its rows."""
    arrays = [np.asarray(column) for column in columns.values()]
    if sum(array.size for array in arrays) > _LARGEST:
        yield [f"{name}.csv has this table: it is too long for a sheet"]
        return
    yield list(columns)
    for row in zip(*(array.tolist() for array in arrays), strict=True):
        yield list(row)
