r"""Delivery of simple cycles with ideal valves: free air, mass, temperature, pressures between stages.

Every chamber draws $V (1 + c - c\,r^{1/n})$ of the gas that comes in a revolution, with its swept volume
V, clearance ratio c and pressure ratio r. Compression along $p V^n$ heats the gas by $r^{(n-1)/n}$;
between stages it is cooled to the inlet temperature. Gas is ideal.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import max_of
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


def ideal_delivery(
    compressor: Compressor, machine_gas: Any, speed: Float[Array, ""]
) -> IdealDelivery:
    """Delivery of a machine whose gas is polytropic, double-acting or staged.

    Args:
        compressor: put together: stages have their pressures.
        machine_gas: the gas as the machine has it.
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
    last_stage = 1
    pressures = {}
    ends = machine_gas
    if isinstance(machine_gas, DoubleActing):
        ends = machine_gas.head_end
    if isinstance(machine_gas, StagedCycle):
        stages = jnp.asarray(machine_gas.stages)
        last_stage = max(machine_gas.stages)
        between = machine_gas.between(area, stroke)
        pressures = {str(stage): between[stage] for stage in range(1, last_stage)}
    first = stages == 1

    def of_first_stage(amounts):
        return jnp.sum(jnp.where(first, jnp.stack(amounts), 0.0))

    volume = of_first_stage([size for _, size in chambers])
    drawn = of_first_stage([cycle.filling * size for cycle, size in chambers])
    free_air = drawn * speed / (2 * jnp.pi)
    mass = jnp.full((), jnp.nan)
    hot = jnp.full((), jnp.nan)
    if ends.inlet_temperature is not None:
        # of several lines the first cylinder's gas
        inlet = jnp.ravel(ends.inlet_temperature)[0]
        constant = jnp.ravel(ends.gas_constant)[0]
        pressure = jnp.broadcast_to(chambers[0][0].suction_pressure, (count,))
        density = pressure / (constant * inlet)
        masses = []
        for cycle, size in chambers:
            masses.append(cycle.filling * size * density)
        mass = of_first_stage(masses) * speed / (2 * jnp.pi)
        cycle = chambers[0][0]
        ratio = cycle.discharge_pressure / cycle.suction_pressure
        heated = jnp.broadcast_to(ratio ** (1 - 1 / cycle.exponent), (count,))
        hot = inlet * max_of(jnp.where(stages == last_stage, heated, 0.0))
    return IdealDelivery(
        free_air=free_air,
        volumetric_efficiency=drawn / volume,
        mass_flow=mass,
        temperature=hot,
        stage_pressures=pressures,
    )
