"""Records that `jaxcomp list` and `cache` print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .._core.declared import BESIDE, Note, Record, part, reading, word


@dataclass(frozen=True)
class StoredPrograms(Record):
    """The store of compiled programs: its folder or why there is none, their number and size."""

    folder: str | None = word()
    why: str = word()
    programs: int = reading("")
    size: int = reading(Note("in bytes"))


@dataclass(frozen=True)
class ListedValue(Record):
    """A value of a machine file, as it is given and in its SI unit, with its source."""

    written: Any = reading(BESIDE, key="given")
    value: Any = reading(BESIDE)
    unit: str = word()
    source: str = word()
    doc: str = word()


@dataclass(frozen=True)
class ListedValues(Record):
    """The values of a machine file by their paths."""

    name: str = word()
    description: str = word()
    values: dict[str, ListedValue] = part(ListedValue, by_name=True)
