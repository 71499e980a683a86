"""Columns of tables of measurements by names, in SI units, with the standard deviations beside them."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._core.display import is_temperature
from .._core.words import did_you_mean
from ._settings import known_name
from ._table_text import Head, Row, TableText, cell_number
from ._text import SceneError
from ._units import factor, scale

# Revolutions or cycles a second, which are no speeds of rotation to the registry of units.
_TURNS = ("hz", "1/s", "s^-1")
_DEVIATION = re.compile(r"sd\s*\((.*)\)", re.IGNORECASE)


class Columns:
    """Columns of a table; case, blanks, hyphens and underscores of their names do not count.

    Attributes:
        names: of the columns as they are known, those of deviations as "sd(NAME)".
    """

    names: tuple[str, ...]

    def __init__(
        self,
        table: TableText,
        allowed: Iterable[str],
        needed: Sequence[str] = (),
        examples: Mapping[str, str] | None = None,
        *,
        deviations: bool = False,
        temperatures: Iterable[str] = (),
        settings: Mapping[str, str] | None = None,
    ):
        """Look the names up.

        Args:
            table: with heads.
            allowed: names that columns may have.
            needed: those of which a column must be there.
            examples: a unit of a column by its name, for messages; the SI unit if absent.
            deviations: whether columns of standard deviations, "sd(NAME)", are known as well.
            temperatures: columns in degrees whose names do not say so.
            settings: what stands above the heads and never in a column: a value by each name.

        Raises:
            SceneError: an unknown column, one that is there twice, or one that is missing.
        """
        allowed = tuple(allowed)
        self._rows: Sequence[Row] = table.rows
        self._examples = dict(examples or {})
        self._temperatures = tuple(temperatures)
        self._places: dict[str, int] = {}
        self._units: dict[str, str] = {}
        for place, head in enumerate(table.heads):
            _refuse_setting(head.name, settings or {})
            name = _column_name(head, allowed, deviations)
            if name in self._places:
                raise SceneError(name, "is there twice")
            self._places[name] = place
            self._units[name] = head.unit
        self.names = tuple(self._places)
        for name in needed:
            if name not in self._places:
                raise SceneError(name, f"is a missing column; a head is {self._example(allowed)}")

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def __len__(self) -> int:
        return len(self._rows)

    def unit(self, name: str) -> str:
        """Unit in the head of a column."""
        return self._units[name]

    def words(self, name: str) -> tuple[str, ...]:
        """Texts of a column.

        Raises:
            SceneError: an empty one.
        """
        place = self._places[name]
        words = tuple(row.cells[place].strip() for row in self._rows)
        for row, word in zip(self._rows, words, strict=True):
            if not word:
                problem = f"is empty; write the {name} on every line"
                raise SceneError(f"line {row.number}.{name}", problem)
        return words

    def values(self, name: str, si: str, *, may_be_empty: bool = True) -> NDArray:
        """Numbers of a column.

        Args:
            name: of the column.
            si: SI unit, "" for pure numbers.
            may_be_empty: whether cells may be, which stand for what was not measured.

        Returns:
            [SI] (n,), not a number in empty cells.

        Raises:
            SceneError: no number, a missing unit, or one of another dimension.
        """
        level = name in self._temperatures or is_temperature(name, si)
        size, zero = self._scale(name, si, level)
        empty = np.nan if may_be_empty else None
        return self._numbers(name, empty) * size + zero

    def deviations(self, name: str, si: str, values: NDArray) -> NDArray | None:
        """Standard deviations of a column; `None` where the table has none.

        Args:
            name: of the column.
            si: its SI unit.
            values: [SI] (n,) of the column, for deviations in per cent.

        Returns:
            [SI] (n,), not a number in empty cells.

        Raises:
            SceneError: as `values`, and a deviation that is not above zero.
        """
        of_name = f"sd({name})"
        if of_name not in self._places:
            return None
        numbers = self._numbers(of_name, np.nan)
        for row, number in zip(self._rows, numbers.tolist(), strict=True):
            if number <= 0:
                raise SceneError(f"line {row.number}.{of_name}", "must be above 0", number)
        if self._units[of_name] == "%":
            return numbers / 100 * np.abs(values)
        return numbers * self._scale(of_name, si, False)[0]

    def place(self, row: int, name: str) -> str:
        """Place of a cell, for messages: the line in the file, and the column."""
        return f"line {self._rows[row].number}.{name}"

    def refuse(self, name: str, wrong: NDArray, values: NDArray, bound: str) -> None:
        """Refuse the first of some values that is wrong.

        Args:
            name: of the column.
            wrong: (n,) whether a value is.
            values: (n,) as the message shows them.
            bound: what they must be.

        Raises:
            SceneError: one is.
        """
        if wrong.any():
            row = int(np.argmax(wrong))
            raise SceneError(self.place(row, name), f"must be {bound}", float(values[row]))

    def _numbers(self, name: str, empty: float | None) -> NDArray:
        place = self._places[name]
        numbers = []
        for row in self._rows:
            key = f"line {row.number}.{name}"
            numbers.append(cell_number(row.cells[place], key, empty))
        return np.array(numbers, float)

    def _scale(self, name: str, si: str, level: bool) -> tuple[float, float]:
        """Size of the unit of a column, and its zero."""
        unit = self._units[name]
        if si and not unit:
            example = self._examples.get(name, si)
            raise SceneError(name, f'needs its unit in the head, as in "{name} [{example}]"')
        if not unit:
            return 1.0, 0.0
        if si == "rad/s" and unit.lower() in _TURNS:
            return 2 * np.pi, 0.0
        return scale(unit, si, level, name, unit)

    def _example(self, allowed: Iterable[str]) -> str:
        heads = []
        for name in allowed:
            unit = self._examples.get(name, "")
            head = f"{name} [{unit}]" if unit else name
            heads.append(head)
        return f'"{",".join(heads)}"'

    def has_dimension(self, name: str, si: str) -> bool:
        """Whether the unit of a column is one of a dimension."""
        try:
            return bool(self._units[name]) and factor(self._units[name], si) > 0
        except SceneError:
            return False


def _refuse_setting(name: str, settings: Mapping[str, str]) -> None:
    """Refuse a column of what is a setting of the whole file.

    Raises:
        SceneError: it is one.
    """
    setting = known_name(name, settings)
    if setting is not None:
        line = f"# {setting} = {settings[setting]}"
        raise SceneError(name, f'is no column; write "{line}" above the heads, for all lines')


def _column_name(head: Head, allowed: Sequence[str], deviations: bool) -> str:
    """Name of a column as it is known."""
    deviation = None
    if deviations:
        deviation = _DEVIATION.fullmatch(head.name)
    if deviation is None:
        return _allowed_name(head, head.name, allowed, "is an unknown column")
    plain = deviation[1].strip()
    return f"sd({_allowed_name(head, plain, allowed, 'is of an unknown quantity')})"


def _allowed_name(head: Head, plain: str, allowed: Sequence[str], problem: str) -> str:
    name = known_name(plain, allowed)
    if name is None:
        raise SceneError(head.name, f"{problem}{did_you_mean(plain, allowed)}")
    return name
