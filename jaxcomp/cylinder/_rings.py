r"""Gas that passes between the two ends of a double-acting cylinder, past the rings of its piston.

What flows is that of the gap's law between the two gases, $\dot m_{12} = -\dot m_{21}$, with the mean
of their viscosities. It carries the enthalpy of where it comes from; where it reverses, what comes
first is what has just gone, so both count by the weights
$(1 \pm \Delta p/\sqrt{\Delta p^2 + \delta^2})/2$ with $\delta$ a fiftieth of the suction pressure:
the law is smooth, and a reversal past the rings is no event.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..fluid import GasState
from ._cylinder import Case, side_of
from ._piston_end import PistonEnd

_MIXED = 0.02  # [-] of the suction pressure: difference below which the gas of both ends mixes


def past_rings(
    case: Case, inside: GasState, behind: GasState
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Mass [kg/s] out of an end past the rings, and the enthalpy [W] that it carries.

    Args:
        case: of the end.
        inside: its gas.
        behind: that of the other end.
    """
    piston = case.mechanism
    assert isinstance(piston, PistonEnd)
    assert piston.rings is not None
    gap = piston.rings
    viscosity = gap.viscosity
    if viscosity is None:
        fluid = case.cylinder.fluid
        # the mean of both, so that the flow is the same seen from either end
        viscosities = [fluid.transport(gas.T, gas.rho)[0] for gas in (inside, behind)]
        viscosity = 0.5 * (viscosities[0] + viscosities[1])
    flow = gap.flow(side_of(inside), side_of(behind), case.bore, viscosity)
    difference = inside.p - behind.p
    outward = difference / jnp.hypot(difference, _MIXED * case.suction.p)
    enthalpy = 0.5 * ((1 + outward) * inside.h + (1 - outward) * behind.h)
    return flow, flow * enthalpy


def with_ring_flow(
    case: Case, angle, state: Float[Array, " n"], gases: tuple[GasState, GasState], speed=None
) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
    """Shares of the flow past the rings in the rates of mass and temperature, and in the accounts.

    Args:
        case: of the end.
        angle: [rad] its crank angle.
        state: (n,) over its scales.
        gases: in the end and in the other one.
        speed: [rad/s] of the crank, for rates in time; see `_gas_balance.rates`.

    Returns:
        Rates of mass and temperature over their scales, and of mass and enthalpy that leave, in units
        of mass and energy scale.
    """
    inside, behind = gases
    flow, carried = past_rings(case, inside, behind)
    pace = case.speed
    if speed is None:
        pace = case.speed_at(angle)
    # this end leaks to the gas of the other one, which counts the same flow with the opposite sign
    mass_1 = -flow / pace
    energy_1 = inside.T * inside.dp_dT * mass_1 / inside.rho - inside.h * mass_1 - carried / pace
    heat_capacity = state[0] * case.mass_scale * inside.c_v
    slopes = mass_1 / case.mass_scale, energy_1 / (heat_capacity * case.suction.T)
    accounts = -mass_1 / case.mass_scale, carried / (pace * case.energy_scale)
    return jnp.stack(slopes), jnp.stack(accounts)
