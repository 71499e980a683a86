"""Lists of numbers of a machine file from CSV files beside it, by the key `csv` of a section.

    [gas]
    type = "crank_angle_table"
    csv = "indicator.csv"
    back_pressure = "1 bar"

where indicator.csv begins with `angle [deg],cylinder_pressure [bar]`.
"""

import re
from pathlib import Path
from typing import Any

from ._schema import join
from ._settings import settings_of
from ._table_text import cell_number, read_table_text
from ._text import SceneError, reading

KEY = "csv"
_KEY_OF_COLUMN = re.compile(r"\w+")


def with_tables(tables: Any, folder: Path | None, path: str = "") -> Any:
    """Tables of a machine file in which every key `csv` gives way to the columns of that file.

    Args:
        tables: as read.
        folder: from which relative names count; `None` for a document without files beside it.
        path: dotted path of the tables, for messages.

    Raises:
        SceneError: a file that cannot be read, a column without a name or given beside the file, or
            a cell that is no number.
    """
    if isinstance(tables, list):
        return [with_tables(entry, folder, f"{path}.{n}") for n, entry in enumerate(tables)]
    if not isinstance(tables, dict):
        return tables
    out = {}
    for key, entry in tables.items():
        if key != KEY:
            out[key] = with_tables(entry, folder, join(path, key))
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
    """Columns of a file as entries of a machine file."""
    table = read_table_text(file)
    with reading(str(file)):
        if not table.rows:
            raise SceneError("", "needs a header and lines of numbers")
        settings_of(table.settings)
        columns = {}
        for place, (name, unit) in enumerate(table.heads):
            if not _KEY_OF_COLUMN.fullmatch(name) or name in columns:
                raise SceneError(name, "must be a name with its unit, as angle [deg], once")
            values = []
            for row in table.rows:
                values.append(cell_number(row.cells[place], f"line {row.number}.{name}"))
            columns[name] = {"value": values, "source": f"read from {file.name}"}
            if unit:
                columns[name]["unit"] = unit
        return columns
