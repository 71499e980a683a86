"""`jaxcomp run`: the periodic state of a machine, its efficiency, losses, forces, vibration, pictures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM, axes_words, shown
from .._core.registry import Quantity, registered
from . import _options as opt
from ._arguments import assignments, changed_scene
from ._output import hand_out, plain, show_results
from ._start import refuse, reports_errors, start_jax, waiting
from ._tables import Markup, row_table, words

# Families of quantities whose keys were there before.
_KEYS = {"peak_force": "peak_forces", "mean_force": "mean_forces"}
# Quantities that the other tables of a run have.
_IN_OTHER_TABLES = ("swept_volume", "joint_margin", "peak_shaking_force", "peak_shaking_moment")
# Harmonics of the vibration.
_HARMONICS = 12
# What API 618 asks of the load of a crosshead pin: crank angle, and share of the larger side as it is
# usually quoted.
_REVERSAL, _REVERSED = math.radians(15), 0.03


@reports_errors
def run(
    machine: opt.Machine,
    sets: opt.Sets = None,
    designs: opt.Designs = None,
    solver: opt.Solver = "collocation",
    tolerance: float | None = None,
    cycle: opt.CycleOption = None,
    verify: bool = False,
    moving_films: bool = False,
    as_json: opt.AsJson = False,
    out: opt.Out = None,
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
    start_jax(once=True)
    scene = changed_scene(machine, sets, designs)
    compressor = scene.as_compressor()
    method = opt.with_cycle(opt.solver_of(solver, compressor), cycle)
    if tolerance is not None:
        method = dataclasses.replace(method, tolerance=tolerance)
    with waiting("Solving the periodic state (the first time it is compiled as well) ..."):
        orbit = _solved(compressor, method, verify or out is not None, as_json)
        result = run_result(scene, orbit)
        if moving_films:
            result["moved_films"] = {
                name: {
                    "film_thickness": float(film.minimum_film),
                    "loss": float(
                        film.mean_shear_loss + film.mean_squeeze_loss + film.mean_contact_loss
                    ),
                }
                for name, film in jc.crank.moved_films(compressor, orbit).items()
            }
        if "suspension" in scene.parts:
            suspension: Any = scene.parts["suspension"]
            block = jc.vibration.block_vibration(compressor, orbit, suspension, _HARMONICS)
            result["vibration"] = vibration_result(block)
        if "torsion" in scene.parts:
            result["torsion"] = torsion_result(scene, orbit)
    result["tolerance"] = method.tolerance
    result["set"] = assignments(sets, "--set")
    result["design"] = assignments(designs, "--design")

    def figures():
        from ..plot import torsion_over_speed

        made = jc.plot.orbit_figures(compressor, orbit, scene.parts.get("suspension"))
        if "torsion" in scene.parts:
            made["torsion"] = torsion_over_speed(compressor, orbit, scene.parts["torsion"])
        return made

    curves = {"curves": lambda: orbit_curves(scene, orbit)}
    hand_out(result, run_tables(scene, result), as_json, out, figures, scene, curves)


def _solved(compressor: jc.Compressor, method: Any, verify: bool, as_json: bool) -> jc.Orbit:
    """The periodic state; of a machine that delivers nothing the cylinder is shown before the error."""
    from .._core.status import SolveFailed, Status

    try:
        return jc.crank.solve_orbit(compressor, method, verify=verify)
    except SolveFailed as error:
        if error.status == Status.no_delivery and not as_json:
            show_results({}, _undelivered(error.result), as_json)
        raise


def _undelivered(orbit: jc.Orbit) -> Iterator[Any]:
    """Pressure over volume of the cylinders that deliver nothing, and what each lacks."""
    import jax
    import numpy as np

    from .._core.status import Status

    cycles: list[Any] = [orbit.cycle]
    each = getattr(orbit.cycle, "each", None)  # of several cylinders
    if each is not None:
        cycles = [jax.tree.map(lambda x, n=n: x[n], each) for n in range(len(each.angle))]
    for number, cycle in enumerate(cycles, 1):
        if cycle.status != Status.no_delivery:
            continue
        where = "Cylinder" if each is None else f"Cylinder {number}"
        look = shown("temperature", "K", cycle.temperature)
        angle = (np.rad2deg(np.asarray(cycle.angle)) + 180) % 360 - 180
        every = [int(np.argmin(np.abs(angle - at))) for at in range(-180, 180, 20)]
        rows = (
            (f"{angle[i]:.0f}", f"{float(cycle.volume[i]) * 1e6:.4g}",
             f"{float(cycle.pressure[i]) / 1e5:.4g}", look.number(float(cycle.temperature[i]), 4))
            for i in every
        )  # fmt: skip
        heads = ("Crank angle, degrees", "Volume, cm³", "Pressure, bar", look.label)
        yield row_table(f"{where}: no gas is delivered", heads, rows, texts=0)
        peak, behind = float(cycle.peak_pressure), float(cycle.case.discharge.p)
        leaks = float(cycle.totals.leakage / cycle.case.mass_scale)
        yield (
            f"The pressure reaches {peak / 1e5:.4g} bar; behind the discharge valve are "
            f"{behind / 1e5:.4g} bar: {(behind - peak) / 1e5:.4g} bar are lacking, and what the valve's "
            f"preload adds. Past the piston leak {100 * leaks:.3g} % of a filling of the cylinder. "
            "A smaller clearance_ratio or leakage, or a lower discharge pressure, lets it deliver."
        )


def _of_the_crank(machine) -> tuple[Quantity, ...]:
    """The quantities of the periodic state of crank and gas that a machine has."""
    rotor = {"vibration", "rotor", "balancing"}
    return tuple(
        one for one in registered() if not rotor & set(one.needs) and not one.missing(machine)
    )


def run_result(scene: jc.scene.Scene, orbit: jc.Orbit) -> dict[str, Any]:
    """The orbit in numbers. The keys are stable; new ones may join them."""
    from importlib.metadata import version

    import jax

    from .._core.exported import kept_jit
    from .._core.status import Status

    known = _of_the_crank(scene.machine)
    found = kept_jit(_numbers)(scene.machine, scene.assembly, orbit, known)
    values, numbers = jax.tree.map(float, jax.device_get(found))
    margins = numbers.pop("turning_margins")
    compressor = scene.as_compressor()
    # where no film has a thickness there is no least one
    known = tuple(one for one in known if values[one.name] != math.inf)
    rods, moved = _rods(compressor, orbit), orbit.positions or {}
    films = jc.crank.film_thickness(compressor, orbit)
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
    for name, thickness in jc.crank.film_thickness(compressor, orbit).items():
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
        if abs(margin) < jc.cylinder.GRAZING:
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
    from .._core.fields import of_cylinder
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


def run_tables(scene: jc.scene.Scene, result: dict[str, Any]) -> Iterator[Any]:
    """Efficiency and power, losses, joint forces, residuals, verification, vibration."""
    yield _summary(scene, result)
    yield from (f"[yellow]Note:[/yellow] {escape(remark)}" for remark in result["remarks"])
    if "impact_speed" in result:
        yield _power(result)
        yield _valves(result)
    yield _losses(result)
    yield _forces(result)
    yield from _shaking(result)
    if "rod_load_reversal" in result:
        yield _reversals(result["rod_load_reversal"])
    if result.get("film_thickness"):
        yield _journal_films(result)
    yield _convergence(result)
    if "verification" in result:
        yield _verified(result, result["verification"])
    if "vibration" in result:
        banks = scene.as_compressor().crankshaft.bank_angle
        yield _vibration(result["vibration"], axes_words(banks))
    if "torsion" in result:
        yield _torsion(result["torsion"])


def _summary(scene: jc.scene.Scene, result: dict[str, Any]):
    from .._core.fields import listed, of_cylinder

    rows, compressor = [], scene.as_compressor()
    count = compressor.crankshaft.count
    bore = getattr(of_cylinder(compressor.mechanism), "bore", None)
    if bore is not None:
        size = f"{float(bore) * 1e3:.4g} x {result['stroke'] * 1e3:.4g} mm"
        volume = shown("", "m^3", result["swept_volume"]).text(result["swept_volume"])
        each = "" if count == 1 else f" in each of {count} cylinders"
        if listed(compressor.mechanism):
            each = " in the first of them"
        rows.append(("Bore x stroke", size, f"{volume} swept{each}"))
    low, high = (f"{RPM * result[f'{end}_speed']:.5g}" for end in ("lowest", "highest"))
    notes = {
        "mean_speed": f"{result['mean_speed']:.5g} rad/s",
        "speed_fluctuation": f"{low} to {high} rpm",
    }
    meaningless = any("no efficiency" in remark for remark in result["remarks"])
    for one in _of_the_crank(scene.machine):
        if one.name not in result or one.name in _IN_OTHER_TABLES:
            continue
        value, note = result[one.name], notes.get(one.name, one.doc.rstrip("."))
        sizes = [value, result["motor_power"]] if one.unit == "W" else value
        look = shown(one.name, one.unit, sizes)
        name, text = look.words, f"{100 * value:.2f} %" if look.unit == "%" else look.text(value)
        if one.unit == "W" and one.name != "capacity":
            text, note = look.text(value, 4), f"{value * result['period']:.5g} J per revolution"
        if one.name == "mechanical_efficiency":
            text = Markup("[bold]none" if meaningless else f"[bold]{text}")
            name = Markup(f"[bold]{name}")
        rows.append((name, text, note))
    changes = [f"{k} = {v}" for k, v in {**result["set"], **result["design"]}.items()]
    title = scene.name + (f" with {', '.join(changes)}" if changes else "")
    return row_table(title, ("Periodic state", "", ""), rows, texts=3)


def _losses(result: dict[str, Any]):
    motor, total = result["motor_work"], sum(result["losses"].values())

    def row(name, loss, power, share):
        return name, loss, power, share, f"{100 * loss / motor:.2f} %" if motor else ""

    rows = [
        row(words(name), loss, result["loss_power"][name], f"{100 * share:.1f} %")
        for name, loss in sorted(result["losses"].items(), key=lambda item: -item[1])
        for share in [result["loss_share"][name]]
    ]
    whole = row("Total", total, result["friction_power"], "100.0 %" if total else "")
    numbers = (("J per revolution", ".4g"), ("W", ".4g"))
    heads = ("Friction loss", *numbers, "Share of losses", "Of motor work")
    return row_table(None, heads, [*rows, (), whole])


def _power(result: dict[str, Any]):
    """What power and swept volume are used for."""
    power, volume = result["power_use"], result["volume_use"]
    whole = sum(power.values())
    rows = [
        (words(name), f"{power[name]:.4g}", f"{100 * power[name] / whole:.2f} %" if whole else "")
        for name in jc.crank.POWER
        if abs(power[name]) > 1e-12 * abs(whole)  # else rounding
    ]
    rows += [(), ("Total", f"{whole:.5g}", "100.00 %"), ()]
    rows += [(words(name), "", f"{100 * share:.2f} %") for name, share in volume.items()]
    return row_table(None, ("Use of power, then of the swept volume", "W", "Share"), rows)


def _valves(result: dict[str, Any]):
    impact = result["impact_speed"]
    rows = [
        (words(valve), impact[f"{valve}_seat"], impact[f"{valve}_stop"], math.degrees(angle))
        for valve, angle in result["closing_angle"].items()
    ]
    speeds = (("Impact on seat, m/s", ".3g"), ("On stop, m/s", ".3g"))
    return row_table(None, ("Valve", *speeds, ("Shuts last at, degrees", ".1f")), rows)


def _forces(result: dict[str, Any]):
    peaks, mean = result["peak_forces"], result["mean_forces"]
    largest = max(peaks.values(), default=0.0)
    unit, scale = ("kN", 1e3) if largest >= 1e3 else ("N", 1.0)
    rows = [(words(name), mean[name] / scale, peak / scale) for name, peak in peaks.items()]
    # where the cylinders balance each other, rounding is left
    size = result["peak_shaking_force"]
    shaking = ("Shaking force", "", (size if size > 1e-9 * largest else 0.0) / scale)
    heads = ("Joint force", (f"Mean, {unit}", ".4g"), (f"Peak, {unit}", ".4g"))
    return row_table(None, heads, [*rows, (), shaking])


def _shaking(result: dict[str, Any]):
    """Shaking forces and couples by order; those that are rounding, as of a balanced order, as 0."""
    forces, couples = (result[f"shaking_{kind}"] for kind in ("force", "couple"))
    scales = max(forces.values(), default=0.0), max(couples.values(), default=0.0)

    def shown_size(size, scale):
        return size if size > 1e-6 * scale else 0.0

    rows = [
        (order, shown_size(forces[order], scales[0]), shown_size(couples[order], scales[1]))
        for order in forces
    ]
    if scales[0] > 0:
        heads = ("Shaking, by order", ("Force, N", ".4g"), ("Couple, N m", ".4g"))
        yield row_table(None, heads, rows)


def _reversals(rods: dict[str, dict[str, float]]):
    """For how long, and with which share, the load of a crosshead pin is on its smaller side."""
    rows = [
        (words(name), math.degrees(rod["angle"]), 100 * rod["share"]) for name, rod in rods.items()
    ]
    heads = ("Rod load", ("Reversed for, °", ".4g"), ("Smaller side, %", ".3g"))
    return row_table("Load reversal (API 618: 15°, 3 %)", heads, rows)


def _journal_films(result: dict[str, Any]):
    """Films of the journals, by the law that was solved and, as far as it is known, by the other one."""
    moved, rows = result.get("moved_films", {}), []
    touch = any(loss > 0 for loss in result["contact_loss"].values())
    for name, thickness in result["film_thickness"].items():
        moves = result["film_law"][name] == "orbit"
        instead = moved.get(name, {}).get("film_thickness")
        instead = result["steady_film_thickness"][name] if moves else instead
        rows.append((
            words(name),
            "orbit" if moves else "steady",
            1e6 * thickness,
            None if instead is None else 1e6 * instead,
            100 * result["thin_film_share"][name],
            result["film_pressure"][name] / 1e6,
            1e6 * result["film_flow"][name],
            result["film_temperature_rise"][name],
            *([result["contact_loss"][name]] if touch else []),
        ))  # fmt: skip
    numbers = ("Least, µm", "Else, µm", "Thin, %", "MPa", "cm³/s", "Rise, K")
    numbers += ("Rubs, W",) if touch else ()
    heads = ("Film", "By", *((head, ".3g") for head in numbers))
    return row_table(None, heads, rows, texts=2)


def _convergence(result: dict[str, Any]):
    resolution = "of the speed; the error of the fluctuation is smaller"
    closure = "motor work that is neither gas work nor loss"
    cycle = []
    if "cycle_resolution" in result:
        of_cycle = "of the gas; the relative error of the flow is smaller"
        cycle = [("Cycle's resolution", f"{result['cycle_resolution']:.1e}", of_cycle)]
    rows = (
        ("Solver", result["solver"], f"tolerance {result['tolerance']:.2g}"),
        ("Iterations", result["iterations"], result["status"]),
        ("Residual", f"{result['residual']:.1e}", "periodicity or collocation equations"),
        ("Resolution", f"{result['resolution']:.1e}", resolution),
        *cycle,
        ("Energy closure", f"{result['energy_residual']:.1e}", closure),
        ("Joint margin", f"{result['joint_margin']:.4f}", "1 without friction, locks at 0"),
    )
    return row_table(None, ("Convergence", "", ""), rows, texts=3)


def _verified(result: dict[str, Any], march: dict[str, Any]):
    """Errors that the independent integration of a revolution found, each beside its value."""

    def row(name, value, error, unit):
        share = f"{abs(error / value):.1e}" if value else ""
        return name, f"{value:.6g} {unit}".strip(), f"{error:.1e} {unit}".strip(), share

    speed, key = march["speed"], "mechanical_efficiency"
    rows = [
        ("Speed, largest", "", f"{speed * result['mean_speed']:.1e} rad/s", f"{speed:.1e}"),
        row("Mechanical efficiency", result[key], march[key], ""),
        *(
            row(f"{words(name)}, {word}", result[of][name], error, unit)
            for of, word, unit in (("losses", "loss", "J"), ("peak_forces", "peak", "N"))
            for name, error in march[of].items()
        ),
    ]
    heads = ("Independent march of a revolution", "Value", "Error", "Relative")
    return row_table(None, heads, rows)


# ------------------------------------------------------------------- vibration and torsion
def vibration_result(found: jc.vibration.BlockVibration) -> dict[str, Any]:
    """Settled vibration in SI units; lists run over x, y, z or the six degrees of freedom."""
    from .._core.results import readings_of

    numbers = plain(readings_of(found))
    keys = ("position", "amplitude", "rms", "peak", "free_body", "free_body_error")
    of_points = zip(*(numbers.pop(key) for key in keys), strict=True)
    rows = (dict(zip(keys, row, strict=True)) for row in of_points)
    points = dict(zip(found.points, rows, strict=True))
    return {"harmonics": _HARMONICS, **numbers, "points": points}


def _vibration(vibration: dict[str, Any], axes: str):
    """Amplitudes of the points, the free-body approximation and its error."""
    hertz = ", ".join(f"{w / (2 * math.pi):.3g}" for w in vibration["natural_frequencies"])
    rows = []
    for name, point in vibration["points"].items():
        metres = [*point["amplitude"], point["peak"], *point["free_body"]]
        error = f"{100 * point['free_body_error']:.2g} %"
        rows.append((words(name), *(1e6 * value for value in metres), error))
    title = f"First harmonic on springs of {hertz} Hz, and as a free body"
    numbers = ((head, ".3g") for head in ("x", "y", "z", "Peak", "Free x", "y", "z"))
    return row_table(title, ("µm", *numbers, "Error"), rows, whole=(0,), caption=axes)


def torsion_result(scene: jc.scene.Scene, orbit: jc.Orbit) -> dict[str, Any]:
    """Torsion of the crank train: natural frequencies, critical speeds, torques of the springs."""
    import numpy as np

    train, compressor = scene.parts["torsion"], scene.as_compressor()
    assert isinstance(train, jc.crank.CrankTrain)
    frequencies = np.asarray(train.chain(compressor).natural_frequencies)[1:]
    found = jc.crank.train_torques(compressor, orbit, train)
    result = {
        "natural_frequencies": frequencies,
        "critical_speeds": {str(order): frequencies / order for order in range(1, 9)},
        "mean_torque": -np.asarray(found.mean),  # of the motor, towards the crank
        "peak_torque": found.peak,
        "largest_order": 1 + np.argmax(np.abs(found.amplitude), axis=1),
    }
    return plain(result)


def _torsion(torsion: dict[str, Any]):
    """What each spring of the crank train carries."""
    hertz = ", ".join(f"{w / (2 * math.pi):.4g}" for w in torsion["natural_frequencies"])
    first = torsion["natural_frequencies"][0]
    critical = ", ".join(f"{RPM * first / order:.0f}" for order in (1, 2, 3, 4))
    columns = (torsion[key] for key in ("mean_torque", "peak_torque", "largest_order"))
    rows = [
        (number, mean, peak, peak / abs(mean), order)
        for number, (mean, peak, order) in enumerate(zip(*columns, strict=True), 1)
    ]
    title = f"Torsion at {hertz} Hz; orders 1 to 4 meet the first at {critical} rpm"
    torques = (("Mean, N m", ".4g"), ("Peak, N m", ".4g"), ("Peak/mean", ".3g"))
    return row_table(title, ("Spring", *torques, "Order"), rows)
