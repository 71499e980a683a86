"""A sheet of a workbook as the text of a table, by openpyxl.

Cells become what a table in CSV has; a line of the text is a row of the sheet, so that messages name the
row that a spreadsheet shows.
"""

import csv
import io
import zipfile
from datetime import date, datetime, time
from itertools import chain, zip_longest
from typing import TYPE_CHECKING, Any

from ._text import SceneError

if TYPE_CHECKING:
    from openpyxl.workbook import Workbook
    from openpyxl.worksheet.worksheet import Worksheet

SUFFIXES = (".xlsx", ".xlsm")
_LARGEST_UNPACKED = 100_000_000  # [bytes]


def sheet_text(content: bytes, name: str = "") -> str:
    """The text of a sheet: commas between cells, a line for every row.

    Args:
        content: of the workbook.
        name: of the sheet; empty: the only one that has cells.

    Raises:
        SceneError: no workbook, openpyxl is missing, a sheet that is not there or that would have to be
            chosen, or a cell whose value is not the one that the sheet shows.
    """
    try:
        from openpyxl import load_workbook
    except ImportError:
        problem = 'needs openpyxl: pip install ".[excel]"; or save the sheet as CSV in UTF-8'
        raise SceneError("", problem) from None
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(part.file_size for part in archive.infolist())
        if unpacked > _LARGEST_UNPACKED:
            raise SceneError("", f"is larger than {_LARGEST_UNPACKED / 1e6:.0f} MB unpacked")
        values = load_workbook(io.BytesIO(content), data_only=True)
        # a formula that no spreadsheet has calculated has no value, which only this shows
        formulas = load_workbook(io.BytesIO(content))
    except SceneError:
        raise
    except Exception as error:  # what openpyxl raises of a damaged file is of many kinds
        raise SceneError("", f"is no workbook that can be read: {error}") from None
    sheet = _selected_sheet(values, name)
    rows = _rows(sheet, formulas[sheet.title])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows(rows)
    return text.getvalue()


def _selected_sheet(workbook: "Workbook", name: str) -> "Worksheet":
    """The sheet of a name, or the only one with cells."""
    sheets = {sheet.title: sheet for sheet in workbook.worksheets}
    listed = ", ".join(f'"{title}"' for title in sheets)
    if name:
        if name not in sheets:
            raise SceneError("", f"has no sheet of this name; it has {listed}", name)
        return sheets[name]
    filled = [sheet for sheet in sheets.values() if _has_cells(sheet)]
    if not filled:
        return workbook.worksheets[0]
    if len(filled) > 1:
        some = ", ".join(f'"{sheet.title}"' for sheet in filled)
        example = f"#{filled[0].title}"
        raise SceneError("", f"has several sheets ({some}): name one behind the file, as {example}")
    return filled[0]


def _has_cells(sheet: "Worksheet") -> bool:
    cells = chain.from_iterable(sheet.iter_rows())
    return any(cell.value is not None for cell in cells)


def _rows(values: "Worksheet", formulas: "Worksheet") -> list[list[str]]:
    """Texts of all cells."""
    rows = []
    for row, with_formulas in zip_longest(values.iter_rows(), formulas.iter_rows(), fillvalue=()):
        texts = []
        for cell, with_formula in zip(row, with_formulas, strict=True):
            texts.append(_text(cell, with_formula))
        rows.append(texts)
    return rows


def _text(cell: Any, with_formula: Any) -> str:
    """Text of a cell, as in a table in CSV.

    Raises:
        SceneError: a formula without a value.
    """
    value = cell.value
    place = cell.coordinate
    if value is None:
        if with_formula.value is None:
            return ""
        problem = "is a formula that was never calculated: open and save it in a spreadsheet"
        raise SceneError(f"cell {place}", problem, str(with_formula.value))
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, int | float):
        # 0.85 that is shown as 85 % would be read as 0.85 under a head in per cent
        if "%" in str(cell.number_format):
            return f"{100 * value:.15g} %"
        return repr(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return str(value)
