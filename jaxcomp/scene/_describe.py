"""The values of a scene as rows of a table."""

from typing import Any, NamedTuple

import numpy as np

from .._fields import Part
from ..film import NamedBearing
from ._read import join, unwrapped
from ._scene import NAMED, Scene
from ._schema import Number, Option, PartTable, SubPart, choices, entries, kind_of, meanings


class Row(NamedTuple):
    """One value of a scene.

    Attributes:
        path: dotted path.
        given: the value as the file gives it, `None` where the default holds.
        value: the value in `unit`, or the word of an option.
        unit: SI unit, empty for a pure number or an option.
        source: where it comes from.
        doc: what it is.
    """

    path: str
    given: Any
    value: Any
    unit: str
    source: str
    doc: str


def describe(scene: Scene) -> tuple[Row, ...]:
    """Every value of a scene in the order of its parts, with its source.

    Quantities are NumPy arrays in SI units. The word `type` of a section stands before its values.
    """
    rows: list[Row] = []
    machine = scene.machine
    if machine.compressor is not None:
        rows += _rows(scene, machine.compressor, scene.document, "")
    for section in NAMED:
        for name, part in getattr(machine, section).items():
            path, table = f"{section}.{name}", scene.document[section][name]
            rows.append(Row(f"{path}.type", table.get("type"), kind_of(type(part)), "", "", ""))
            rows += _rows(scene, part, table, path)
    for name, part in machine.parts.items():
        rows += _rows(scene, part, scene.document[name], name)
    return tuple(rows)


def _rows(scene: Scene, part: Part, table: Any, path: str):
    told = meanings(type(part))
    for name, entry in entries(type(part)).items():
        value, here = getattr(part, name), join(path, name)
        if value is None:
            continue
        if isinstance(value, NamedBearing):
            source = scene.sources.get(here, "")
            yield Row(here, _written(table[name], here), value.name, "", source, told[name])
        elif isinstance(entry, SubPart):
            if len(choices(entry.classes)) > 1:
                given = table[name].get("type")
                yield Row(join(here, "type"), given, kind_of(type(value)), "", "", "")
            yield from _rows(scene, value, table[name], here)
        elif isinstance(entry, PartTable):
            for index, row in enumerate(value):
                if isinstance(row, NamedBearing):
                    place = f"{here}.{index}"
                    source = scene.sources.get(place, "")
                    yield Row(place, row.name, row.name, "", source, told[name])
                else:
                    yield from _rows(scene, row, table[name][index], f"{here}.{index}")
        elif isinstance(entry, Number | Option):
            given = _written(table[name], here) if name in table else None
            source = scene.sources.get(here, "default")
            if isinstance(entry, Number):
                yield Row(here, given, np.asarray(value), entry.unit, source, told[name])
            else:
                yield Row(here, given, value, "", source, told[name])


def _written(entry: Any, path: str) -> Any:
    value, unit, _ = unwrapped(entry, path)
    return f"{value} {unit}" if unit else value
