"""Tables of `jaxcomp run`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from operator import itemgetter
from typing import Any

from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM, ZERO_CELSIUS, axes_words, shown
from ._tables import Markup, as_note, number_heads, number_text, percent_text, row_table, words

# Quantities that the other tables of a run have.
_IN_OTHER_TABLES = ("swept_volume", "joint_margin", "peak_shaking_force", "peak_shaking_moment")


def run_tables(scene: jc.scene.Scene, result: dict[str, Any]) -> Iterator[Any]:
    """Efficiency and power, losses, joint forces, residuals, verification, vibration."""
    yield _summary(scene, result)
    yield from map(as_note, map(escape, result["remarks"]))
    if "impact_speed" in result:
        yield _power(result)
        yield _valves(result)
    if "pulsation" in result:
        yield _pipes(result)
    yield _losses(result)
    yield _forces(result)
    yield from _shaking(result)
    if "rod_load_reversal" in result:
        yield _reversals(result["rod_load_reversal"])
    if result.get("api_618", {}).get("crosshead"):
        yield from _api_618(result["api_618"])
    if "load_steps" in result:
        yield _load_steps(result["load_steps"]["steps"])
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


def _size(compressor: jc.Compressor, result: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Row of bore, stroke and swept volume, of a machine with a bore."""
    from .._core.each import listed, of_cylinder

    bore = getattr(of_cylinder(compressor.mechanism), "bore", None)
    if bore is None:
        return
    size = f"{float(bore) * 1e3:.4g} x {result['stroke'] * 1e3:.4g} mm"
    volume = shown("", "m^3", result["swept_volume"]).text(result["swept_volume"])
    extent = ""
    if compressor.crankshaft.count > 1:
        extent = f" in each of {compressor.crankshaft.count} cylinders"
    if getattr(compressor.gas, "rod_diameter", None) is not None:
        extent = f" on both sides{extent}"
    if listed(compressor.mechanism):
        extent = " in the first of them"
    yield "Bore x stroke", size, f"{volume} swept{extent}"


def _summary(scene: jc.scene.Scene, result: dict[str, Any]):
    from ..study._steady_state import crank_quantities

    rows = list(_size(scene.as_compressor(), result))
    low = RPM * result["lowest_speed"]
    high = RPM * result["highest_speed"]
    notes = {
        "mean_speed": f"{result['mean_speed']:.5g} rad/s",
        "speed_fluctuation": f"{low:.5g} to {high:.5g} rpm",
    }
    meaningless = any("no efficiency" in remark for remark in result["remarks"])
    for quantity in crank_quantities(scene.machine):
        if quantity.name not in result or quantity.name in _IN_OTHER_TABLES:
            continue
        value = result[quantity.name]
        note = notes.get(quantity.name, quantity.doc.rstrip("."))
        if value is None:
            rows.append((shown(quantity.name, quantity.unit, 0.0).words, "none", note))
            continue
        sizes = value
        if quantity.unit == "W":
            sizes = [value, result["motor_power"]]
        look = shown(quantity.name, quantity.unit, sizes)
        name = look.words
        text = look.text(value)
        if look.unit == "%":
            text = f"{100 * value:.2f} %"
        if quantity.unit == "W" and quantity.name != "capacity":
            text = look.text(value, 4)
            note = f"{value * result['period']:.5g} J per revolution"
        if quantity.name == "mechanical_efficiency":
            if meaningless:
                text = "none"
            text = Markup(f"[bold]{text}")
            name = Markup(f"[bold]{name}")
        rows.append((name, text, note))
    rows += _between_stages(result)
    return row_table(_changed_name(scene, result), ("Periodic state", "", ""), rows, texts=3)


def _changed_name(scene: jc.scene.Scene, result: dict[str, Any]) -> str:
    """The name of a machine with what the command line changes in it."""
    changes = [f"{name} = {text}" for name, text in {**result["set"], **result["design"]}.items()]
    if not changes:
        return scene.name
    return f"{scene.name} with {', '.join(changes)}"


