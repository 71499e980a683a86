"""The temperature of the wall by a balance of heat."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity

OF_WALL = 2  # states: temperature, and heat gained since the beginning of the revolution
# [W/(m^2 K)] Of the gas, about: how far the wall's temperature moves from one marched revolution to the
# next. The solution does not depend on it.
_USUAL = 500.0


class WallNetwork(Part):
    r"""Thermal conductances from the wall of cylinder and head.

    The temperature of the wall follows from a steady balance of heat over the cycle,

    $$\oint \dot Q_{gas}\,dt + UA_s\oint (T_s - T_w)\,dt + UA_d\oint (T_d - T_w)\,dt
      = UA_a\oint (T_w - T_a)\,dt .$$

    The wall takes heat from the gas in the cylinder and behind the discharge valve, heats that before the
    suction valve, and gives the rest to its surroundings. Its heat capacity is so large that its
    temperature does not vary within a revolution: it is one more unknown, and the heat that it has gained
    in a revolution one more state, which must end at zero.

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
        to_suction = to_discharge = jnp.zeros(())
        if not pair:
            return to_suction, to_discharge
        # in the order of the flow: next to the valve are the last one before it and the first one
        # behind it
        before, behind = pair
        if before.gases:
            to_suction = self.suction_conductance * (wall - before.gases[-1].T)
        if behind.gases:
            to_discharge = self.discharge_conductance * (wall - behind.gases[0].T)
        return to_suction, to_discharge

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
    # the heat of a revolution as a power, over all conductances: by so much the wall would have to
    # be warmer for its balance to close
    step = case.energy_scale * case.speed / (2 * jnp.pi * size * case.suction.T)
    return state.at[-2].add(step * state[-1]).at[-1].set(0.0)
