"""Where the electric power of a compressor with valves goes: its uses, and the heat that it becomes."""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.declared import computed, held, reading
from .._core.extremes import maximum
from .._core.results import Data, Result
from ..compressor import Compressor
from ..cylinder import Cycle, Cylinder, SuctionWarming
from ..cylinder._several import SeveralCycles
from ..fluid import GasState
from ._orbit import Orbit

# What the power of a compressor with valves is spent on.
POWER = (
    "isentropic",
    "suction_heating",
    "suction_valve",
    "discharge_valve",
    "suction_piping",
    "discharge_piping",
    "leakage",
    "heating",
    "friction",
    "motor",
)


class Performance(Result, eqx.Module):
    """Yield of a compressor with valves for its power.

    Attributes:
        electric_power: [W] of the motor; its shaft power where the motor has no `losses`.
        motor_efficiency: [-] shaft power over electric power; 1 without `losses`.
        overall_efficiency: [-] isentropic power, from the gas that comes to the compressor to the
            pressure of the discharge line, over electric power.
        power: [W] by what it is spent on; the values add up to the electric power.
        heat: [W] by where it goes; the balance of energy of the whole machine. `refrigerant` is the mass
            flow times the rise of the enthalpy from the gas that comes to the gas behind the discharge
            valve, less what a law of warming takes from that. `surroundings` has the losses that do not
            warm the gas, what the gas gives to the wall, and the heat that leaked gas brings back where
            no law warms the suction gas with it, less a constant `heating`; negative where the shell has
            to be warmed.
        orbit: where the rest stands.
    """

    electric_power: Float[Array, ""] = reading("W")
    motor_efficiency: Float[Array, ""] = reading("")
    overall_efficiency: Float[Array, ""] = reading("")
    power: dict[str, Float[Array, ""]] = reading("W", key="power_use")
    heat: dict[str, Float[Array, ""]] = reading("W", key="heat_to")
    orbit: Orbit = held()

    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from self.data_of("electric_power", "motor_efficiency", "overall_efficiency")
        if self.orbit.cycle and self.orbit.cycle.case.cylinder.refrigerates:
            yield from self.data_of("cop")
        yield from self.members_of("power", "heat")
        yield from self.data_of("heat_closure")

    @computed("")
    def cop(self) -> Float[Array, ""]:
        """[-] Cooling capacity over electric power."""
        assert self.orbit.cycle is not None
        return self.orbit.cycle.capacity / self.electric_power

    @computed("")
    def heat_closure(self) -> Float[Array, ""]:
        """[-] Electric power that neither refrigerant nor surroundings gain as heat, over itself.

        The errors of the cycle's energy and of the gas's work on the crank's panels; 1e-10 as a rule.
        """
        power = self.electric_power
        return (power - sum(self.heat.values(), start=jnp.zeros(()))) / (power + (power == 0))


def law_of(compressor: Compressor) -> SuctionWarming | None:
    """The law of the rise of the suction gas, if there is one."""
    gas = compressor.gas
    if not isinstance(gas, Cylinder):
        return None
    return gas.suction.warming


def electric_power(compressor: Compressor, orbit: Orbit) -> Float[Array, ""]:
    """[W] Of the motor of a solved orbit; its shaft power where it has no `losses`."""
    losses = compressor.motor.losses
    shaft = orbit.motor_power
    if losses is None:
        return shaft
    return shaft / losses.at(shaft / orbit.mean_speed) + losses.fixed_power


def flow_of_gas(cycle: Cycle | SeveralCycles) -> Float[Array, ""]:
    """[kg/s] delivered, above zero so that heat can be taken over it."""
    return maximum(cycle.mass_flow, 1e-9 * cycle.case.mass_scale)


def compressed_as_it_comes(cycle: Cycle | SeveralCycles) -> GasState:
    """The gas as it comes to the compressor after isentropic compression to the discharge line."""
    case = cycle.case
    return case.cylinder.fluid.at_entropy(case.discharge.p, case.comes.s, case.comes)


