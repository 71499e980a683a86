"""Where the electric power of a compressor with valves goes."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.results import Data, Result
from ..compressor import Compressor
from ._orbit import Orbit

# What the power of a compressor with valves is spent on.
POWER = (
    "isentropic",
    "suction_heating",
    "suction_valve",
    "discharge_valve",
    "leakage",
    "heating",
    "friction",
    "motor",
)


class Performance(Result, eqx.Module):
    """What a compressor with valves does for its power.

    Attributes:
        electric_power: [W] of the motor; its shaft power where the motor has no `losses`.
        motor_efficiency: [-] shaft power over electric power; 1 without `losses`.
        overall_efficiency: [-] isentropic power, from the gas that comes to the compressor to the
            pressure of the discharge line, over electric power.
        power: [W] by what it is spent on; the values add up to the electric power.
        orbit: where the rest stands.
    """

    electric_power: Float[Array, ""]
    motor_efficiency: Float[Array, ""]
    overall_efficiency: Float[Array, ""]
    power: dict[str, Float[Array, ""]]
    orbit: Orbit

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield Data("electric_power", "W", self.electric_power)
        for name in ("motor_efficiency", "overall_efficiency"):
            yield Data(name, "", getattr(self, name))
        if self.orbit.cycle and hasattr(self.orbit.cycle.case.cylinder.fluid, "saturation"):
            yield Data("cop", "", self.cop)
        for cause, value in self.power.items():
            yield Data(f"power_use.{cause}", "W", value)

    @property
    def cop(self) -> Float[Array, ""]:
        """[-] Cooling capacity over electric power."""
        assert self.orbit.cycle is not None
        return self.orbit.cycle.capacity / self.electric_power


def performance(compressor: Compressor, orbit: Orbit) -> Performance:
    """Efficiencies and powers of a solved orbit.

    Args:
        compressor: whose gas is a `Cylinder`.
        orbit: its periodic state.
    """
    cycle, losses = orbit.cycle, compressor.motor.losses
    assert cycle is not None
    work, case = cycle.work_losses, cycle.case
    isentropic = work["isentropic"] * cycle.frequency
    before = jnp.zeros(())
    if case.cylinder.suction.heating is not None:
        fluid, comes = case.cylinder.fluid, case.comes
        rise = fluid.at_entropy(case.discharge.p, comes.s, comes).h - comes.h
        before, isentropic = isentropic, cycle.mass_flow * rise
        before -= isentropic
    shaft = orbit.motor_power
    electric = shaft
    if losses is not None:
        electric = shaft / losses.at(shaft / orbit.mean_speed) + losses.fixed_power
    efficiency = shaft / (electric + (electric == 0))
    valves = [work[f"{valve} valve"] * cycle.frequency for valve in ("suction", "discharge")]
    known = [isentropic, before, *valves, work["leakage"] * cycle.frequency]
    # the orbit's quadrature of the gas work, so that the sum is exact
    rest = orbit.gas_power - sum(known, start=jnp.zeros(()))
    # and what the energy of the orbit leaves open counts as friction
    shares = (*known, rest, shaft - orbit.gas_power, electric - shaft)
    overall = isentropic / (electric + (electric == 0))
    return Performance(electric, efficiency, overall, dict(zip(POWER, shares, strict=True)), orbit)
