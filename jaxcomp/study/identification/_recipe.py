"""What is varied of a machine that is known by its map alone, and what is assumed of it beforehand."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._core.errors import BadInput, kind_text
from ...cylinder import Cylinder
from ...fluid._real import has_dew_line
from ...machine import HasMachine, Machine, machine_of
from .._rules import with_swept_volume
from .._variables import Variable, variable
from ..rating import capacity_rise
from ._common_factor import CommonFactor, varied
from ._readings import Readings

# By path: lowest and highest value over that of the machine, and standard deviation of what is known
# beforehand over it; `None` where nothing is. One speed tells no more.
RECIPE: dict[str, tuple[float, float, float | None]] = {
    "similar_swept_volume": (0.4, 2.5, None),
    "gas.clearance_ratio": (0.2, 4.0, 0.5),
    "motor.losses.efficiency": (0.7, 1.08, 0.05),
    "motor.losses.fixed_power": (0.05, 20.0, 0.5),
    "friction.*.coefficient": (0.05, 20.0, 0.5),
    # a hermetic shell has most of the losses and ten times the conductance of a motor cooled by air
    "gas.suction.warming.loss_share": (0.1, 1.6, 0.8),
    "gas.suction.warming.discharge_conductance": (0.05, 20.0, 1.5),
    "gas.leakage.gap": (0.1, 4.0, 0.8),
    # 0.13 to 2.6 for 0.65, beyond what a port has by itself: the size of the ports is not known either
    "gas.suction_valve.flow_coefficient": (0.2, 4.0, 1.0),
    "gas.discharge_valve.flow_coefficient": (0.2, 4.0, 1.0),
}
# [-] Volumetric efficiency by which the machine gets its size, before anything is fitted.
_FILLING = 0.8


class Recipe(NamedTuple):
    """Recipe of `identify` for a machine that is known by its map alone.

    Attributes:
        machine: similar to the given one, of about the size that the readings want.
        vary: [SI] (low, high) by path.
        prior: [SI] (mean, standard deviation) by path.
    """

    machine: Machine
    vary: dict[str, tuple[float, float]]
    prior: dict[str, tuple[float, float]]


def map_recipe(machine: Machine | HasMachine, readings: Readings | Sequence[Readings]) -> Recipe:
    """Constants to vary of a machine of unknown size, valves and losses that its map is to tell.

    The size follows from the flow at a volumetric efficiency of 0.8; everything else is that of a similar
    machine, with wide priors around it. Numbers that the machine has not are left out.

    Args:
        machine: a machine or a scene, such as the bundled `semi-hermetic-200cc`.
        readings: with capacity or mass flow.

    Raises:
        BadInput: readings without either, or a machine without a real gas.
    """
    design = machine_of(machine)
    compressor = design.as_compressor()
    if isinstance(readings, Readings):
        readings = [readings]
    maps = [points.for_machine(design) for points in readings]
    size, turns = _size(design, maps)
    design = with_swept_volume(design, jnp.asarray(size / compressor.crankshaft.count))
    if compressor.motor.losses is not None:  # goes with the volume that is swept in a second
        faster = turns * 2 * np.pi / float(compressor.motor.speed_guess)
        fixed = variable(design, "motor.losses.fixed_power")
        design = fixed.apply(design, fixed.current(design) * faster)
    vary = {}
    prior = {}
    for name, (low, high, width) in RECIPE.items():
        try:
            unknown = varied(design, name)
        except BadInput:
            continue
        present = float(unknown.current(design))
        if present > 0:
            limit = high * present
            # A common factor may go as far as all of its numbers.
            for number in _numbers(unknown):
                limit = min(limit, present * number.bound.high / float(number.current(design)))
            vary[name] = (low * present, limit)
            if width is not None:
                prior[name] = (present, width * present)
    return Recipe(machine=design, vary=vary, prior=prior)


def _numbers(unknown: Variable | CommonFactor) -> tuple[Variable, ...]:
    if isinstance(unknown, CommonFactor):
        return unknown.each
    return (unknown,)


def _size(design: Machine, readings: Sequence[Readings]) -> tuple[float, float]:
    """[m^3] Swept volume that the flow wants, and [1/s] the speed, as medians over all points."""
    compressor = design.as_compressor()
    gas = compressor.gas
    nominal = float(compressor.motor.speed_guess)
    if not isinstance(gas, Cylinder) or not has_dew_line(gas.fluid):
        raise BadInput("gas", kind_text(gas), "a cylinder with valves and a real gas")
    fluid = gas.fluid

    @jax.jit
    @jax.vmap
    def density_and_rise(s, d, gas, useful, liquid):
        density = fluid.density(gas, fluid.saturation(T=s).p)
        return density, capacity_rise(fluid, s, d, useful, liquid)

    volumes = [np.zeros(0)]
    speeds = [np.zeros(0)]
    for points in readings:
        at = (
            points.evaporating,
            points.condensing,
            points.gas,
            points.useful,
            points.liquid_of(fluid),
        )
        density, rise = map(np.asarray, density_and_rise(*map(jnp.asarray, at)))
        flow = points.measured.get("mass_flow")
        if flow is None and "capacity" in points.measured:
            flow = points.measured["capacity"] / rise
        if flow is not None:
            turns = np.where(np.isfinite(points.speed), points.speed, nominal) / (2 * np.pi)
            volumes.append(flow / (density * turns * _FILLING))
            speeds.append(turns)
    if not np.isfinite(np.concatenate(volumes)).any():
        raise BadInput("readings", "no capacity", "a capacity or mass flow, which tells the size")
    return float(np.nanmedian(np.concatenate(volumes))), float(np.median(np.concatenate(speeds)))
