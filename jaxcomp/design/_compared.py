"""Two designs beside each other: losses, forces and dimensions."""

from typing import NamedTuple

import numpy as np

from .._fields import quantities, subparts
from ..crank import solve_orbit
from ..machine import Machine, assembled
from ._quantities import Chain


class Compared(NamedTuple):
    """A quantity or dimension of two designs.

    Attributes:
        name: of the quantity, or the path of the dimension.
        unit: SI unit.
        before, after: [SI]
    """

    name: str
    unit: str
    before: float
    after: float


def compared(before: Machine, after: Machine, chain: Chain | None = None) -> list[Compared]:
    """What the crank of two designs gives, then the numbers of the compressor in which they differ.

    Args:
        before, after: machines with a compressor, of the same parts.
        chain: how a design is worked out.
    """
    designs = (before, after)
    laws = [assembled(one).compressor for one in designs]
    solver = None if chain is None else chain.solver
    orbits = [solve_orbit(one, solver, throw=False) for one in laws]
    rows = [
        Compared(one.name, one.unit, float(one.values), float(other.values))
        for one, other in zip(*(orbit.described() for orbit in orbits), strict=True)
        if not one.dims and not one.name.endswith("residual")
    ]
    return rows + _dimensions(before, after)


def _dimensions(before: Machine, after: Machine) -> list[Compared]:
    rows = []
    pairs = zip(subparts(before.compressor), subparts(after.compressor), strict=True)
    for (path, old), (_, new) in pairs:
        for name, field in quantities(old):
            values = getattr(old, name), getattr(new, name)
            if values[0] is None or np.ndim(values[0]) or values[0] == values[1]:
                continue
            place = f"{path}.{name}" if path else name
            rows.append(Compared(place, field.metadata["unit"], *map(float, values)))
    return rows
