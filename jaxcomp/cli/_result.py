"""What `jaxcomp run` found, as one object of plain numbers in SI units."""

from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._registry import Quantity, registered
from .._status import Status
from ..compressor import Compressor
from ..crank import Orbit, film_thickness
from ..design import AnalysisOptions, DesignResult
from ..gas import PolytropicCycle
from ..machine import Assembly, Machine
from ..scene import Scene

# Families of quantities whose keys were there before.
_KEYS = {"peak_force": "peak_forces", "mean_force": "mean_forces"}


def run_result(scene: Scene, orbit: Orbit) -> dict[str, Any]:
    """The orbit in numbers. The keys are stable; new ones may join them."""
    known = tuple(one for one in registered() if set(one.needs) <= {"orbit", "compressor"})
    found = _numbers(scene.machine, scene.assembly, orbit, known)
    values, numbers = jax.tree.map(float, jax.device_get(found))
    total = sum(numbers["losses"].values())
    share = {name: loss / total if total else 0.0 for name, loss in numbers["losses"].items()}
    power = {name: loss / numbers["period"] for name, loss in numbers["losses"].items()}
    return {
        "machine": scene.name,
        "file": scene.file,
        "version": version("jaxcomp"),
        # a compiled function returns its keys sorted
        **{_KEYS.get(one.family, one.family or one.name): values[one.name] for one in known},
        **numbers,
        "loss_power": power,
        "loss_share": share,
        "iterations": int(orbit.iterations),
        "converged": bool(orbit.converged),
        "status": Status[orbit.status],
        "solver": orbit.solver,
        **({} if orbit.verification is None else {"verification": _verification(orbit)}),
        "remarks": list(_remarks(scene.as_compressor())),
    }


def _verification(orbit: Orbit) -> dict[str, Any]:
    """Errors that an independent march finds, as the orbit's value less the march's."""
    march = orbit.verification
    assert march is not None
    errors = jax.device_get(
        {
            "speed": march.speed_error,
            "period": -march.period_error,
            "mechanical_efficiency": -march.efficiency_error,
            "losses": jax.tree.map(jnp.negative, march.loss_error),
            "peak_forces": jax.tree.map(jnp.negative, march.peak_error),
            "closure": march.closure,
        }
    )
    ended = {"steps": int(march.steps), "status": Status[march.status]}
    return jax.tree.map(float, errors) | ended


def orbit_curves(scene: Scene, orbit: Orbit) -> dict[str, np.ndarray]:
    """Everything over the revolution, by name and unit; the films of the journals as well."""
    columns = orbit.columns()
    for name, thickness in film_thickness(scene.as_compressor(), orbit).items():
        columns[f"film_thickness.{name} [m]"] = np.asarray(thickness)
    return {"crank_angle [deg]": np.rad2deg(columns["crank_angle [rad]"]), **columns}


def _remarks(machine: Compressor) -> Iterator[str]:
    """What keeps numbers of a result from meaning what their names say."""
    if machine.friction is None:
        yield "There is no friction: nothing is lost, and the efficiency is 100 % by assumption."
    if machine.gas is None:
        yield "There is no gas: all work of the motor is friction, and no efficiency has a meaning."
    elif isinstance(machine.gas, PolytropicCycle) and not bool(machine.gas.delivers):
        yield (
            "No gas flows: with this clearance the compression never reaches the discharge pressure, and "
            "no efficiency has a meaning."
        )


@eqx.filter_jit
def _numbers(
    machine: Machine, assembly: Assembly, orbit: Orbit, known: tuple[Quantity, ...]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """All numbers at once: one compiled program instead of dozens of small ones."""
    result = DesignResult(machine, AnalysisOptions())
    result.assembly, result.orbit = assembly, orbit
    energy, compressor = orbit.energy, assembly.compressor
    assert compressor is not None
    # every joint that carries a force and could have friction has an entry; without a law it loses
    # nothing
    friction = compressor.friction
    joints = {
        name: 0.0
        for name in orbit.loads.forces
        if friction is None or getattr(friction, name, friction) is None
    }
    return {one.name: one.value(result) for one in known}, {
        "motor_work": energy.motor_work,
        "gas_work": energy.gas_work,
        "losses": {**joints, **energy.losses},
        "lowest_speed": orbit.lowest_speed,
        "highest_speed": orbit.highest_speed,
        "period": orbit.period,
        "stroke": compressor.mechanism.stroke,
        "energy_residual": energy.residual,
        "residual": orbit.residual,
        "resolution": orbit.resolution,
    }
