r"""What the gas loses on its way: heat to the wall, and mass past the piston.

$\dot Q = \alpha A_w (T_w - T)$ with $A_w = 2A_p + 4V/D$. The correlations were found for engines and
large or small compressors, and differ by factors of 2 to 10 (Tuhovcak et al., Appl. Therm. Eng. 2016):
compare several before a design leans on one.

The temperature of the wall is given, or follows from a steady balance of heat over the cycle,

$$\oint \dot Q_{gas}\,dt + UA_s\oint (T_s - T_w)\,dt + UA_d\oint (T_d - T_w)\,dt
  = UA_a\oint (T_w - T_a)\,dt .$$

The wall takes heat from the gas in the cylinder and behind the discharge valve, heats that before the
suction valve, and gives the rest to its surroundings. Its heat capacity is so large that its temperature
does not vary within a revolution: it is one more unknown, and the heat that it has gained in a revolution
one more state, which must end at zero.

The leakage is the laminar flow of a compressible gas through the gap,

$$\dot m = \frac{\pi D g^3}{12\mu L}\left(1 + \tfrac32\varepsilon^2\right)
(p - p_c)\,\frac{\rho + \rho_c}{2} .$$
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Bound, Part, quantity
from ..fluid import GasState
from ..valve.interface import Side

OF_WALL = 2  # states: temperature, and heat gained since the beginning of the revolution
# [W/(m^2 K)] Of the gas, about: how far the wall's temperature moves from one marched revolution to the
# next. The solution does not depend on it.
_USUAL = 500.0


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


class WallNetwork(Part):
    """Thermal conductances from the wall of cylinder and head.

    Args:
        ambient_temperature: [K] of what surrounds the wall: shell, crankcase, cooling air.
        ambient_conductance: [W/K] UA from the wall to it.
        suction_conductance: [W/K] UA from the wall to the gas in the suction plenum next to the valve.
        discharge_conductance: [W/K] UA to the gas in the discharge plenum next to the valve.
    """

    kind: ClassVar[str] = "wall_network"

    ambient_temperature: Float[Array, ""] = quantity(
        "K", POSITIVE, doc="around the wall", usual=(200.0, 500.0)
    )
    ambient_conductance: Float[Array, ""] = quantity(
        "W/K", POSITIVE, doc="UA to its surroundings", usual=(1e-3, 1e4)
    )
    suction_conductance: Float[Array, ""] = quantity(
        "W/K", NONNEGATIVE, default=0.0, doc="UA to the suction plenum next to the valve"
    )
    discharge_conductance: Float[Array, ""] = quantity(
        "W/K", NONNEGATIVE, default=0.0, doc="UA to the discharge plenum next to the valve"
    )

    @property
    def conductance(self) -> Float[Array, ""]:
        """[W/K] All of them together."""
        return self.ambient_conductance + self.suction_conductance + self.discharge_conductance

    def to_plenums(self, wall, pair):
        """[W] From the wall to the gas before the suction and behind the discharge valve.

        Args:
            wall: [K]
            pair: both chains of plenums, or `None` without any.
        """
        before = pair[0].gases if pair else ()
        behind = pair[1].gases if pair else ()
        none = jnp.zeros(())
        return (
            self.suction_conductance * (wall - before[-1].T) if before else none,
            self.discharge_conductance * (wall - behind[0].T) if behind else none,
        )

    def gained(self, wall, to_gas, to_plenums) -> Float[Array, ""]:
        """[W] What the wall gains.

        Args:
            wall: [K]
            to_gas: [W] to the gas in the cylinder.
            to_plenums: [W] to the plenums.
        """
        lost = self.ambient_conductance * (wall - self.ambient_temperature)
        return -to_gas - sum(to_plenums) - lost


def next_revolution(case, state: Float[Array, " n"]) -> Float[Array, " n"]:
    """The state after the end of a revolution: the wall is warmer by the heat it has gained."""
    walls = case.cylinder.walls
    if walls is None:
        return state
    # a cylinder as long as its bore, for scale alone
    size = walls.conductance + _USUAL * 2 * jnp.pi * case.bore**2
    step = case.energy_scale * case.speed / (2 * jnp.pi * size * case.suction.T)
    return state.at[-2].add(step * state[-1]).at[-1].set(0.0)


class SuctionWarming(Part):
    r"""What warms the gas on its way to the suction valve: losses, and the gas that is delivered.

    $$\dot m\,(h_s - h_1) = \dot m c_p (T_2 - T_1)\left(1 - e^{-UA/(\dot m c_p)}\right)
      + \varphi\dot W_{loss}$$

    The rise grows where little gas flows, which a constant one does not. The periodic state closes it:
    flow, discharge temperature and losses are those at the rise that they cause.

    Args:
        discharge_conductance: [W/K] UA to the gas that is delivered.
        loss_share: [-] of the losses of motor and friction that go into the gas.
    """

    kind: ClassVar[str] = "suction_warming"

    discharge_conductance: Float[Array, ""] = quantity(
        "W/K", NONNEGATIVE, default=0.0, doc="UA to the gas that is delivered"
    )
    loss_share: Float[Array, ""] = quantity(
        "", Bound(0.0, 1.0), default=0.0, doc="of motor and friction losses, into the gas"
    )

    def heat(self, comes: GasState, discharge_temperature, mass_flow, loss) -> Float[Array, ""]:
        """[W] Into the gas before the suction valve.

        Args:
            comes: the gas as it comes to the compressor.
            discharge_temperature: [K]
            mass_flow: [kg/s]
            loss: [W] of motor and friction.
        """
        flow = mass_flow * comes.c_p
        share = -jnp.expm1(-self.discharge_conductance / flow)
        return flow * (discharge_temperature - comes.T) * share + self.loss_share * loss


class LaminarGap(Part):
    """A round gap between piston and cylinder; the crankcase has the gas of the suction line.

    Args:
        gap: [m] radial clearance.
        length: [m] of the piston's sealing surface.
        viscosity: [Pa s] of the gas; the fluid's own at its temperature in the cylinder if absent.
        eccentricity: [-] of the piston over the clearance.
    """

    kind: ClassVar[str] = "laminar_gap"

    gap: Float[Array, ""] = quantity("m", NONNEGATIVE, doc="radial clearance", usual=(5e-7, 1e-3))
    length: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="of the sealing surface", usual=(1e-3, 1.0)
    )
    viscosity: Float[Array, ""] | None = quantity(
        "Pa s", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )
    eccentricity: Float[Array, ""] = quantity("", Bound(0.0, 1.0), default=0.0)

    def flow(self, cylinder: Side, crankcase: Side, bore, viscosity) -> Float[Array, ""]:
        """Mass flow out of the cylinder [kg/s].

        Args:
            cylinder: the gas in the cylinder.
            crankcase: the gas behind the piston.
            bore: [m]
            viscosity: [Pa s] of the gas.
        """
        conductance = jnp.pi * bore * self.gap**3 / (12 * viscosity * self.length)
        conductance = conductance * (1 + 1.5 * self.eccentricity**2)
        return conductance * (cylinder.p - crankcase.p) * 0.5 * (cylinder.rho + crankcase.rho)
