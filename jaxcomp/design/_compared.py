"""Designs beside each other: losses, forces and dimensions."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from .._fields import quantities, subparts
from ..crank import Orbit
from ..machine import Machine


class ComparedQuantity(NamedTuple):
    """A quantity or dimension of several designs.

    Attributes:
        name: of the quantity, or the path of the dimension.
        unit: SI unit.
        values: [SI] of each design, `None` where one has no such thing.
    """

    name: str
    unit: str
    values: tuple[float | None, ...]


def compared_designs(
    machines: Sequence[Machine], orbits: Sequence[Orbit]
) -> list[ComparedQuantity]:
    """What the cranks of some designs give, then the numbers of the compressor in which they differ.

    Args:
        machines: with a compressor each, of any parts.
        orbits: their periodic states.
    """
    given = [dict(_figures(orbit)) for orbit in orbits]
    figures = [row for row in _joined(given) if not row.name.endswith("residual")]
    dimensions = _joined([dict(_dimensions(one)) for one in machines])
    return figures + [row for row in dimensions if len(set(row.values)) > 1]


def _joined(tables: Sequence[dict[str, tuple[str, float]]]) -> list[ComparedQuantity]:
    """One row for each name, in the order in which they come first, all `loss_power` together."""
    names = {name: unit for table in tables for name, (unit, _) in table.items()}
    families = list(dict.fromkeys(name.partition(".")[0] for name in names))
    names = dict(sorted(names.items(), key=lambda one: families.index(one[0].partition(".")[0])))
    return [
        ComparedQuantity(name, unit, tuple(t[name][1] if name in t else None for t in tables))
        for name, unit in names.items()
    ]


def _figures(orbit: Orbit) -> Iterator[tuple[str, tuple[str, float]]]:
    for one in orbit.described():
        if not one.dims:
            yield one.name, (one.unit, float(one.values))


def _dimensions(machine: Machine) -> Iterator[tuple[str, tuple[str, float]]]:
    for path, part in subparts(machine.compressor):
        for name, field in quantities(part):
            value = getattr(part, name)
            if value is not None and not np.ndim(value):
                place = f"{path}.{name}" if path else name
                yield place, (field.metadata["unit"], float(value))