def _between_stages(result: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Rows of the pressures between stages, of ideal valves and of solved ones."""
    notes = {
        "stage_pressure": "Pressure between the stages",
        "interstage_pressure": "Pressure behind its cooler",
    }
    for name, note in notes.items():
        for stage, pressure in result.get(name, {}).items():
            yield f"Behind stage {stage}", shown("", "Pa", pressure).text(pressure), note


def _losses(result: dict[str, Any]):
    motor = result["motor_work"]
    total = sum(result["losses"].values())

    def row(name, loss, power, share):
        return name, loss, power, share, percent_text(loss, motor)

    rows = []
    for name, loss in sorted(result["losses"].items(), key=lambda item: -item[1]):
        share = f"{100 * result['loss_share'][name]:.1f} %"
        rows.append(row(words(name), loss, result["loss_power"][name], share))
    rows.append(())
    rows.append(row("Total", total, result["friction_power"], percent_text(total, total, ".1f")))
    numbers = (("J per revolution", ".4g"), ("W", ".4g"))
    heads = ("Friction loss", *numbers, "Share of losses", "Of motor work")
    return row_table(None, heads, rows)


def _power(result: dict[str, Any]):
    """Table of the uses of power and swept volume."""
    from ..crank._performance import POWER

    power = result["power_use"]
    volume = result["volume_use"]
    total = sum(power.values())
    rows: list[Any] = []
    for name in POWER:
        use = power.get(name, 0.0)
        # a use that is rounding beside the total is none
        if abs(use) > 1e-12 * abs(total):
            rows.append((words(name), f"{use:.4g}", percent_text(use, total)))
    rows += [(), ("Total", f"{total:.5g}", "100.00 %"), ()]
    for name, share in volume.items():
        rows.append((words(name), "", f"{100 * share:.2f} %"))
    return row_table(None, ("Use of power, then of the swept volume", "W", "Share"), rows)


def _valves(result: dict[str, Any]):
    impact = result["impact_speed"]
    rows = []
    for valve, angle in result["closing_angle"].items():
        seat = impact[f"{valve}_seat"]
        stop = impact[f"{valve}_stop"]
        rows.append((words(valve), seat, stop, math.degrees(angle)))
    speeds = (("Impact on seat, m/s", ".3g"), ("On stop, m/s", ".3g"))
    return row_table(None, ("Valve", *speeds, ("Shuts last at, degrees", ".1f")), rows)


def _pipes(result: dict[str, Any]):
    """Table of the pressures in pipes, with what they cost."""
    values = result["pulsation"]
    drops = result["pressure_drop"]
    rows = []
    for name in values:
        if not name.endswith(".mean"):
            continue
        node = name.removesuffix(".mean")
        peak = values[f"{node}.peak_to_peak"]
        orders = [f"{values[f'{node}.order_{order}']:.4g}" for order in range(1, 5)]
        rows.append((node, peak, *orders, number_text(drops.get(node), ".4g")))
    orders = ("Order 1", "Order 2", "Order 3", "Order 4")
    heads = ("Pressure in pipes", ("Peak to peak, Pa", ".5g"), *orders, "Mean drop, Pa")
    caption = f"least limit of API 618 over its pulsation: {result['pulsation_margin']:.3g}"
    return row_table(None, heads, rows, caption=caption)


def _forces(result: dict[str, Any]):
    peaks = result["peak_forces"]
    mean = result["mean_forces"]
    largest = max(peaks.values(), default=0.0)
    unit = "N"
    scale = 1.0
    if largest >= 1e3:
        unit = "kN"
        scale = 1e3
    rows = []
    for name, peak in peaks.items():
        rows.append((words(name), mean[name] / scale, peak / scale))
    size = result["peak_shaking_force"]
    if not size > 1e-9 * largest:
        size = 0.0  # where the cylinders balance each other, rounding is left
    shaking = ("Shaking force", "", size / scale)
    heads = ("Joint force", (f"Mean, {unit}", ".4g"), (f"Peak, {unit}", ".4g"))
    return row_table(None, heads, [*rows, (), shaking])


def _shaking(result: dict[str, Any]):
    """Shaking forces and couples by order; those that are rounding, as of a balanced order, as 0."""
    forces = result["shaking_force"]
    couples = result["shaking_couple"]
    largest_force = max(forces.values(), default=0.0)
    largest_couple = max(couples.values(), default=0.0)
    rows = []
    for order, force in forces.items():
        couple = couples[order]
        rows.append((order, _unless_rounding(force, largest_force),
                     _unless_rounding(couple, largest_couple)))  # fmt: skip
    if largest_force > 0:
        heads = ("Order", ("Force, N", ".4g"), ("Couple, N m", ".4g"))
        yield row_table("Shaking, by order", heads, rows)


def _unless_rounding(size: float, scale: float) -> float:
    """A size; 0 where it is rounding beside a scale."""
    if size > 1e-6 * scale:
        return size
    return 0.0


def _reversals(rods: dict[str, dict[str, float]]):
    """For how long, and with which share, the load of a crosshead pin is on its smaller side."""
    rows = []
    for name, rod in rods.items():
        rows.append((words(name), math.degrees(rod["angle"]), 100 * rod["share"]))
    heads = ("Rod load", ("Reversed for, °", ".4g"), ("Smaller side, %", ".3g"))
    return row_table("Load reversal (API 618: 15°, 3 %)", heads, rows)


def _api_618(sheet: dict[str, Any]) -> Iterator[Any]:
    """The page of API 618 as its data sheets head it: rods, ends of the cylinders, shaking."""
    numbers = (("Bore, mm", ".4g"), ("Stroke, mm", ".4g"), ("Rod dia., mm", ".4g"))
    numbers += (("Piston speed, m/s", ".3g"), ("Recip. weight, kg", ".4g"))
    rows = []
    for throw in sheet["throws"]:
        rows.append(
            (
                str(throw["cylinder"]),
                throw["bore"] * 1e3,
                throw["stroke"] * 1e3,
                throw["rod_diameter"] and throw["rod_diameter"] * 1e3,
                throw["piston_speed"],
                throw["reciprocating_mass"],
            )
        )
    yield row_table("API 618, cylinder data", ("Throw", *numbers), rows)
    if sheet["ends"]:
        yield _cylinder_ends(sheet["ends"])
    yield _rod_loads(sheet["throws"])
    yield _unbalanced(sheet)


def _unbalanced(sheet: dict[str, Any]):
    """Forces and couples of order 1 and 2 that the throws leave."""
    names = {1: "Primary", 2: "Secondary"}
    # where the throws balance each other, rounding is left
    force = max(throw["inertia_compression"] for throw in sheet["throws"])
    couple = max(max(row["couple_x"], row["couple_y"]) for row in sheet["unbalanced"])
    scales = {"force_x": force, "force_y": force, "couple_x": couple, "couple_y": couple}
    rows = []
    for row in sheet["unbalanced"]:
        cells: list[Any] = [names[row["order"]]]
        for key, scale in scales.items():
            cells.append(_unless_rounding(row[key], scale) / 1e3)
        rows.append(cells)
    heads = number_heads(
        ".4g",
        "Force along x, kN",
        "Force along y, kN",
        "Couple about x, kN m",
        "Couple about y, kN m",
    )
    return row_table("API 618, unbalanced forces and couples", ("", *heads), rows)


def _cylinder_ends(ends: list[dict[str, Any]]):
    """Pressures, temperatures and volumes of the compressing ends."""
    has_temperatures = any(end["inlet_temperature"] is not None for end in ends)
    rows = []
    for end in ends:
        temperatures = []
        if has_temperatures:
            for name in ("inlet_temperature", "discharge_temperature"):
                temperatures.append(end[name] and end[name] - ZERO_CELSIUS)
        rows.append(
            (
                f"{end['cylinder']}, {end['end']} end",
                str(end["stage"]),
                end["suction_pressure"] / 1e5,
                end["discharge_pressure"] / 1e5,
                end["pressure_ratio"],
                *temperatures,
                60 * end["displacement"],
                100 * end["clearance_ratio"],
                100 * end["volumetric_efficiency"],
            )
        )
    heads = number_heads(".4g", "Inlet pressure, bar", "Disch. pressure, bar", "Ratio")
    if has_temperatures:
        heads += number_heads(".4g", "Inlet temp., °C", "Disch. temp., °C")
    heads += [("Piston displ., m³/min", ".4g"), ("Clearance, %", ".3g"), ("Vol. eff., %", ".4g")]
    return row_table("API 618, at the stated conditions", ("Cylinder", "Stage", *heads), rows)


def _rod_loads(throws: list[dict[str, Any]]):
    """Compression and tension of gas, inertia and both, and the reversal at the crosshead pin."""
    loads = []
    for kind in ("gas", "inertia", "combined"):
        loads += [f"{kind}_compression", f"{kind}_tension"]
    rows = []
    for throw in throws:
        reversal_angle = math.degrees(throw["reversal_angle"])
        kilonewtons = (throw[load] / 1e3 for load in loads)
        number = str(throw["cylinder"])
        rows.append((number, *kilonewtons, reversal_angle, 100 * throw["reversal_share"]))
    heads = []
    for kind in ("Gas", "Inertia", "Combined (gas + inertia)"):
        heads += [(f"{kind}, comp.", ".4g"), (f"{kind}, tens.", ".4g")]
    reversal = (("Rod reversal, ° min. at x-hd pin", ".4g"), ("Smaller side, %", ".3g"))
    return row_table("API 618, rod load, kN", ("Throw", *heads, *reversal), rows)


def _load_steps(steps: list[dict[str, Any]]):
    """Flow, power, torque, rod loads and temperature at every load step."""
    rows = []
    for step in steps:
        rows.append(
            (
                step["name"],
                1e3 * step["mass_flow"],
                100 * step["flow_share"],
                step["shaft_power"] / 1e3,
                step["mean_torque"],
                step["rod_compression"] / 1e3,
                step["rod_tension"] / 1e3,
                math.degrees(step["reversal_angle"]),
                100 * step["reversal_share"],
                step["discharge_temperature"] - ZERO_CELSIUS,
            )
        )
    numbers = (("Flow, g/s", ".4g"), ("Of full, %", ".4g"), ("Shaft, kW", ".4g"))
    numbers += (("Torque, N m", ".4g"), ("Rod comp., kN", ".4g"), ("Rod tens., kN", ".4g"))
    numbers += (("Reversal, °", ".4g"), ("Smaller side, %", ".3g"), ("Hottest end, °C", ".4g"))
    return row_table("Load steps", ("Step", *numbers), rows)


def _journal_films(result: dict[str, Any]):
    """Films of the journals, by the law that was solved and, as far as it is known, by the other one."""
    other_law = result.get("moved_films", {})
    rows = []
    touch = any(loss > 0 for loss in result["contact_loss"].values())
    for name, thickness in result["film_thickness"].items():
        law = "steady"
        by_other_law = other_law.get(name, {}).get("film_thickness")
        if result["film_law"][name] == "orbit":
            law = "orbit"
            by_other_law = result["steady_film_thickness"][name]
        if by_other_law is not None:
            by_other_law *= 1e6
        row = [
            words(name),
            law,
            1e6 * thickness,
            by_other_law,
            100 * result["thin_film_share"][name],
            result["film_pressure"][name] / 1e6,
            1e6 * result["film_flow"][name],
            result["film_temperature_rise"][name],
        ]
        if touch:
            row.append(result["contact_loss"][name])
        rows.append(row)
    heads = number_heads(".3g", "Least, µm", "Else, µm", "Thin, %", "MPa", "cm³/s", "Rise, K")
    if touch:
        heads += [("Rubs, W", ".3g")]
    return row_table(None, ("Film", "By", *heads), rows, texts=2)


def _convergence(result: dict[str, Any]):
    resolution = "of the speed; the error of the fluctuation is smaller"
    closure = "motor work that is neither gas work nor loss"
    cycle = []
    if "cycle_resolution" in result:
        of_cycle = "of the gas; the relative error of the flow is smaller"
        cycle = [("Cycle's resolution", f"{result['cycle_resolution']:.1e}", of_cycle)]
    gas = []
    if result.get("gas_work") and result.get("gas_work_error") is not None:
        error = f"{result['gas_work_error'] / abs(result['gas_work']):.1e}"
        gas = [("Gas work", error, "stated error of the quadrature, relative")]
    rows = (
        ("Solver", result["solver"], f"tolerance {result['tolerance']:.2g}"),
        ("Iterations", result["iterations"], result["status"]),
        ("Residual", f"{result['residual']:.1e}", "periodicity or collocation equations"),
        ("Resolution", f"{result['resolution']:.1e}", resolution),
        *cycle,
        *gas,
        ("Energy closure", f"{result['energy_residual']:.1e}", closure),
        ("Joint margin", f"{result['joint_margin']:.4f}", "1 without friction, locks at 0"),
    )
    return row_table(None, ("Convergence", "", ""), rows, texts=3)


def _verified(result: dict[str, Any], march: dict[str, Any]):
    """Errors that the independent integration of a revolution found, each beside its value."""

    def row(name, value, error, unit):
        share = ""
        if value:
            share = f"{abs(error / value):.1e}"
        return name, f"{value:.6g} {unit}".strip(), f"{error:.1e} {unit}".strip(), share

    speed = march["speed"]
    key = "mechanical_efficiency"
    rows = [
        ("Speed, largest", "", f"{speed * result['mean_speed']:.1e} rad/s", f"{speed:.1e}"),
        row("Mechanical efficiency", result[key], march[key], ""),
        row("Gas work", result["gas_work"], march["gas_work"], "J"),
    ]
    for name, error in march["losses"].items():
        rows.append(row(f"{words(name)}, loss", result["losses"][name], error, "J"))
    for name, error in march["peak_forces"].items():
        rows.append(row(f"{words(name)}, peak", result["peak_forces"][name], error, "N"))
    heads = ("Independent march of a revolution", "Value", "Error", "Relative")
    return row_table(None, heads, rows)


def _vibration(vibration: dict[str, Any], axes: str):
    """Amplitudes of the points, the free-body approximation and its error."""
    hertz = ", ".join(f"{w / (2 * math.pi):.3g}" for w in vibration["natural_frequencies"])
    rows = []
    for name, point in vibration["points"].items():
        metres = [*point["amplitude"], point["peak"], *point["free_body"]]
        error = f"{100 * point['free_body_error']:.2g} %"
        rows.append((words(name), *(1e6 * value for value in metres), error))
    title = f"First harmonic on springs of {hertz} Hz, and as a free body"
    numbers = number_heads(".3g", "x", "y", "z", "Peak", "Free x", "y", "z")
    return row_table(title, ("µm", *numbers, "Error"), rows, unbroken=(0,), caption=axes)


def _torsion(torsion: dict[str, Any]):
    """Table of the torque in each spring of the crank train."""
    hertz = ", ".join(f"{w / (2 * math.pi):.4g}" for w in torsion["natural_frequencies"])
    first = torsion["natural_frequencies"][0]
    critical = ", ".join(f"{RPM * first / order:.0f}" for order in (1, 2, 3, 4))
    columns = itemgetter("mean_torque", "peak_torque", "peak_error", "largest_order")(torsion)
    rows = []
    for mean, peak, error, order in zip(*columns, strict=True):
        rows.append((len(rows) + 1, mean, peak, error, peak / abs(mean), order))
    title = f"Torsion at {hertz} Hz; orders 1 to 4 meet the first at {critical} rpm"
    torques = (("Mean, N m", ".4g"), ("Peak, N m", ".4g"), ("Off by, at most", ".1g"))
    torques += (("Peak/mean", ".3g"),)
    return row_table(title, ("Spring", *torques, "Order"), rows)


def undelivered_tables(orbit: jc.Orbit) -> Iterator[Any]:
    """Pressure over volume of the cylinders that deliver nothing, and what each lacks."""
    import jax
    import numpy as np

    from .._core.status import Status

    cycles: list[Any] = [orbit.cycle]
    cylinder_cycles = getattr(orbit.cycle, "each", None)  # of several cylinders
    if cylinder_cycles is not None:
        count = len(cylinder_cycles.angle)
        cycles = [jax.tree.map(itemgetter(place), cylinder_cycles) for place in range(count)]
    for number, cycle in enumerate(cycles, 1):
        if cycle.status != Status.no_delivery:
            continue
        where = "Cylinder"
        if cylinder_cycles is not None:
            where = f"Cylinder {number}"
        look = shown("temperature", "K", cycle.temperature)
        angle = (np.rad2deg(np.asarray(cycle.angle)) + 180) % 360 - 180
        nodes = [int(np.argmin(np.abs(angle - at))) for at in range(-180, 180, 20)]
        rows = []
        for node in nodes:
            volume = float(cycle.volume[node]) * 1e6
            pressure = float(cycle.pressure[node]) / 1e5
            temperature = look.number(float(cycle.temperature[node]), 4)
            rows.append((f"{angle[node]:.0f}", f"{volume:.4g}", f"{pressure:.4g}", temperature))
        heads = ("Crank angle, degrees", "Volume, cm³", "Pressure, bar", look.label)
        yield row_table(f"{where}: no gas is delivered", heads, rows, texts=0)
        peak = float(cycle.peak_pressure)
        behind = float(cycle.case.discharge.p)
        leaks = float(cycle.totals.leakage / cycle.case.mass_scale)
        yield (
            f"The pressure reaches {peak / 1e5:.4g} bar; behind the discharge valve are "
            f"{behind / 1e5:.4g} bar: {(behind - peak) / 1e5:.4g} bar are lacking, and what the valve's "
            f"preload adds. Past the piston leak {100 * leaks:.3g} % of a filling of the cylinder. "
            "A smaller clearance_ratio or leakage, or a lower discharge pressure, lets it deliver."
        )
