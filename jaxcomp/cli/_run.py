"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import jaxcomp as jc

from .._core.nested import plain
from . import _options as opt
from ._output import Output, show_results
from ._run_tables import of_the_crank, run_tables, undelivered_tables
from ._start import refuse, waiting
from ._tables import words

# Families of quantities whose keys were there before.
_KEYS = {"peak_force": "peak_forces", "mean_force": "mean_forces"}
# Harmonics of the vibration.
_HARMONICS = 12
# What API 618 asks of the load of a crosshead pin: crank angle, and share of the larger side as it is
# usually quoted.
_REVERSAL, _REVERSED = math.radians(15), 0.03


def run(
    *,
    case: opt.DesignCase,
    solver: opt.Solver = "collocation",
    tolerance: float | None = None,
    cycle: opt.CycleOption = None,
    verify: bool = False,
    moving_films: bool = False,
    output: Output,
) -> None:
    """Find the periodic state of a machine and print efficiency, losses and forces.

    Example: [bold]jaxcomp run mayekawa-wbhe --set motor.mean_speed=800rpm --design bore=120mm --out
    result[/bold]

    Args:
        tolerance: Tolerance of the solver; its own default if absent.
        verify: March one revolution from the result with diffrax, independently, and print the errors
            that it finds; always done with --out.
        moving_films: Show as well what the journals with steady films would do if they moved.
    """
    if tolerance is not None:
        refuse(not 0 < tolerance < 1, f"--tolerance {tolerance:g}: must be > 0 and < 1")
    scene = case.scene(once=True)
    compressor = scene.as_compressor()
    method = opt.with_cycle(opt.solver_of(solver, compressor), cycle)
    if tolerance is not None:
        method = dataclasses.replace(method, tolerance=tolerance)
    with waiting("Solving the periodic state (the first time it is compiled as well) ..."):
        orbit = _solved(compressor, method, verify or output.out is not None, output.as_json)
        result = run_result(scene, orbit)
        if moving_films:
            result["moved_films"] = moved_result(compressor, orbit)
        if "suspension" in scene.parts:
            suspension: Any = scene.parts["suspension"]
            block = jc.vibration.block_vibration(compressor, orbit, suspension, _HARMONICS)
            result["vibration"] = vibration_result(block)
        if "torsion" in scene.parts:
            result["torsion"] = torsion_result(scene, orbit)
    result |= {"tolerance": method.tolerance, **case.changes}

    def figures():
        made = jc.plot.interface.orbit_figures(compressor, orbit, scene.parts.get("suspension"))
        if "torsion" in scene.parts:
            made["torsion"] = jc.plot.interface.torsion_over_speed(
                compressor, orbit, scene.parts["torsion"]
            )
        return made

    curves = {"curves": lambda: orbit_curves(scene, orbit)}
    output.emit(result, lambda whole: run_tables(scene, whole), figures, scene, curves)


def _solved(compressor: jc.Compressor, method: Any, verify: bool, as_json: bool) -> jc.Orbit:
    """The periodic state; of a machine that delivers nothing the cylinder is shown before the error."""
    from .._core.status import SolveFailed, Status

    try:
        return jc.crank.solve_orbit(compressor, method, verify=verify)
    except SolveFailed as error:
        if error.status == Status.no_delivery and not as_json:
            show_results({}, undelivered_tables(error.result), as_json)
        raise


def run_result(scene: jc.scene.Scene, orbit: jc.Orbit) -> dict[str, Any]:
    """The orbit in numbers. The keys are stable; new ones may join them."""
    from importlib.metadata import version

    import jax

    from .._core.exported import kept_jit
    from .._core.status import Status

    known = of_the_crank(scene.machine)
    found = kept_jit(_numbers)(scene.machine, scene.assembly, orbit, known)
    values, numbers = jax.tree.map(float, jax.device_get(found))
    margins = numbers.pop("turning_margins")
    compressor = scene.as_compressor()
    # where no film has a thickness there is no least one
    known = tuple(one for one in known if values[one.name] != math.inf)
    rods, moved = _rods(compressor, orbit), orbit.positions or {}
    films = jc.crank.interface.film_thickness(compressor, orbit)
    laws = {name: "orbit" if name in moved else "steady_load" for name in films}
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
        **({"film_law": laws} if laws else {}),
        **({"rod_load_reversal": rods} if rods else {}),
        "loss_power": power,
        "loss_share": share,
        "iterations": int(orbit.iterations),
        "converged": bool(orbit.converged),
        "status": Status[orbit.status],
        "solver": orbit.solver,
        **({} if orbit.verification is None else {"verification": _verification(orbit)}),
        "remarks": list(_remarks(compressor, margins, rods)),
    }


