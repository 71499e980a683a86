"""Suction gas that a law warms: its rise follows from flow, heat and losses, and they from it.

The rise is one more unknown beside the motion of the crank. Repeated as it comes it would contract by
what a degree more of it adds to itself, 0.1 to 0.5; divided by that it contracts by 0.05 at most.
"""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.fields import replaced
from ..compressor import Compressor
from ..cylinder import Cylinder, SuctionWarming
from ._orbit import Orbit, performance

# [K] At the beginning, where the line says nothing.
_FIRST = 15.0
# [K] Most that a law may give, within the range of the fluids; there nothing counts as solved.
LARGEST_RISE = 200.0


def law_of(compressor: Compressor) -> SuctionWarming | None:
    """The law of the rise of the suction gas, if there is one."""
    gas = compressor.gas
    return gas.suction.warming if isinstance(gas, Cylinder) else None


def first_rise(compressor: Compressor) -> Float[Array, ""] | None:
    """[K] Where the law begins; `None` without one."""
    gas = compressor.gas
    if not isinstance(gas, Cylinder) or gas.suction.warming is None:
        return None
    return jnp.asarray(_FIRST if gas.suction.heating is None else gas.suction.heating, float)


def at_rise(compressor: Compressor, rise: Float[Array, ""] | None) -> Compressor:
    """The compressor with a constant rise [K] instead of the law; as it is for `None`."""
    gas = compressor.gas
    if rise is None or not isinstance(gas, Cylinder):
        return compressor
    suction = replaced(gas.suction, warming=None, heating=rise)
    return replaced(compressor, gas=replaced(gas, suction=suction))


def next_rise(compressor: Compressor, orbit: Orbit, rise):
    """[K] Nearer to the rise that follows from itself, which it leaves as it is.

    Args:
        compressor: with the law, or without.
        orbit: its periodic state at the rise.
        rise: [K], or `None` without a law.
    """
    law, cycle = law_of(compressor), orbit.cycle
    if law is None or cycle is None:
        return None
    here = at_rise(compressor, rise)
    gas = here.gas
    assert isinstance(gas, Cylinder)
    comes, hot = cycle.case.comes, cycle.discharge_temperature
    flow = jnp.maximum(cycle.mass_flow, 1e-9 * cycle.case.mass_scale)
    loss = performance(here, orbit).electric_power - orbit.gas_power
    heat = law.heat(comes, hot, flow, loss)
    heat = jnp.clip(heat, 0.0, LARGEST_RISE * flow * comes.c_p)
    new = gas.fluid.at_enthalpy(comes.p, comes.h + heat / flow, comes).T - comes.T
    # compression multiplies temperatures, and the flow goes with one over that at the valve
    warm = comes.T + rise
    own = (law.heat(comes, hot, flow, 0.0) / (hot - comes.T) * hot + heat) / (flow * comes.c_p)
    slope = lax.stop_gradient(jnp.clip(own / warm, 0.0, 0.8))
    return jnp.clip(rise + (new - rise) / (1 - slope), 0.0, LARGEST_RISE)
