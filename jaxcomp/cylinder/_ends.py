"""The ends of the cylinders of a machine, each a cylinder of its own, and which of them touch."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.each import stacked
from .._core.errors import BadInput
from .._core.fields import rebuilt, replaced
from ..mechanism import AbstractMechanism
from ._cylinder import Cylinder
from ._piston_end import PistonEnd
from .laminar_gap import LaminarGap


class Grouping(NamedTuple):
    """Which ends are solved together.

    Attributes:
        ends: of all cylinders.
        sides: of every cylinder, 1 or 2.
        groups: of ends that touch each other, by plenums or past the rings; all are alike in number.
    """

    ends: int
    sides: int
    groups: int

    @property
    def together(self) -> int:
        """Ends of a group."""
        return self.ends // self.groups


def has_ends(cylinder: Cylinder) -> bool:
    """Whether the gas is solved by the ends of the cylinders."""
    return cylinder.crank_end is not None


def grouping(cylinder: Cylinder, count: int) -> Grouping:
    """Which ends of so many cylinders are solved together."""
    sides = 1 if cylinder.crank_end is None else 2
    ends = sides * count
    if cylinder.plenums:
        return Grouping(ends, sides, 1)
    return Grouping(ends, sides, ends if cylinder.leakage is None or sides == 1 else count)


def phase_of_ends(cylinder: Cylinder, phase: Float[Array, " k"]) -> Float[Array, " e"]:
    """[rad] Own crank angle of every end less that of the crank.

    Args:
        cylinder: gas side.
        phase: [rad] of every cylinder.
    """
    if cylinder.crank_end is None:
        return phase
    return (phase[:, None] + jnp.asarray([0.0, np.pi])).ravel()


class Ends(eqx.Module):
    """The ends of all cylinders, head before crank end, cylinder after cylinder.

    Attributes:
        cylinders: the gas side of every end, with an axis of k.
        pistons: the motion in every end, likewise.
        phase: [rad] (k,) own crank angle of each less that of the crank.
        grouping: which are solved together.
    """

    cylinders: Cylinder
    pistons: PistonEnd
    phase: Float[Array, " k"]
    grouping: Grouping = eqx.field(static=True)

    def grouped(self) -> "Ends":
        """Ends with axes of groups and of the ends of each."""
        shape = self.grouping.groups, self.grouping.together

        def split(leaf):
            return leaf.reshape(*shape, *leaf.shape[1:])

        return jax.tree.map(split, self)


def ends_of(cylinder: Cylinder, mechanisms: Sequence[AbstractMechanism], phase) -> Ends:
    """The ends of the cylinders of a machine.

    Args:
        cylinder: gas side of every cylinder, with or without crank ends.
        mechanisms: the linkage of every cylinder.
        phase: [rad] own crank angle of every cylinder less that of the crank.
    """
    cylinders = []
    pistons = []
    for mechanism in mechanisms:
        for gas_side, piston in _ends_of_cylinder(cylinder, mechanism):
            cylinders.append(gas_side)
            pistons.append(piston)
    _check_kinds(cylinders)
    return Ends(
        stacked(cylinders),
        stacked(pistons),
        phase_of_ends(cylinder, phase),
        grouping(cylinder, len(mechanisms)),
    )


def _ends_of_cylinder(
    cylinder: Cylinder, mechanism: AbstractMechanism
) -> list[tuple[Cylinder, PistonEnd]]:
    """Gas side and motion of each end."""
    crank_end = cylinder.crank_end
    assert crank_end is not None
    # The gap past the piston lies between the ends; what leaves them is past the packing.
    rings = cylinder.leakage
    packing = crank_end.packing
    closed = None if packing is None else replaced(packing, gap=jnp.zeros(()))
    clearance = crank_end.clearance_ratio
    head = rebuilt(cylinder, crank_end=None, leakage=closed)
    crank = rebuilt(
        head,
        leakage=packing,
        clearance_ratio=cylinder.clearance_ratio if clearance is None else clearance,
        suction_valve=crank_end.suction_valve or cylinder.suction_valve,
        discharge_valve=crank_end.discharge_valve or cylinder.discharge_valve,
    )
    rod = crank_end.rod_diameter
    ambient = crank_end.ambient_pressure
    return [
        (head, _piston_end(mechanism, 1.0, jnp.zeros_like(rod), ambient, rings)),
        (crank, _piston_end(mechanism, -1.0, rod, ambient, rings)),
    ]


def _piston_end(mechanism, sense: float, rod, ambient, rings: LaminarGap | None) -> PistonEnd:
    return PistonEnd(mechanism, jnp.asarray(sense), rod, ambient, rings)


def _check_kinds(cylinders: list[Cylinder]) -> None:
    """That the ends have parts of the same kinds, of which one program solves all."""
    for name in ("suction_valve", "discharge_valve"):
        kinds = {jax.tree.structure(getattr(end, name)) for end in cylinders}
        if len(kinds) > 1:
            types = ", ".join(dict.fromkeys(getattr(end, name).kind for end in cylinders))
            bound = "the same kind and the same optional entries as that of the head end"
            raise BadInput(f"gas.crank_end.{name}", types, bound)