def _rods(compressor: jc.Compressor, orbit: jc.Orbit) -> dict[str, dict[str, float]]:
    """Reversal of the rod load at every crosshead pin; nothing of a machine without crossheads."""
    packed = getattr(compressor.friction, "packing", None) is not None
    if not (packed or isinstance(compressor.gas, jc.gas.DoubleActing)):
        return {}
    return {
        name: {"angle": float(angle), "share": float(share)}
        for name, (angle, share) in jc.crank.rod_load_reversal(orbit).items()
    }


def _verification(orbit: jc.Orbit) -> dict[str, Any]:
    """Errors by an independent integration: the orbit's value less that of the integration."""
    import jax

    from .._core.status import Status

    march = orbit.verification
    assert march is not None
    errors = {
        "speed": march.speed_error,
        "period": -march.period_error,
        "mechanical_efficiency": -march.efficiency_error,
        "losses": {name: -error for name, error in march.loss_error.items()},
        "peak_forces": {name: -error for name, error in march.peak_error.items()},
        "closure": march.closure,
    }
    ended = {"steps": int(march.steps), "status": Status[march.status]}
    return jax.tree.map(float, errors) | ended


def orbit_curves(scene: jc.scene.Scene, orbit: jc.Orbit) -> dict[str, Any]:
    """Everything over the revolution, by name and unit; the films of the journals as well."""
    import numpy as np

    from ..compressor import crank_end_pressure

    columns, compressor = orbit.columns(), scene.as_compressor()
    for name, thickness in jc.crank.interface.film_thickness(compressor, orbit).items():
        columns[f"film_thickness.{name} [m]"] = np.asarray(thickness)
    for name, film in jc.crank.journal_films(compressor, orbit).items():
        curves = {
            f"eccentricity.{name}.x []": film.position[0],
            f"eccentricity.{name}.y []": film.position[1],
            f"film_pressure.{name} [Pa]": film.pressure,
            f"film_flow.{name} [m^3/s]": film.flow,
            f"shear_loss.{name} [W]": film.shear_loss,
            f"squeeze_loss.{name} [W]": film.squeeze_loss,
            f"contact_loss.{name} [W]": film.contact_loss,
        }
        columns |= {key: np.asarray(curve) for key, curve in curves.items()}
    crank_end = crank_end_pressure(compressor, orbit.state.angle)
    if crank_end is not None:
        for number, pressure in enumerate(crank_end, 1):
            several = f".{number}" if len(crank_end) > 1 else ""
            columns[f"crank_end_pressure{several} [Pa]"] = pressure
    return {"crank_angle [deg]": np.rad2deg(columns["crank_angle [rad]"]), **columns}


