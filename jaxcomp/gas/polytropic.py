"""The polytropic cycle with ideal valves."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.extremes import clip, maximum, minimum
from .._core.fields import NONNEGATIVE, POSITIVE, Bound, quantity, replaced
from ._gas_law import AbstractGas


class PolytropicCycle(AbstractGas):
    """Suction, polytropic compression, discharge, re-expansion with valves that open at once.

    Compression $p = p_s (V_{max}/V)^n$ up to $p_d$, discharge at $p_d$ to the top dead centre,
    re-expansion $p = p_d (V_c/V)^n$ down to $p_s$, suction at $p_s$ (Tsuji et al. 2012, Section 3.1,
    with a clearance volume added). A clearance so large that the compression never reaches $p_d$
    leaves a closed cycle without flow and without work.

    Args:
        suction_pressure: [Pa] absolute.
        discharge_pressure: [Pa] absolute.
        exponent: [-] of compression and re-expansion; 1 is isothermal.
        clearance_ratio: [-] clearance volume over swept volume.
        back_pressure: [Pa] absolute, behind the piston; the suction pressure if absent.
        inlet_temperature: [K] of the gas that comes; with it the mass delivered and its temperature are
            known.
        gas_constant: [J/(kg K)] specific; of air if absent.
    """

    kind: ClassVar[str] = "polytropic"
    for_each_cylinder: ClassVar[bool] = True

    suction_pressure: Float[Array, ""] = quantity("Pa", POSITIVE, doc="absolute", usual=(1e3, 2e7))
    discharge_pressure: Float[Array, ""] = quantity(
        "Pa", POSITIVE, doc="absolute", usual=(1e4, 1e8)
    )
    exponent: Float[Array, ""] = quantity(
        "", Bound(1.0, 3.0), doc="1 is isothermal", usual=(1.0, 1.7)
    )
    clearance_ratio: Float[Array, ""] = quantity(
        "", NONNEGATIVE, default=0.0, doc="clearance volume over swept volume", usual=(1e-3, 0.3)
    )
    back_pressure: Float[Array, ""] | None = quantity(
        "Pa",
        NONNEGATIVE,
        default=None,
        doc="behind the piston; the suction pressure if absent",
        usual=(1e3, 2e7),
    )
    inlet_temperature: Float[Array, ""] | None = quantity(
        "K",
        POSITIVE,
        default=None,
        doc="of the gas that comes, for what is delivered",
        usual=(200.0, 400.0),
    )
    gas_constant: Float[Array, ""] = quantity(
        "J/(kg K)", POSITIVE, default=287.05, doc="specific, of air if absent", usual=(20.0, 4200.0)
    )

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        compresses = self.discharge_pressure > self.suction_pressure
        return {"a cycle with discharge_pressure > suction_pressure": compresses}

    def repaired(self):
        suction = self.suction_pressure
        discharge = self.discharge_pressure
        return replaced(
            self, discharge_pressure=jnp.where(discharge > suction, discharge, 1.001 * suction)
        )

    @property
    def behind_piston(self):
        return self.suction_pressure if self.back_pressure is None else self.back_pressure

    @property
    @eqx.filter_jit  # one program where it is asked outside of others
    def delivers(self) -> Bool[Array, ""]:
        """Whether the compression reaches the discharge pressure, so that gas flows."""
        return 1 + self.clearance_ratio > self.clearance_ratio * self._opening

    @property
    def filling(self) -> Float[Array, ""]:
        """[-] Volume drawn, at the state of the inlet, over swept volume: 1 + c - c r^(1/n)."""
        clearance = self.clearance_ratio
        return maximum(1 + clearance - clearance * self._opening, 0.0)

    @property
    def _opening(self) -> Float[Array, ""]:
        """[-] Volume ratio at which the discharge valve opens."""
        return (self.discharge_pressure / self.suction_pressure) ** (1 / self.exponent)

    def pressure(self, stroke):
        clearance = self.clearance_ratio * stroke.swept
        largest = clearance + stroke.swept
        # At the top dead centre of a machine without clearance the volume is zero: there the
        # compression stroke is limited by p_d and the re-expansion is over at once.
        volume = maximum(clearance + stroke.displaced, 1e-30 * stroke.swept)
        opening = self._opening
        # Ratios of volumes are limited in the place of pressures, so that one power serves both
        # strokes.
        compressed = minimum(largest / volume, opening)
        # Re-expansion starts from what the compression has reached, p_d or less.
        top = minimum(largest / maximum(clearance, 1e-30 * stroke.swept), opening)
        expanded = maximum(top * clearance / volume, 1.0)
        return self.suction_pressure * (
            jnp.where(stroke.inward > 0, compressed, expanded) ** self.exponent
        )

    def valve_events(self, swept):
        clearance = self.clearance_ratio * swept
        opening = self._opening
        largest = clearance + swept
        # Where nothing is delivered both are at the dead centres, which are ends of panels anyway.
        discharge = clip(largest / opening - clearance, 0.0, swept)
        suction = clip(clearance * opening - clearance, 0.0, swept)
        return (discharge, True), (suction, False)
