"""The lines that a cylinder works between: the gas before its suction and behind its discharge valve."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity, rebuilt
from ..fluid import AbstractFluid, GasState
from ..fluid._real import has_dew_line
from ..piping import Piping
from ._plenum import Plenum
from .suction_warming import SuctionWarming


class SuctionLine(Part):
    """The gas at the suction valve, by pressure and temperature or by a rating point.

    Args:
        pressure: [Pa] absolute.
        temperature: [K] of the gas.
        evaporating: [K] dew temperature, instead of the pressure.
        superheat: [K] above the dew temperature, instead of the gas's temperature.
        heating: [K] from there to the suction valve, in shell and muffler; none if absent. Capacity
            and overall efficiency count from the gas before it, as the standards do.
        warming: a law of that rise, which the periodic state closes; `heating` is then where that begins.
        plenums: between line and valve, in the order of the flow; each with its neck on the side of the
            line. Without any the valve sees the gas of the line.
        piping: pipes between that line and the valves, or the first of the plenums; its pressure is
            constant if absent.

    Raises:
        ValueError: neither or both of a pair.
    """

    kind: ClassVar[str] = "suction_line"

    pressure: Float[Array, ""] | None = quantity(
        "Pa", POSITIVE, default=None, doc="absolute", usual=(1e3, 1e8)
    )
    temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="of the gas", usual=(150.0, 700.0)
    )
    evaporating: Float[Array, ""] | None = quantity(
        "K",
        POSITIVE,
        default=None,
        doc="dew temperature (or mean: `reference`), instead of the pressure",
    )
    superheat: Float[Array, ""] | None = quantity(
        "K", NONNEGATIVE, default=None, doc="above the dew point, instead of the temperature"
    )
    heating: Float[Array, ""] | None = quantity(
        "K", NONNEGATIVE, default=None, doc="from there to the suction valve, in shell and muffler"
    )
    warming: SuctionWarming | None = None
    plenums: tuple[Plenum, ...] = ()
    piping: Piping | None = None

    def __check_init__(self):
        _one_of(self, "pressure", "evaporating")
        _one_of(self, "temperature", "superheat")

    def state(self, fluid: AbstractFluid) -> GasState:
        """The gas at the suction valve."""
        return self.states(fluid)[0]

    def states(self, fluid: AbstractFluid) -> tuple[GasState, GasState]:
        """The gas at the suction valve, and as it comes to the compressor."""
        pressure, dew = _pressure(fluid, self.pressure, self.evaporating, self.superheat)
        temperature = self.temperature
        if temperature is None:
            temperature = dew + self.superheat

        def at(temperature):
            return fluid.state(temperature, fluid.density(temperature, pressure))

        comes = at(temperature)
        if self.heating is None:
            return comes, comes
        return at(temperature + self.heating), comes


class DischargeLine(Part):
    """The gas behind the discharge valve.

    Args:
        pressure: [Pa] absolute.
        condensing: [K] dew temperature, instead of the pressure.
        temperature: [K] of the gas that flows back; that of isentropic compression if absent.
        subcooling: [K] of the liquid before the expansion below the bubble temperature at the pressure,
            for the capacity; none if absent. Without glide that is the condensing temperature.
        liquid_temperature: [K] of that liquid, instead of the subcooling.
        plenums: between valve and line, in the order of the flow; each with its neck on the side of the
            line. Without any the valve sees the pressure of the line.
        piping: pipes between the valves, or the last of the plenums, and that line; its pressure is
            constant if absent.

    Raises:
        ValueError: neither or both of pressure and condensing temperature, or two temperatures of the
            liquid.
    """

    kind: ClassVar[str] = "discharge_line"

    pressure: Float[Array, ""] | None = quantity(
        "Pa", POSITIVE, default=None, doc="absolute", usual=(1e3, 1e8)
    )
    condensing: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="dew temperature, instead of the pressure"
    )
    temperature: Float[Array, ""] | None = quantity(
        "K",
        POSITIVE,
        default=None,
        doc="of gas that flows back; that of isentropic compression if absent",
        usual=(150.0, 700.0),
    )
    subcooling: Float[Array, ""] | None = quantity(
        "K",
        NONNEGATIVE,
        default=None,
        doc="of the liquid before the expansion, below its bubble temperature; none if absent",
    )
    liquid_temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="of that liquid, instead of the subcooling"
    )
    plenums: tuple[Plenum, ...] = ()
    piping: Piping | None = None

    def __check_init__(self):
        _one_of(self, "pressure", "condensing")
        if self.subcooling is not None and self.liquid_temperature is not None:
            raise ValueError("give `subcooling` or `liquid_temperature`, not both.")

    def liquid_enthalpy(self, fluid: AbstractFluid) -> Float[Array, ""]:
        """[J/kg] of the liquid before the expansion, at the pressure of the line.

        Not a number above the critical temperature, where there is no liquid.

        Raises:
            TypeError: a perfect gas, which has no liquid.
        """
        if not has_dew_line(fluid):
            raise TypeError("a cooling capacity needs a real gas with a dew line.")
        pressure = self.pressure
        temperature = self.liquid_temperature
        if pressure is None or temperature is None:
            saturated = fluid.saturation(self.condensing, pressure)
            pressure = saturated.p
            if temperature is None:
                # Below the bubble point: a blend that is at its dew point has only begun to condense.
                subcooling = 0.0 if self.subcooling is None else self.subcooling
                temperature = saturated.T_bubble - subcooling
        # double where: computed at a temperature that has a liquid, or what is no number would
        # enter the derivatives of all other points
        is_liquid = temperature < fluid.critical_temperature
        below = jnp.where(is_liquid, temperature, 0.99 * fluid.critical_temperature)
        return jnp.where(is_liquid, fluid.liquid(below, pressure).h, jnp.nan)

    def states(self, fluid: AbstractFluid, suction: GasState) -> tuple[GasState, GasState]:
        """The gas in the line, and the end of the isentropic compression to its pressure."""
        pressure, _ = _pressure(fluid, self.pressure, self.condensing)
        # gas that flows back is nearly that which was pushed out: without a temperature the end of
        # the isentropic compression stands for it
        isentropic = fluid.at_entropy(pressure, suction.s, suction)
        if self.temperature is None:
            return isentropic, isentropic
        temperature = self.temperature
        return fluid.state(temperature, fluid.density(temperature, pressure)), isentropic


def by_dew_points(
    fluid: AbstractFluid, suction: SuctionLine, discharge: DischargeLine
) -> tuple[SuctionLine, DischargeLine]:
    """Lines whose evaporating and condensing temperatures are dew temperatures, from mean ones.

    Args:
        fluid: of the lines, with a dew line.
        suction: with the mean temperature of the evaporator.
        discharge: with the mean temperature of the condenser.
    """
    if not has_dew_line(fluid):
        raise TypeError("mean temperatures of heat exchangers need a real gas with a dew line.")
    # the condenser first: the quality of what enters the evaporator, and so its mean temperature,
    # follows from the liquid that leaves the condenser
    if discharge.condensing is not None:
        discharge = rebuilt(discharge, condensing=fluid.dew_of_mean(discharge.condensing))
    if suction.evaporating is not None:
        liquid = discharge.liquid_enthalpy(fluid)
        evaporating = fluid.dew_of_evaporator(suction.evaporating, liquid)
        suction = rebuilt(suction, evaporating=evaporating)
    return suction, discharge


def _pressure(fluid, pressure, dew, superheat=None):
    """Pressure and dew temperature; the latter only where it is needed."""
    # saturation only where something needs it: above the critical pressure there is none
    if pressure is None or superheat is not None:
        if not has_dew_line(fluid):
            raise ValueError("a rating point by dew temperatures needs a real gas with a dew line.")
        if pressure is None:
            saturation = fluid.saturation(T=dew)
            return saturation.p, saturation.T
        saturation = fluid.saturation(p=pressure)
        return saturation.p, saturation.T
    return pressure, None


def _one_of(part: Part, first: str, second: str) -> None:
    if (getattr(part, first) is None) == (getattr(part, second) is None):
        raise ValueError(f"`{type(part).__name__}` takes one of `{first}` and `{second}`.")
