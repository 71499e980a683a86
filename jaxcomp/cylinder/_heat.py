r"""Heat from the wall to the gas, $\dot Q = \alpha A_w (T_w - T)$ with $A_w = 2A_p + 4V/D$.

The correlations were found for engines and large or small compressors, and differ from each other
by factors of 2 to 10 (Tuhovcak et al., Appl. Therm. Eng. 2016): compare several before a design
leans on one.
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import POSITIVE, Part, quantity


class HeatInput(NamedTuple):
    """What a correlation may look at.

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

    viscosity: Float[Array, ""] | None = quantity(
        "Pa s", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )
    conductivity: Float[Array, ""] | None = quantity(
        "W/(m K)", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )

    @abstractmethod
    def coefficient(self, at: HeatInput) -> Float[Array, ""]:
        """Heat transfer coefficient [W/(m^2 K)]."""


class Annand(AbstractHeat):
    """Nu = a Re^b with bore and mean piston speed (Annand 1963).

    Args:
        viscosity: [Pa s] the fluid's own if absent.
        conductivity: [W/(m K)] the fluid's own if absent.
        factor: [-] a.
        exponent: [-] b.
    """

    kind: ClassVar[str] = "annand"

    factor: Float[Array, ""] = quantity("", POSITIVE, default=0.7)
    exponent: Float[Array, ""] = quantity("", POSITIVE, default=0.7)

    def coefficient(self, at):
        number = self.factor * at.reynolds(at.piston_speed) ** self.exponent
        return number * at.conductivity / at.bore


class Todescat(AbstractHeat):
    """Three times Annand's, as fitted to a household compressor (Todescat et al. 1992)."""

    kind: ClassVar[str] = "todescat"

    def coefficient(self, at):
        return 2.1 * at.reynolds(at.piston_speed) ** 0.7 * at.conductivity / at.bore


class LiuZhou(AbstractHeat):
    """Nu = 0.75 Re^0.8 Pr^0.6 with the mean piston speed (Liu and Zhou 1984)."""

    kind: ClassVar[str] = "liu_zhou"

    def coefficient(self, at):
        number = 0.75 * at.reynolds(at.piston_speed) ** 0.8 * at.prandtl**0.6
        return number * at.conductivity / at.bore


class Woschni(AbstractHeat):
    """Nu = 0.035 Re^0.8 with 2.28 times the mean piston speed, 6.18 times with a valve open."""

    kind: ClassVar[str] = "woschni"

    def coefficient(self, at):
        open_now = jnp.maximum(at.suction_open, at.discharge_open)
        velocity = (2.28 + (6.18 - 2.28) * open_now) * at.piston_speed
        return 0.035 * at.reynolds(velocity) ** 0.8 * at.conductivity / at.bore


class Adair(AbstractHeat):
    """Nu = 0.053 Re^0.8 Pr^0.6 with the equivalent diameter 6 V/A_w and a swirl (Adair et al. 1972).

    The swirl 2 w (1.04 + cos 2 theta) is halved in the half of the revolution about the bottom dead
    centre, where cos theta is negative: a jump of the coefficient at 90 degrees on either side.
    """

    kind: ClassVar[str] = "adair"

    def coefficient(self, at):
        length = 6 * at.volume / at.wall_area
        swirl = 2 * at.speed * (1.04 + jnp.cos(2 * at.angle))
        swirl = jnp.where(jnp.cos(at.angle) > 0, swirl, 0.5 * swirl)
        reynolds = at.reynolds(0.5 * at.bore * swirl, length)
        return 0.053 * reynolds**0.8 * at.prandtl**0.6 * at.conductivity / length


class Disconzi(AbstractHeat):
    """Nu = a Re^b Pr^0.6 by phase, with the speed in the open port (Disconzi et al. 2012).

    Compression 0.08 Re^0.8, discharge the same with u + u^0.8 c^0.2, expansion 0.12 Re^0.8, suction
    0.08 Re^0.9 with u + u^-0.4 c^1.4, u the mean piston speed and c the flow over density and bore.
    """

    kind: ClassVar[str] = "disconzi"

    def coefficient(self, at):
        u, c = at.piston_speed, at.port_speed
        c = jnp.maximum(c, 1e-6 * u)  # its powers have no slope at rest
        discharge = at.discharge_open * u**0.8 * c**0.2
        suction = at.suction_open * u**-0.4 * c**1.4
        factor = jnp.where(at.outward > 0, 0.12, 0.08)
        shut = factor * at.reynolds(u) ** 0.8
        out = 0.08 * at.reynolds(u + discharge) ** 0.8
        into = 0.08 * at.reynolds(u + suction) ** 0.9
        number = jnp.where(at.suction_open > 0, into, jnp.where(at.discharge_open > 0, out, shut))
        return number * at.prandtl**0.6 * at.conductivity / at.bore
