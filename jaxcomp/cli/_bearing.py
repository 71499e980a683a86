"""`jaxcomp bearing`: a journal bearing under a steady load or over speed, or its orbit under a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM
from ._arguments import split_at
from ._output import Output, OutputWithoutScene
from ._start import refuse, start_jax, waiting
from ._tables import number_heads, row_table, value_rows

# Films by their names in machine files, and the classes of `jaxcomp.film` that do so.
Model = Literal["reynolds", "grooved", "guembel", "short", "fit", "petroff", "loaded_petroff"]
_CLASSES = {
    "reynolds": "Reynolds",
    "grooved": "GroovedReynolds",
    "guembel": "Guembel",
    "short": "Ocvirk",
    "fit": "ExplicitFit",
    "petroff": "Petroff",
    "loaded_petroff": "LoadedPetroff",
}
# The models in which journals move.
_MOVING = ("reynolds", "short")
# Units of the options that are numbers of the bearing, and the fields that those of a contact set.
_SIZES = {"length": "m", "diameter": "m", "clearance": "m", "viscosity": "Pa s"}
_UNITS = _SIZES | {
    **{"speed": "rad/s", "load": "N"},
    **{"roughness": "m", "boundary-friction": "", "modulus": "Pa", "elastic-factor": ""},
}
_CONTACT = {
    **{"roughness": "roughness", "boundary-friction": "coefficient"},
    **{"modulus": "modulus", "elastic-factor": "elastic_factor"},
}


@dataclass(frozen=True)
class Bush:
    """The bearing of the options, and what loads it."""

    length: Annotated[str, typer.Option()]
    diameter: Annotated[str, typer.Option()]
    clearance: Annotated[str, typer.Option()]
    viscosity: Annotated[str, typer.Option()]
    speed: str | None = None
    load: str | None = None
    loads: Path | None = None
    over: str | None = None
    model: Model = "reynolds"
    lands: int = 1
    roughness: str | None = None
    boundary_friction: str | None = None
    modulus: str | None = None
    elastic_factor: str | None = None
    journal_speed: str | None = None
    bush_speed: str | None = None
    frame: Literal["fixed", "journal", "bush"] = "fixed"
    between: Literal["spline", "lines"] = "spline"
    period: str | None = None

    def si(self, units: Mapping[str, str]) -> dict[str, float]:
        """[SI] The options that are given, of those with a unit."""
        from ..scene._units import to_si

        numbers = {}
        for name, unit in units.items():
            text = getattr(self, name.replace("-", "_"))
            if text is not None:
                numbers[name] = float(to_si(text, unit, f"--{name}"))
        return numbers


def bearing(bush: Bush, output: OutputWithoutScene) -> None:
    r"""Run a journal bearing under a steady load, or under loads from a table over the crank angle.

    A steady load: position, friction, stiffness and damping; with --over speed=FROM:TO:COUNT the
    friction over the speed (Stribeck's curve), to which rough surfaces in contact belong. A table: the
    periodic orbit of the journal in its film, with smallest film, largest pressure, loss and side flow.

    Example: [bold]jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity "VG 46
    at 60 degC" --speed 3000rpm --load 2kN[/bold]

    Args:
        length: Length of the bearing, such as '20 mm'.
        diameter: Diameter of the journal, such as '40 mm'.
        clearance: Radial clearance, bush radius minus journal radius.
        viscosity: Dynamic viscosity such as '5 mPa*s', or a grade as 'VG 46 at 60 degC'.
        speed: Speed of the journal, such as 3000rpm; with --loads, of the crank; not beside --over.
        load: Steady load on the journal, such as '2 kN'.
        loads (FILE.csv): Loads on the journal instead of --load: columns angle \[deg], W_x [N] and
            W_y [N] over one period. Further columns journal_speed \[rpm] and bush_speed \[rpm] for a rod
            or a pin that swings.
        over (speed=FROM:TO:COUNT): Speeds instead of --speed, such as speed=log:50rpm:3000rpm:60.
        model: Film model; the output states its limits. Journals move in reynolds and short (Ocvirk).
        lands: Two with a full groove between them; the length is that of both together.
        roughness: Of journal and bush together, r.m.s., whose contact then carries and rubs where the
            film is thin; with --boundary-friction.
        boundary_friction: Coefficient of friction of that contact, such as 0.1.
        modulus: Of the contact, 1/E* the sum of (1 - nu^2)/E of both surfaces; 115 GPa if absent.
        elastic_factor: Of the asperities; 0.003 if absent.
        journal_speed: With --loads, if not that of the crank, such as 0rpm for a pin at rest.
        bush_speed: With --loads, if the bush turns as well.
        frame: Axes of the loads: at rest, or turning with the journal or the bush.
        between: Between the points of the table: a periodic cubic spline, or straight lines.
        period: Of the table, such as '720 deg'; if absent, the whole revolutions that hold it.
    """
    refuse(
        bush.load is None and bush.loads is None,
        "Missing option '--load', or '--loads' with a table",
    )
    refuse(bush.load and bush.loads, "--load: cannot be combined with --loads")
    refuse(bush.loads and bush.over, "--over: cannot be combined with --loads")
    refuse(bush.speed and bush.over, "--speed: cannot be combined with --over")
    refuse(bush.speed is None and bush.over is None, "Missing option '--speed'")
    quantities = bush.si(_UNITS)
    contact = _contact(quantities)
    if bush.over is not None:
        quantities["speed"] = _speeds(bush.over)
    film_type = getattr(jc.film, _CLASSES[bush.model])
    _check(quantities, bush.model, film_type.length_ratio_range, bush.lands)
    start_jax()
    if bush.loads is not None:
        _loaded(bush, bush.loads, quantities, contact, output)
        return
    of_tables = {
        "journal-speed": bush.journal_speed,
        "bush-speed": bush.bush_speed,
        "period": bush.period,
        "frame": bush.frame != "fixed",
        "between": bush.between != "spline",
    }
    for name, value in of_tables.items():
        refuse(value, f"--{name}: needs --loads, a table of loads")
    part = _part(quantities, film_type, bush.lands, contact)
    if bush.over is not None:
        _over_speed(part, quantities, bush.model, output)
        return
    with waiting("Solving the film (the first time it is compiled as well) ..."):
        steady_state = jc.film.steady_bearing(part, quantities["load"], quantities["speed"])

    def pictures():
        from ..plot._bearings import film_figures

        return film_figures(steady_state, bush.model)

    output.emit(
        steady_state,
        bearing_tables,
        pictures,
        written="Report, pictures and result",
        metadata={"model": bush.model},
    )


def _contact(quantities: dict[str, float]) -> dict[str, float]:
    """The numbers of a contact by the names of its fields, taken out of those that are given."""
    contact = {}
    for name, field in _CONTACT.items():
        if name not in quantities:
            continue
        value = quantities.pop(name)
        impossible = value < 0 or (value == 0 and name != "boundary-friction")
        refuse(impossible, f"--{name} {value:.6g}: must be positive")
        contact[field] = value
    if contact:
        for name in ("roughness", "boundary-friction"):
            missing = _CONTACT[name] not in contact
            refuse(missing, f"Missing option '--{name}': a contact needs it")
    return contact


def _part(quantities, film, lands: int, contact: dict[str, float]):
    """The bearing of the options."""
    rough = None
    if contact:
        rough = jc.film.AsperityContact(**contact)
    size = itemgetter("diameter", "length", "clearance", "viscosity")(quantities)
    return jc.JournalBearing(*size, film, lands=lands, contact=rough)


def _speeds(text: str) -> list[float]:
    """[rad/s] The speeds of --over, which rise."""
    from ._sweep import axis_values

    name, equals, range_text = split_at("=", text)
    form = "must have the form speed=FROM:TO:COUNT"
    refuse(name != "speed" or not equals, f"--over {text}: {form}")
    speeds = sorted(axis_values(range_text, "rad/s", f"--over {text}", False))
    refuse(speeds[0] <= 0, f"--over {text}: speeds must be > 0 rad/s")
    return speeds


def _over_speed(part, quantities: dict[str, Any], model: str, output: Output) -> None:
    """The friction of a bearing over its speed."""
    with waiting("Solving the films (the first time they are compiled as well) ..."):
        curve = jc.film.stribeck_curve(part, quantities["load"], quantities["speed"])
    output.emit(
        curve,
        lambda result: stribeck_tables(curve, result),
        lambda: {"stribeck": jc.plot.stribeck(curve)},
        curves={"stribeck": curve.columns},
        written="Report, picture, stribeck.csv and result.json",
        metadata={"model": model},
    )


def stribeck_tables(curve, result: dict[str, Any]):
    """Friction of film and contact over speed, in some twenty rows."""
    heads = ("Speed, rpm", "Friction torque, N m", "of it contact", "Friction coefficient",
             "Smallest film, µm", "Load on the contact")  # fmt: skip
    stride = math.ceil(len(result["speed"]) / 20) or 1
    rows = []
    for point in range(0, len(result["speed"]), stride):
        torque = result["friction_torque"][point]
        contact_share = result["contact_torque"][point] / torque
        load_share = result["contact_load"][point] / result["load"]
        rows.append((
            f"{result['speed'][point] * RPM:.5g}",
            f"{torque:.4g}",
            f"{100 * contact_share:.3g} %",
            f"{result['friction_coefficient'][point]:.4g}",
            f"{result['minimum_film'][point] * 1e6:.4g}",
            f"{100 * load_share:.3g} %",
        ))  # fmt: skip
    yield row_table(
        f"Friction over speed at {result['load']:.4g} N, {result['model']}", heads, rows
    )
    least = result["least_friction_speed"]
    lowest = result["speed"][0]
    highest = result["speed"][-1]
    where = f"{least * RPM:.4g} rpm"
    if not lowest < least < highest:
        where += ", an end of the range"
    yield f"Least friction at {where}."
    if curve.bearing.contact is None:
        yield "Smooth surfaces; rough ones, by --roughness and --boundary-friction, touch in thin films."
    yield escape(f"{result['model']}: {result['limits']}")


def _loaded(
    bush: Bush, loads: Path, quantities: dict[str, float], contact: dict[str, float], output: Output
) -> None:
    """The orbit of a journal under the loads of a table."""
    from ..crank import loaded_journal
    from ..scene.load_tables import read_loads

    motion = bush.si({"journal-speed": "rad/s", "bush-speed": "rad/s", "period": "rad"})
    model = bush.model
    refuse(model not in _MOVING, f"--model {model}: no journal moves in it; {' or '.join(_MOVING)}")
    refuse(
        quantities["speed"] <= 0,
        f"--speed {quantities['speed']:.6g} rad/s: must be > 0 with --loads",
    )
    table = read_loads(loads, motion.get("period"), bush.frame, bush.between)
    shares = {}
    for name in ("journal", "bush"):
        if f"{name}-speed" in motion:
            has_column = getattr(table, f"{name}_speed") is not None
            refuse(has_column, f"--{name}-speed: {loads} has a column {name}_speed; one must go")
            shares[name] = motion[f"{name}-speed"] / quantities["speed"]
    part = _part(quantities, model, bush.lands, contact)
    with waiting("Solving the orbit (the first time it is compiled as well) ..."):
        orbit = loaded_journal(part, table, quantities["speed"], **shares)

    def pictures():
        from ..plot._bearings import loaded_journal_figures

        return loaded_journal_figures(orbit)

    output.emit(
        orbit,
        lambda result: loaded_tables(orbit, result),
        pictures,
        curves={"orbit": orbit.columns},
        written="Report, pictures, orbit.csv and result.json",
        metadata={"model": model, "loads": str(loads)},
    )


def loaded_tables(orbit, result: dict[str, Any]):
    """Film, pressure, loss and flow of a journal under the loads of a table."""
    size = f"{result['length'] * 1e3:.4g} x {result['diameter'] * 1e3:.4g} mm"
    axes = {"fixed": "at rest", "journal": "turn with the journal", "bush": "turn with the bush"}
    points = orbit.table.angle.size
    interpolation = {"spline": "cubic spline", "lines": "straight lines"}
    rows = [
        ("Viscosity", "viscosity", "mPa s", "in the film"),
        ("Speed", "speed", "rpm", "of the crank"),
        ("Loads", "table_period", "°",
         f"{points} points, {interpolation[orbit.table.between]}; axes {axes[orbit.table.frame]}"),
        ("Smallest film", "minimum_film", "µm",
         f"at {math.degrees(result['minimum_film_angle']):.5g}° of the crank"),
        ("Error of the solution", "film_error", "µm", "of that film, estimated"),
        ("Error of the table", "table_error", "µm", "of that film, by other curves between"),
        ("Largest pressure", "peak_pressure", "MPa", ""),
        ("Mean loss", "mean_loss", "W", f"{result['mean_squeeze_loss']:.4g} W of it pressure"),
        ("Mean side flow", "mean_side_flow", "cm3/min", "out of both ends"),
        ("Oil warms by", "temperature_rise_of_oil", "K", "if it takes the loss along"),
        ("Smallest steady film", "steady_film", "µm", "of every load by itself, without squeeze"),
    ]  # fmt: skip
    title = f"Journal bearing {size} under {result['loads']}, {result['model']}"
    heads = ("Orbit of the journal", "", "")
    yield row_table(title, heads, value_rows(result, rows), texts=3)
    yield escape(f"{result['model']}: {result['limits']}")


def _check(
    quantities: dict[str, float], model: str, ratios: tuple[float, float], lands: int = 1
) -> None:
    size = {name: f"--{name} {value:.6g}" for name, value in quantities.items() if name != "speed"}
    for name, unit in _SIZES.items():
        refuse(quantities[name] <= 0, f"{size[name]} {unit}: must be > 0 {unit}")
    refuse(quantities["speed"] == 0, "--speed 0 rad/s: must not be 0 rad/s; a film needs motion")
    refuse(quantities.get("load", 0) < 0, f"{size.get('load')} N: must be >= 0 N")
    refuse(lands not in (1, 2), f"--lands {lands}: must be 1 or 2")
    radius = quantities["diameter"] / 2
    ratio = quantities["length"] / quantities["diameter"] / lands
    bound = f"must be < {radius:.6g} m, the radius of the journal"
    refuse(quantities["clearance"] >= radius, f"{size['clearance']} m: {bound}")
    low, high = ratios
    # 0.1 m / 0.2 m may miss the end of a range by a rounding
    refuse(
        not low * (1 - 1e-12) <= ratio <= high * (1 + 1e-12),
        f"{size['length']} m: length/diameter must be {low:g} to {high:g} for "
        f"the model {model}, but is {ratio:.6g}",
    )


def bearing_tables(result: dict[str, Any]):
    """Position and friction, then stiffness and damping; what a model does not give is left out."""
    size = f"{result['length'] * 1e3:.4g} x {result['diameter'] * 1e3:.4g} mm"
    rows = [
        ("Viscosity", "viscosity", "mPa s", "in the film"),
        ("Speed", "speed", "rpm", f"{result['speed']:.5g} rad/s"),
        ("Load", "load", "N", ""),
        ("Eccentricity ratio", "eccentricity_ratio", "", "e/c"),
        ("Attitude angle", "attitude_angle", "°", "load to e_r"),
        ("Load number Phi_p", "phi_p", "", "W psi^2/(eta omega L D), rad/s"),
        ("Sommerfeld number S", "sommerfeld_number", "", "1/(2 pi Phi_p), rev/s"),
        ("Friction number Phi_T", "phi_t", "", "pi at no load"),
        ("Friction torque", "friction_torque", "N m", f"{result['friction_power']:.5g} W"),
        ("Torque of the contact", "contact_torque", "N m", "of it"),
        ("Load on the contact", "contact_load", "N", "along the line of centres"),
        ("Minimum film", "minimum_film", "µm", "compare with the roughness"),
        ("Peak pressure", "peak_pressure", "MPa", ""),
        ("Side flow", "side_flow", "cm3/min", "out of both ends"),
        ("Largest stable mass", "critical_mass", "kg", "rigid rotor, of one bearing"),
    ]
    title = f"Journal bearing {size}, L/D = {result['length_ratio']:.4g}, {result['model']}"
    yield row_table(title, ("Running state", "", ""), value_rows(result, rows), texts=3)
    matrices = {
        "K, N/m": result["stiffness"],
        "C, N s/m": result["damping"],
        "c K/W": result["dimensionless_stiffness"],
        "c omega C/W": result["dimensionless_damping"],
    }
    if matrices["K, N/m"] is not None:
        title = "Stiffness and damping: x along the load, y 90 degrees ahead with rotation"
        rows = []
        for name, matrix in matrices.items():
            if matrix is not None:
                rows.append((name, *chain.from_iterable(matrix)))
        yield row_table(title, ("", *number_heads(".4g", "xx", "xy", "yx", "yy")), rows)
    yield escape(f"{result['model']}: {result['limits']}")
