"""The cylinder as a part of the machine: gas, valves, heat, leakage, and the lines it works between."""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, POSITIVE, Part, is_traced, quantity
from ..fluid import AbstractFluid, GasState, RealGas
from ..gas import AbstractGas
from ..mechanism import AbstractMechanism
from ..valve import AbstractValve, Side
from ._heat import AbstractHeat, LaminarGap, WallNetwork
from ._plenum import Plenum


class SuctionLine(Part):
    """The gas at the suction valve, by pressure and temperature or by a rating point.

    Args:
        pressure: [Pa] absolute.
        temperature: [K] of the gas.
        evaporating: [K] dew temperature, instead of the pressure.
        superheat: [K] above the dew temperature, instead of the gas's temperature.
        heating: [K] from there to the suction valve, in shell and muffler; none if absent. Capacity
            and overall efficiency count from the gas before it, as the standards do.
        plenums: between line and valve, in the order of the flow; each with its neck on the side of the
            line. Without any the valve sees the gas of the line.

    Raises:
        ValueError: neither or both of a pair.
    """

    kind: ClassVar[str] = "suction_line"

    pressure: Float[Array, ""] | None = quantity("Pa", POSITIVE, default=None, doc="absolute")
    temperature: Float[Array, ""] | None = quantity("K", POSITIVE, default=None, doc="of the gas")
    evaporating: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="dew temperature, instead of the pressure"
    )
    superheat: Float[Array, ""] | None = quantity(
        "K", NONNEGATIVE, default=None, doc="above the dew point, instead of the temperature"
    )
    heating: Float[Array, ""] | None = quantity(
        "K", NONNEGATIVE, default=None, doc="from there to the suction valve, in shell and muffler"
    )
    plenums: tuple[Plenum, ...] = ()

    def __check_init__(self):
        _one_of(self, "pressure", "evaporating")
        _one_of(self, "temperature", "superheat")

    def state(self, fluid: AbstractFluid) -> GasState:
        """The gas at the suction valve."""
        return self.states(fluid)[0]

    def states(self, fluid: AbstractFluid) -> tuple[GasState, GasState]:
        """The gas at the suction valve, and as it comes to the compressor."""
        pressure, dew = _pressure(fluid, self.pressure, self.evaporating, self.superheat)
        temperature = dew + self.superheat if self.temperature is None else self.temperature

        def at(temperature):
            return fluid.state(temperature, fluid.density(temperature, pressure))

        comes = at(temperature)
        return (comes if self.heating is None else at(temperature + self.heating)), comes


class DischargeLine(Part):
    """The gas behind the discharge valve.

    Args:
        pressure: [Pa] absolute.
        condensing: [K] dew temperature, instead of the pressure.
        temperature: [K] of the gas that flows back; that of isentropic compression if absent.
        subcooling: [K] of the liquid before the expansion below the condensing temperature, for the
            capacity; none if absent.
        liquid_temperature: [K] of that liquid, instead of the subcooling.
        plenums: between valve and line, in the order of the flow; each with its neck on the side of the
            line. Without any the valve sees the pressure of the line.

    Raises:
        ValueError: neither or both of pressure and condensing temperature, or two temperatures of the
            liquid.
    """

    kind: ClassVar[str] = "discharge_line"

    pressure: Float[Array, ""] | None = quantity("Pa", POSITIVE, default=None, doc="absolute")
    condensing: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="dew temperature, instead of the pressure"
    )
    temperature: Float[Array, ""] | None = quantity(
        "K",
        POSITIVE,
        default=None,
        doc="of gas that flows back; that of isentropic compression if absent",
    )
    subcooling: Float[Array, ""] | None = quantity(
        "K", NONNEGATIVE, default=None, doc="of the liquid before the expansion; none if absent"
    )
    liquid_temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="of that liquid, instead of the subcooling"
    )
    plenums: tuple[Plenum, ...] = ()

    def __check_init__(self):
        _one_of(self, "pressure", "condensing")
        if self.subcooling is not None and self.liquid_temperature is not None:
            raise ValueError("give `subcooling` or `liquid_temperature`, not both.")

    def liquid_enthalpy(self, fluid: AbstractFluid) -> Float[Array, ""]:
        """[J/kg] of the saturated liquid at the temperature before the expansion.

        Raises:
            TypeError: a perfect gas, which has no liquid.
        """
        if not isinstance(fluid, RealGas):
            raise TypeError("a cooling capacity needs a real gas.")
        temperature = self.liquid_temperature
        if temperature is None:
            less = 0.0 if self.subcooling is None else self.subcooling
            if self.condensing is None:
                temperature = fluid.saturation(p=self.pressure).T - less
            else:
                temperature = self.condensing - less
        liquid = fluid.saturation(T=temperature)
        return fluid.state(liquid.T, liquid.liquid).h

    def states(self, fluid: AbstractFluid, suction: GasState) -> tuple[GasState, GasState]:
        """The gas in the line, and the end of the isentropic compression to its pressure."""
        pressure, _ = _pressure(fluid, self.pressure, self.condensing)
        isentropic = fluid.at_entropy(pressure, suction.s, suction)
        if self.temperature is None:
            return isentropic, isentropic
        temperature = self.temperature
        return fluid.state(temperature, fluid.density(temperature, pressure)), isentropic


