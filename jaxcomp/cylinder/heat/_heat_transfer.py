r"""What a correlation of the heat transfer in the cylinder may look at, and what it says.

$\dot Q = \alpha A_w (T_w - T)$ with $A_w = 2A_p + 4V/D$. The correlations were found for engines and
large or small compressors, and differ by factors of 2 to 10 (Tuhovcak et al., Appl. Therm. Eng. 2016):
compare several before a design leans on one.
"""

from abc import abstractmethod
from typing import NamedTuple

from jaxtyping import Array, Float

from ..._core.fields import POSITIVE, Part, quantity


class HeatInput(NamedTuple):
    """Quantities that a correlation may look at.

    Attributes:
        rho: [kg/m^3] of the gas.
        prandtl: [-]
        viscosity: [Pa s]
        conductivity: [W/(m K)]
        bore: [m]
        wall_area: [m^2] A_w.
        volume: [m^3]
        angle: [rad] of the crank, from the top dead centre.
        speed: [rad/s] of the crank.
        piston_speed: [m/s] mean over the revolution.
        outward: +1 while the volume grows, -1 while it shrinks.
        suction_open: 1 while the suction valve is off its seat, else 0.
        discharge_open: the same of the discharge valve.
        port_speed: [m/s] flow through the open valve over density and piston area.
    """

    rho: Float[Array, ""]
    prandtl: Float[Array, ""]
    viscosity: Float[Array, ""]
    conductivity: Float[Array, ""]
    bore: Float[Array, ""]
    wall_area: Float[Array, ""]
    volume: Float[Array, ""]
    angle: Float[Array, ""]
    speed: Float[Array, ""]
    piston_speed: Float[Array, ""]
    outward: Float[Array, ""]
    suction_open: Float[Array, ""]
    discharge_open: Float[Array, ""]
    # as if the gas moved with the whole section of the bore, to be compared with the piston
    port_speed: Float[Array, ""]

    def reynolds(self, velocity, length=None):
        """Reynolds number of a velocity [m/s], with the bore as length by default."""
        return self.rho * velocity * (self.bore if length is None else length) / self.viscosity


class AbstractHeat(Part):
    """A correlation for the heat transfer in the cylinder.

    Args:
        viscosity: [Pa s] of the gas; the fluid's own if absent.
        conductivity: [W/(m K)] of the gas; the fluid's own if absent.
    """

    # with both of these given the fluid's transport properties are not computed for it
    viscosity: Float[Array, ""] | None = quantity(
        "Pa s", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )
    conductivity: Float[Array, ""] | None = quantity(
        "W/(m K)", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )

    @abstractmethod
    def coefficient(self, at: HeatInput) -> Float[Array, ""]:
        """Heat transfer coefficient [W/(m^2 K)]."""
