"""Later stages of a machine with valves, and the coolers before them."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..valve import AbstractValve
from ._plenum import Plenum
from .crank_end import CrankEnd
from .heat._heat_transfer import AbstractHeat
from .laminar_gap import LaminarGap
from .load_step import ClearancePocket


class Intercooler(Part):
    """Cooler between two stages.

    Args:
        outlet_temperature: [K] of the gas that leaves it.
        pressure_drop: [Pa] from the discharge line of the stage before to the suction line behind.
        before: plenums between the discharge valves of the stage before and the cooler, in the order of
            the flow; each with its neck on the side of the cooler, and one for each cylinder.
        behind: plenums between the cooler and the suction valves, likewise.
    """

    kind: ClassVar[str] = "intercooler"

    outlet_temperature: Float[Array, ""] = quantity(
        "K", POSITIVE, doc="of the gas that leaves it", usual=(250.0, 400.0)
    )
    pressure_drop: Float[Array, ""] = quantity(
        "Pa", NONNEGATIVE, default=0.0, doc="between the lines of both stages", usual=(1e2, 1e6)
    )
    before: tuple[Plenum, ...] = ()
    behind: tuple[Plenum, ...] = ()


class Stage(Part):
    """Cylinders that draw what the stage before them delivers; the fluid is the machine's.

    Args:
        cooler: between the stage before and this one.
        suction_valve: into the cylinder.
        discharge_valve: out of the cylinder.
        clearance_ratio: [-] clearance volume over swept volume.
        wall_temperature: [K] of cylinder, head and piston; needed for heat transfer.
        heat: correlation of the heat transfer; adiabatic if absent.
        leakage: past the piston, as of the first stage; tight if absent.
        crank_end: compression on the rod's side as well; single-acting if absent.
        pocket: of the head end; none if absent.
    """

    kind: ClassVar[str] = "stage"

    cooler: Intercooler
    suction_valve: AbstractValve
    discharge_valve: AbstractValve
    clearance_ratio: Float[Array, ""] = quantity(
        "", POSITIVE, doc="clearance over swept volume", usual=(1e-3, 0.5)
    )
    wall_temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, usual=(150.0, 700.0)
    )
    heat: AbstractHeat | None = None
    leakage: LaminarGap | None = None
    crank_end: CrankEnd | None = None
    pocket: ClearancePocket | None = None