class Cylinder(AbstractGas):
    """What a compressor's cylinder does to its gas, besides the piston's motion.

    Its pressure is a state, not a function of the stroke: `solve_orbit` solves it with the crank's
    motion, `solve_cycle` at a given speed.

    Args:
        fluid: the gas.
        suction: the line before the suction valve.
        discharge: the line behind the discharge valve.
        suction_valve: into the cylinder.
        discharge_valve: out of the cylinder.
        clearance_ratio: [-] clearance volume over swept volume.
        wall_temperature: [K] of cylinder, head and piston; needed for heat transfer. With `walls` the
            guess of the periodic state, and what a run in time holds.
        heat: correlation of the heat transfer; adiabatic if absent.
        leakage: past the piston; tight if absent.
        walls: conductances that decide the wall's temperature; `wall_temperature` holds if absent.

    Raises:
        ValueError: heat transfer without a wall temperature, walls without heat transfer, or a
            conductance to a plenum that is not there.
    """

    kind: ClassVar[str] = "cylinder"
    of_whole_machine: ClassVar[bool] = True

    fluid: AbstractFluid
    suction: SuctionLine
    discharge: DischargeLine
    suction_valve: AbstractValve
    discharge_valve: AbstractValve
    clearance_ratio: Float[Array, ""] = quantity("", POSITIVE, doc="clearance over swept volume")
    wall_temperature: Float[Array, ""] | None = quantity("K", POSITIVE, default=None)
    heat: AbstractHeat | None = None
    leakage: LaminarGap | None = None
    walls: WallNetwork | None = None

    def __check_init__(self):
        if self.walls is not None:
            if self.heat is None:
                raise ValueError("`walls` need a `heat`, by which the gas reaches them.")
            for name, line in (("suction", self.suction), ("discharge", self.discharge)):
                given = getattr(self.walls, f"{name}_conductance")
                if not line.plenums and not is_traced(given) and bool(given != 0):
                    raise ValueError(f"`walls.{name}_conductance` needs `{name}.plenums`.")
        if self.heat is not None and self.wall_temperature is None:
            raise ValueError("heat transfer needs a `wall_temperature`.")

    def pressure(self, stroke):
        raise TypeError(
            "The pressure of a cylinder with valves depends on the whole revolution: solve the orbit "
            "and take `orbit.pressure` or `orbit.cycle`."
        )

    @property
    def behind_piston(self):
        return self.suction.state(self.fluid).p

    @property
    def valves(self) -> tuple[AbstractValve, AbstractValve]:
        """Suction and discharge valve."""
        return self.suction_valve, self.discharge_valve

    @property
    def plenums(self) -> tuple[Plenum, ...]:
        """Those before the suction valve, then those behind the discharge valve."""
        return (*self.suction.plenums, *self.discharge.plenums)

    @property
    def inert(self) -> bool:
        """Whether the gas in both ports has inertia, so that reversals are events."""
        return all(valve.port_length is not None for valve in self.valves)


