r"""Delivery of simple cycles with ideal valves: free air, mass, temperature, pressures between stages.

Every chamber draws $V (1 + c - c\,r^{1/n})$ of the gas that comes in a revolution, with its swept volume
V, clearance ratio c and pressure ratio r. Compression along $p V^n$ heats the gas by $r^{(n-1)/n}$;
between stages it is cooled to the inlet temperature. Gas is ideal.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compressor import Compressor, piston_strokes
from ..gas import DoubleActing, StagedCycle


class IdealDelivery(NamedTuple):
    """Delivery of a machine with polytropic cycles.

    Attributes:
        free_air: [m^3/s] drawn, at the pressure and temperature of the inlet.
        volumetric_efficiency: [-] volume drawn over the swept volume of the first stage.
        mass_flow: [kg/s]; not a number without an inlet temperature.
        temperature: [K] of the gas that the last stage delivers; not a number likewise.
        stage_pressures: [Pa] between the stages, by the number of the stage before.
    """

    free_air: Float[Array, ""]
    volumetric_efficiency: Float[Array, ""]
    mass_flow: Float[Array, ""]
    temperature: Float[Array, ""]
    stage_pressures: dict[str, Float[Array, ""]]


def ideal_delivery(compressor: Compressor, given: Any, speed: Float[Array, ""]) -> IdealDelivery:
    """Delivery of a machine whose gas is polytropic, double-acting or staged.

    Args:
        compressor: put together: stages have their pressures.
        given: the gas as the machine has it.
        speed: [rad/s] mean.
    """
    gas: Any = compressor.gas
    count = compressor.crankshaft.count
    area, stroke = piston_strokes(compressor)
    swept = jnp.broadcast_to(area * stroke, (count,))
    chambers = [(gas, swept)]
    if isinstance(gas, DoubleActing):
        rod = jnp.pi / 4 * gas.rod_diameter**2 * stroke
        chambers = [(gas.head_end, swept), (gas.crank_end, swept - rod)]
    stages = jnp.ones(count, int)
    last = 1
    pressures = {}
    ends = given.head_end if isinstance(given, DoubleActing) else given
    if isinstance(given, StagedCycle):
        stages = jnp.asarray(given.stages)
        last = max(given.stages)
        between = given.between(area, stroke)
        pressures = {str(stage): between[stage] for stage in range(1, last)}
    first = stages == 1
    volume = jnp.sum(jnp.stack([jnp.where(first, size, 0.0) for _, size in chambers]))
    drawn = jnp.sum(
        jnp.stack([jnp.where(first, cycle.filling * size, 0.0) for cycle, size in chambers])
    )
    free_air = drawn * speed / (2 * jnp.pi)
    mass = jnp.full((), jnp.nan)
    hot = jnp.full((), jnp.nan)
    if ends.inlet_temperature is not None:
        # of several lines the first cylinder's gas
        warm, constant = (jnp.ravel(x)[0] for x in (ends.inlet_temperature, ends.gas_constant))
        pressure = jnp.broadcast_to(chambers[0][0].suction_pressure, (count,))
        density = pressure / (constant * warm)
        each = [jnp.where(first, cycle.filling * size * density, 0.0) for cycle, size in chambers]
        mass = jnp.sum(jnp.stack(each)) * speed / (2 * jnp.pi)
        cycle = chambers[0][0]
        ratio = cycle.discharge_pressure / cycle.suction_pressure
        heated = jnp.broadcast_to(ratio ** (1 - 1 / cycle.exponent), (count,))
        hot = warm * jnp.max(jnp.where(stages == last, heated, 0.0))
    return IdealDelivery(free_air, drawn / volume, mass, hot, pressures)
