"""Loads on a journal in CSV files: a crank angle a line, names and units in the head.

    angle [deg],W_x [N],W_y [N]
    0,-1234.5,88.1
    10,-1190.2,130.4

The load is that on the journal. The file has one period; its last line may be the first one a period
later. `journal_speed [rpm]` and `bush_speed [rpm]` are columns for rates of rotation that are not
constant, such as that of a connecting rod.
"""

import os
import re

import numpy as np
from numpy.typing import NDArray

from .._core.errors import BadInput
from ..crank import LoadTable
from ._columns import Columns
from ._settings import settings_of
from ._table_text import TableText, read_table_text
from ._text import SceneError, reading

# SI unit of every column, and the one of the example in messages.
_COLUMNS = {"angle": "rad", "W_x": "N", "W_y": "N"}
_SPEEDS = {"journal_speed": "rad/s", "bush_speed": "rad/s"}
_EXAMPLES = {"angle": "deg", "W_x": "N", "W_y": "N", "journal_speed": "rpm", "bush_speed": "rpm"}
_ENTRY = re.compile(r"(\w+)\[(\d+)\]")


def read_loads(
    path: str | os.PathLike,
    period: float | None = None,
    frame: str = "fixed",
    between: str = "spline",
) -> LoadTable:
    """The load table of a CSV file.

    Args:
        path: of the file.
        period: [rad] of the table; absent, the least number of whole revolutions that hold it.
        frame, between: as of `LoadTable`.

    Raises:
        SceneError: a file that cannot be read, a missing or unknown column, a missing unit or one of
            another dimension, a cell that is no number, angles that do not rise or leave a gap, or a load
            that is not periodic. It names file, line and column.
        BadInput: an unknown frame or way between the points.
    """
    with reading(os.fspath(path)):
        table = read_table_text(path)
        columns = _load_columns(table)
        angle, *load = (columns.pop(name) for name in _COLUMNS)
        try:
            return LoadTable(angle, np.stack(load), period, frame=frame, between=between, **columns)  # pyright: ignore
        except BadInput as error:
            entry = _ENTRY.fullmatch(error.field)
            if entry is None and error.field != "angle":
                raise
            place = error.field
            if entry:
                place = f"line {table.rows[int(entry[2])].number}.{entry[1]}"
            raise SceneError(place, f"must be {error.bound}", error.value) from None


def _load_columns(table: TableText) -> dict[str, NDArray]:
    """[SI] Columns by their names."""
    if not table.heads:
        raise SceneError("", "is empty")
    settings_of(table.settings)
    columns = Columns(table, _COLUMNS | _SPEEDS, tuple(_COLUMNS), _EXAMPLES)
    units = _COLUMNS | _SPEEDS
    values = {}
    for name in columns.names:
        values[name] = columns.values(name, units[name], may_be_empty=False)
    return values