class Line(NamedTuple):
    """A line with its temperature [K]."""

    side: Side
    temperature: Float[Array, ""]


class Case(eqx.Module):
    """A cylinder on its mechanism at a speed, with everything that is constant over a revolution."""

    cylinder: Cylinder  # the gas side
    mechanism: AbstractMechanism  # the piston's motion
    speed: Float[Array, ""]  # [rad/s] mean speed of the crank
    # [-] harmonics over the crank angle of the time that an angle takes, relative to its mean; `None`
    # at constant speed
    cosine: Float[Array, " k"] | None
    sine: Float[Array, " k"] | None
    # the gas at the two valves
    suction: GasState
    discharge: GasState
    isentropic: GasState  # end of the isentropic compression between the lines
    comes: GasState  # the gas as it comes to the compressor, before it is heated
    top: Float[Array, ""]  # [m] piston position at the top dead centre
    swept: Float[Array, ""]  # [m^3] swept volume

    @property
    def mass_scale(self) -> Float[Array, ""]:
        """[kg] of the full cylinder at suction."""
        return self.suction.rho * self.swept

    @property
    def energy_scale(self) -> Float[Array, ""]:
        """[J] p_s V_s."""
        return self.suction.p * self.swept

    @property
    def bore(self) -> Float[Array, ""]:
        """[m] of a round piston of that area."""
        return jnp.sqrt(4 / jnp.pi * self.mechanism.piston_area)

    def speed_at(self, angle: Float[Array, ""]) -> Float[Array, ""]:
        """[rad/s]"""
        if self.cosine is None or self.sine is None:
            return self.speed + 0 * angle
        phase = angle * jnp.arange(1, self.cosine.size + 1)
        return self.speed / (1 + jnp.cos(phase) @ self.cosine + jnp.sin(phase) @ self.sine)

    def volume(self, angle: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Volume [m^3] and its rate over the crank angle [m^3/rad]."""
        position, position_1, _ = self.mechanism.piston(angle)
        area = self.mechanism.piston_area
        clearance = self.cylinder.clearance_ratio * self.swept
        return area * (self.top - position) + clearance, -area * position_1


def prepare(cylinder: Cylinder, mechanism, speed, fluctuation=None) -> Case:
    """Work out the states of the lines and what else is constant.

    Args:
        cylinder: the gas side.
        mechanism: an `AbstractMechanism`.
        speed: [rad/s] mean speed of the crank.
        fluctuation: cosine and sine harmonics, from the first on, of the time that an angle takes,
            relative to its mean; constant speed if absent.
    """
    suction, comes = cylinder.suction.states(cylinder.fluid)
    discharge, isentropic = cylinder.discharge.states(cylinder.fluid, suction)
    top, _ = mechanism.piston_extremes()
    cosine, sine = (None, None) if fluctuation is None else fluctuation
    return Case(
        cylinder,
        mechanism,
        jnp.asarray(speed, float),
        cosine,
        sine,
        suction,
        discharge,
        isentropic,
        comes,
        top,
        mechanism.swept_volume,
    )


def side_of(state: GasState) -> Side:
    """A gas as one side of a port."""
    return Side(state.p, state.rho, state.kappa, state.h)


def _pressure(fluid, pressure, dew, superheat=None):
    """Pressure and dew temperature; the latter only where it is needed."""
    if pressure is None or superheat is not None:
        if not isinstance(fluid, RealGas):
            raise ValueError("a rating point by dew temperatures needs a real gas.")
        found = fluid.saturation(p=pressure) if pressure is not None else fluid.saturation(T=dew)
        return found.p, found.T
    return pressure, None


def _one_of(part: Part, first: str, second: str) -> None:
    if (getattr(part, first) is None) == (getattr(part, second) is None):
        raise ValueError(f"`{type(part).__name__}` takes one of `{first}` and `{second}`.")
