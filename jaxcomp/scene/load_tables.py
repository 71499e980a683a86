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

from .._core.errors import BadInput
from .._core.words import did_you_mean
from ..crank import LoadTable
from ._cells import cell_number, header_cell, lines_of, read_cells
from ._text import SceneError, reading
from ._units import factor

_COLUMNS = {"angle": ("rad", "deg"), "W_x": ("N", "N"), "W_y": ("N", "N")}
_SPEEDS = {"journal_speed": ("rad/s", "rpm"), "bush_speed": ("rad/s", "rpm")}
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
        columns = _read(read_cells(path))
        angle, *load = (columns.pop(name) for name in _COLUMNS)
        try:
            return LoadTable(angle, np.stack(load), period, frame=frame, between=between, **columns)  # pyright: ignore
        except BadInput as error:
            entry = _ENTRY.fullmatch(error.field)
            if entry is None and error.field != "angle":
                raise
            place = f"line {int(entry[2]) + 2}.{entry[1]}" if entry else "angle"
            raise SceneError(place, f"must be {error.bound}", error.value) from None


def _read(lines: list[list[str]]) -> dict[str, np.ndarray]:
    if not lines:
        raise SceneError("", "is empty")
    sizes = _sizes(lines[0])
    table = {name: [] for name in sizes}
    for number, line in lines_of(lines[1:], len(sizes)):
        for (name, size), text in zip(sizes.items(), line, strict=True):
            table[name].append(cell_number(text, f"line {number}.{name}") * size)
    return {name: np.array(values) for name, values in table.items()}


def _sizes(heads: list[str]) -> dict[str, float]:
    """[SI] Size of the unit of every column by its name."""
    known, sizes = _COLUMNS | _SPEEDS, {}
    for cell in heads:
        name, unit = header_cell(cell) or (cell.strip(), "")
        if name not in known:
            raise SceneError(cell.strip(), f"is an unknown column{did_you_mean(name, known)}")
        if name in sizes:
            raise SceneError(name, "is there twice")
        if not unit:
            raise SceneError(name, f'needs its unit in the head, as in "{name} [{known[name][1]}]"')
        sizes[name] = factor(unit, known[name][0], name, unit)
    for name in _COLUMNS:
        if name not in sizes:
            head = ",".join(f"{one} [{unit}]" for one, (_, unit) in _COLUMNS.items())
            raise SceneError(name, f'is a missing column; a head is "{head}"')
    return sizes