def performance(compressor: Compressor, orbit: Orbit) -> Performance:
    """Efficiencies and powers of a solved orbit.

    Args:
        compressor: whose gas is a `Cylinder`.
        orbit: its periodic state.
    """
    cycle = orbit.cycle
    assert cycle is not None
    work = cycle.work_losses
    case = cycle.case
    isentropic = work["isentropic"] * cycle.frequency
    before = jnp.zeros(())
    if case.cylinder.suction.heating is not None:
        # an ideal machine compresses the gas as it comes: what its heating adds to the work is a loss
        rise = compressed_as_it_comes(cycle).h - case.comes.h
        before = isentropic
        isentropic = cycle.mass_flow * rise
        before -= isentropic
    shaft = orbit.motor_power
    electric = electric_power(compressor, orbit)
    efficiency = shaft / (electric + (electric == 0))
    valves = [work[f"{valve} valve"] * cycle.frequency for valve in ("suction", "discharge")]
    sides = ("suction", "discharge")
    pipes = [work[f"{side} piping"] * cycle.frequency for side in sides if f"{side} piping" in work]
    accounted = [isentropic, before, *valves, *pipes, work["leakage"] * cycle.frequency]
    # the orbit's quadrature of the gas work, so that the sum is exact
    unaccounted = orbit.gas_power - sum(accounted, start=jnp.zeros(()))
    # and what the energy of the orbit leaves open counts as friction
    shares = (*accounted, unaccounted, shaft - orbit.gas_power, electric - shaft)
    names = [name for name in POWER if pipes or not name.endswith("_piping")]
    overall = isentropic / (electric + (electric == 0))
    return Performance(
        electric_power=electric,
        motor_efficiency=efficiency,
        overall_efficiency=overall,
        power=dict(zip(names, shares, strict=True)),
        heat=_heat(compressor, cycle, electric - orbit.gas_power),
        orbit=orbit,
    )


def _heat(
    compressor: Compressor, cycle: Cycle | SeveralCycles, loss
) -> dict[str, Float[Array, ""]]:
    """[W] Heat by where it goes, of a machine with losses [W] of motor and friction.

    Every part is summed by itself, so that they add up to the electric power only where the gas keeps
    its energy and a law of warming is met.
    """
    case = cycle.case
    law = law_of(compressor)
    coolers = {}
    if isinstance(cycle, SeveralCycles) and cycle.stages:
        cooled = cycle.cooler_heat
        gained = _over_suction(cycle, "discharge_heat", "discharge") - cooled
        coolers = {"coolers": cooled * cycle.frequency}
    else:
        gained = cycle.totals.discharge_heat - cycle.totals.discharge * case.comes.h
    refrigerant = gained * cycle.frequency
    if law is None:
        warmed = cycle.mass_flow * (case.suction.h - case.comes.h)
    else:
        compressed = compressed_as_it_comes(cycle).T
        refrigerant -= law.from_discharge(case.comes, compressed, flow_of_gas(cycle))
        warmed = law.loss_share * loss + returned_heat(cycle)
    from_gas = _heat_of_leakage(cycle) + _heat_of_back_flow(cycle) - cycle.totals.heat
    return {
        "refrigerant": refrigerant,
        "surroundings": loss + from_gas * cycle.frequency - warmed,
        **coolers,
    }


def _over_suction(cycle: SeveralCycles, heat: str, mass: str) -> Float[Array, ""]:
    """[J] Enthalpy of the gas of an account over that which its stage draws, of all stages."""
    totals = cycle.each.totals
    drawn = cycle.each.case.suction.h
    return jnp.sum(getattr(totals, heat) - getattr(totals, mass) * drawn)


def returned_heat(cycle: Cycle | SeveralCycles) -> Float[Array, ""]:
    """[W] Heat that gas brings back to the suction gas, past the piston or through its valve.

    What flows back through the valve into a plenum stays in the gas of that.
    """
    heat = _heat_of_leakage(cycle)
    if not cycle.case.cylinder.suction.plenums:
        heat += _heat_of_back_flow(cycle)
    return heat * cycle.frequency


def _heat_of_leakage(cycle: Cycle | SeveralCycles) -> Float[Array, ""]:
    """[J] Enthalpy of the gas that leaks past the piston, over that with which it is drawn again."""
    if isinstance(cycle, SeveralCycles) and cycle.stages:
        return _over_suction(cycle, "leakage_heat", "leakage")
    return cycle.totals.leakage_heat - cycle.totals.leakage * cycle.case.suction.h


def _heat_of_back_flow(cycle: Cycle | SeveralCycles) -> Float[Array, ""]:
    """[J] Enthalpy of the gas that goes back to the suction line, over that with which it is drawn again.

    With plenums, less what their gas takes from the wall or is held at a temperature by.
    """
    if isinstance(cycle, SeveralCycles) and cycle.stages:
        return -_over_suction(cycle, "suction_heat", "suction")
    return cycle.totals.suction * cycle.case.suction.h - cycle.totals.suction_heat
