"""The crank end of a double-acting cylinder."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..valve import AbstractValve
from .laminar_gap import LaminarGap
from .load_step import ClearancePocket


class CrankEnd(Part):
    """Compression on the other side of the piston as well, around its rod.

    Args:
        rod_diameter: [m] of the piston rod.
        clearance_ratio: [-] clearance over swept volume of this end; that of the head end if absent.
        suction_valve: into this end; alike that of the head end if absent.
        discharge_valve: out of this end; alike that of the head end if absent.
        packing: gap between rod and packing, through which gas of this end leaks to that of the
            suction line; tight if absent.
        pocket: of this end; none if absent.
        ambient_pressure: [Pa] on the rod's other end, as in the crosshead guide.
    """

    kind: ClassVar[str] = "crank_end"

    rod_diameter: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="of the piston rod", usual=(5e-3, 0.3)
    )
    clearance_ratio: Float[Array, ""] | None = quantity(
        "",
        POSITIVE,
        default=None,
        doc="clearance over swept volume of this end; that of the head end if absent",
        usual=(1e-3, 0.5),
    )
    suction_valve: AbstractValve | None = None
    discharge_valve: AbstractValve | None = None
    packing: LaminarGap | None = None
    pocket: ClearancePocket | None = None
    ambient_pressure: Float[Array, ""] = quantity(
        "Pa", NONNEGATIVE, default=101325.0, doc="on the rod's other end"
    )