def _remarks(
    machine: jc.Compressor, margins: dict[str, float], rods: dict[str, dict[str, float]]
) -> Iterator[str]:
    """Reasons why numbers of a result do not mean what their names say."""
    for name, rod in rods.items():
        if rod["angle"] < _REVERSAL or rod["share"] < _REVERSED:
            yield (
                f"The load of {words(name).lower()} is reversed for {math.degrees(rod['angle']):.3g} "
                f"degrees with {100 * rod['share']:.2g} % of its larger side: the pin may run dry "
                "(API 618 asks for 15 degrees and 3 %)."
            )
    if machine.frictionless:
        yield "There is no friction: nothing is lost, and the efficiency is 100 % by assumption."
    for name, margin in margins.items():
        if abs(margin) < jc.cylinder.interface.GRAZING:
            valve, place = name.split("_")
            yield (
                f"The {valve} valve {'just touches' if margin > 0 else 'just misses'} its {place} "
                f"({100 * abs(margin):.2g} % of its stop): derivatives hold only for designs in which it "
                f"{'still touches, and are steep there' if margin > 0 else 'still misses'}. "
                "Move the stop, or let an optimiser search by values."
            )
    if machine.gas is None:
        yield "There is no gas: all work of the motor is friction, and no efficiency has a meaning."
    elif isinstance(machine.gas, jc.gas.PolytropicCycle) and not machine.gas.delivers.any():
        yield (
            "No gas flows: with this clearance the compression never reaches the discharge pressure, and "
            "no efficiency has a meaning."
        )


def _numbers(machine, assembly, orbit: jc.Orbit, known) -> tuple[dict[str, Any], dict[str, Any]]:
    """All numbers at once: one compiled program instead of dozens of small ones."""
    from .._core.each import of_cylinder
    from ..study import AnalysisOptions, DesignResult

    result = DesignResult(machine, AnalysisOptions())
    result.assembly, result.orbit = assembly, orbit
    energy, compressor = orbit.energy, assembly.compressor
    assert compressor is not None
    # every joint that carries a force and could have friction has an entry; without a law it loses
    # nothing
    joints = dict.fromkeys(orbit.loads.forces, 0.0)
    return {one.name: one.value(result) for one in known}, {
        "motor_work": energy.motor_work,
        "gas_work": energy.gas_work,
        "losses": {**joints, **energy.losses},
        "lowest_speed": orbit.lowest_speed,
        "highest_speed": orbit.highest_speed,
        "period": orbit.period,
        "stroke": of_cylinder(compressor.mechanism).stroke,
        "energy_residual": energy.residual,
        "residual": orbit.residual,
        "resolution": orbit.resolution,
        **({} if orbit.cycle is None else {"cycle_resolution": orbit.cycle.resolution}),
        "turning_margins": {} if orbit.cycle is None else orbit.cycle.turning_margins,
    }


# ------------------------------------------------------------------- vibration and torsion
def moved_result(compressor: jc.Compressor, orbit: jc.Orbit) -> dict[str, Any]:
    """What the journals with steady films would do if they moved."""
    return {
        name: {
            "film_thickness": film.minimum_film,
            "loss": film.mean_shear_loss + film.mean_squeeze_loss + film.mean_contact_loss,
        }
        for name, film in jc.crank.interface.moved_films(compressor, orbit).items()
    }


def vibration_result(found: jc.vibration.BlockVibration) -> dict[str, Any]:
    """Settled vibration in SI units; lists run over x, y, z or the six degrees of freedom."""
    from .._core.results import readings_of

    numbers = plain(readings_of(found))
    keys = ("position", "amplitude", "rms", "peak", "free_body", "free_body_error")
    of_points = zip(*(numbers.pop(key) for key in keys), strict=True)
    rows = (dict(zip(keys, row, strict=True)) for row in of_points)
    points = dict(zip(found.points, rows, strict=True))
    return {"harmonics": _HARMONICS, **numbers, "points": points}


def torsion_result(scene: jc.scene.Scene, orbit: jc.Orbit) -> dict[str, Any]:
    """Torsion of the crank train: natural frequencies, critical speeds, torques of the springs."""
    import numpy as np

    train, compressor = scene.parts["torsion"], scene.as_compressor()
    assert isinstance(train, jc.crank.CrankTrain)
    frequencies = np.asarray(train.chain(compressor).natural_frequencies)[1:]
    found = jc.crank.train_torques(compressor, orbit, train)
    return {
        "natural_frequencies": frequencies,
        "critical_speeds": {str(order): frequencies / order for order in range(1, 9)},
        "mean_torque": -np.asarray(found.mean),  # of the motor, towards the crank
        "peak_torque": found.peak,
        "largest_order": 1 + np.argmax(np.abs(found.amplitude), axis=1),
    }
