"""Suction gas that a law warms: its rise follows from flow, heat and losses, and they from it.

The rise is one more unknown beside the motion of the crank.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import clip
from .._core.fields import replaced
from ..compressor import Compressor
from ..cylinder import Cylinder
from ._orbit import Orbit
from ._performance import (
    compressed_as_it_comes,
    electric_power,
    flow_of_gas,
    law_of,
    returned_heat,
)

# [K] At the beginning, where the line says nothing.
_FIRST = 15.0
# [K] Most that a law may give, within the range of the fluids; there nothing counts as solved.
LARGEST_RISE = 200.0


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


def rise_after(compressor: Compressor, orbit: Orbit, rise):
    """[K] The rise that follows from the periodic state at another one; `None` without a law.

    Args:
        compressor: with the law, or without.
        orbit: its periodic state at the rise.
        rise: [K], or `None` without a law.
    """
    law = law_of(compressor)
    cycle = orbit.cycle
    if law is None or cycle is None:
        return None
    machine = at_rise(compressor, rise)
    gas = machine.gas
    assert isinstance(gas, Cylinder)
    comes = cycle.case.comes
    flow = flow_of_gas(cycle)
    loss = electric_power(machine, orbit) - orbit.gas_power
    compressed = compressed_as_it_comes(cycle)
    heat = law.heat(comes, compressed.T, flow, loss, returned_heat(cycle))
    # Bounded before the fluid is asked for the state, which may lie beyond its range.
    heat = clip(heat, 0.0, LARGEST_RISE * flow * comes.c_p)
    return gas.fluid.at_enthalpy(comes.p, comes.h + heat / flow, comes).T - comes.T
