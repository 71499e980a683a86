"""`jaxcomp bearing`: one journal bearing under a steady load, or its orbit under loads from a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM
from ._options import AsJson, OutWithoutScene
from ._output import hand_out, plain
from ._start import refuse, reports_errors, start_jax, waiting
from ._tables import row_table

FRAME = "x along the load on the journal, y = x turned by 90 degrees with rotation"
# How the film is described, and the classes of `jaxcomp.film` that do so.
Model = Literal["reynolds", "grooved", "guembel", "ocvirk", "fit", "petroff", "loaded-petroff"]
_CLASSES = {
    "reynolds": "Reynolds",
    "grooved": "GroovedReynolds",
    "guembel": "Guembel",
    "ocvirk": "Ocvirk",
    "fit": "ExplicitFit",
    "petroff": "Petroff",
    "loaded-petroff": "LoadedPetroff",
}
# The models in which journals move, by their names as films of a `JournalBearing`.
_MOVING = {"reynolds": "reynolds", "ocvirk": "short"}


@reports_errors
def bearing(
    length: Annotated[str, typer.Option()],
    diameter: Annotated[str, typer.Option()],
    clearance: Annotated[str, typer.Option()],
    viscosity: Annotated[str, typer.Option()],
    speed: Annotated[str, typer.Option()],
    load: str | None = None,
    loads: Path | None = None,
    model: Model = "reynolds",
    lands: int = 1,
    journal_speed: str | None = None,
    bush_speed: str | None = None,
    frame: Literal["fixed", "journal", "bush"] = "fixed",
    between: Literal["spline", "lines"] = "spline",
    period: str | None = None,
    as_json: AsJson = False,
    out: OutWithoutScene = None,
) -> None:
    """Run a journal bearing under a steady load, or under loads from a table over the crank angle.

    A steady load: position, friction, stiffness and damping. A table: the periodic orbit of the journal
    in its film, with smallest film, largest pressure, loss and side flow.

    Example: [bold]jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity "VG 46
    at 60 degC" --speed 3000rpm --load 2kN[/bold]

    Args:
        length: Length of the bearing, such as '20 mm'.
        diameter: Diameter of the journal, such as '40 mm'.
        clearance: Radial clearance, bush radius minus journal radius.
        viscosity: Dynamic viscosity such as '5 mPa*s', or a grade as 'VG 46 at 60 degC'.
        speed: Speed of the journal, such as 3000rpm; with --loads, of the crank.
        load: Steady load on the journal, such as '2 kN'.
        loads (FILE.csv): Loads on the journal instead of --load: columns angle [deg], W_x [N] and
            W_y [N] over one period. Further columns journal_speed [rpm] and bush_speed [rpm] for a rod
            or a pin that swings.
        model: Film model; the output states its limits. Journals move in reynolds and ocvirk.
        lands: Two with a full groove between them; the length is that of both together.
        journal_speed: With --loads, if not that of the crank, such as 0rpm for a pin at rest.
        bush_speed: With --loads, if the bush turns as well.
        frame: Axes of the loads: at rest, or turning with the journal or the bush.
        between: Between the points of the table: a periodic cubic spline, or straight lines.
        period: Of the table, such as '720 deg'; if absent, the whole revolutions that hold it.
    """
    texts = {
        "length": (length, "m"),
        "diameter": (diameter, "m"),
        "clearance": (clearance, "m"),
        "viscosity": (viscosity, "Pa s"),
        "speed": (speed, "rad/s"),
        "load": (load, "N"),
    }
    refuse(load is None and loads is None, "Missing option '--load', or '--loads' with a table")
    refuse(load and loads, "--load: cannot be combined with --loads")
    given = _numbers(texts)
    film_type = getattr(jc.film, _CLASSES[model])
    _check(given, model, film_type.length_ratio_range, lands)
    start_jax()
    if loads is not None:
        rates = {"journal-speed": (journal_speed, "rad/s"), "bush-speed": (bush_speed, "rad/s")}
        turns = _numbers(rates | {"period": (period, "rad")})
        _loaded(given, turns, loads, model, lands, (frame, between), as_json, out)
        return
    alone = {"journal-speed": journal_speed, "bush-speed": bush_speed, "period": period}
    alone |= {"frame": frame != "fixed", "between": between != "spline"}
    for name, value in alone.items():
        refuse(value, f"--{name}: needs --loads, a table of loads")
    with waiting("Solving the film (the first time it is compiled as well) ..."):
        result, field = bearing_result(film_type, model, given, lands)

    def figures():
        return jc.plot.film_figures(film_type, result, field)

    tables = bearing_tables(result)
    hand_out(result, tables, as_json, out, figures, written="Report, pictures and result")


def _numbers(texts: Mapping[str, tuple[str | None, str]]) -> dict[str, float]:
    """Numbers in SI units of the options that are given."""
    return {
        name: float(jc.scene.to_si(text, unit, f"--{name}"))
        for name, (text, unit) in texts.items()
        if text is not None
    }


def _loaded(given, turns, loads: Path, model: str, lands: int, how, as_json: bool, out) -> None:
    """The orbit of a journal under the loads of a table."""
    from ..crank import loaded_journal
    from ..scene.load_tables import read_loads

    refuse(model not in _MOVING, f"--model {model}: no journal moves in it; {' or '.join(_MOVING)}")
    refuse(given["speed"] <= 0, f"--speed {given['speed']:.6g} rad/s: must be > 0 with --loads")
    table = read_loads(loads, turns.get("period"), *how)
    shares = {}
    for name in ("journal", "bush"):
        if f"{name}-speed" in turns:
            own = getattr(table, f"{name}_speed") is not None
            refuse(own, f"--{name}-speed: {loads} has a column {name}_speed; one must go")
            shares[name] = turns[f"{name}-speed"] / given["speed"]
    size = (given[name] for name in ("diameter", "length", "clearance", "viscosity"))
    bearing = jc.JournalBearing(*size, _MOVING[model], lands=lands)
    with waiting("Solving the orbit (the first time it is compiled as well) ..."):
        found = loaded_journal(bearing, table, given["speed"], **shares)
    limits = jc.film.squeeze_of(bearing).limits
    scalars = {one.name: plain(one.values) for one in found.described() if not one.dims}
    result = {
        "model": model,
        "limits": limits,
        "loads": str(loads),
        "frame": table.frame,
        "between": table.between,
        **given,
        "lands": lands,
        **scalars,
    }

    def figures():
        from ..plot import loaded_journal_figures

        return loaded_journal_figures(found)

    tables = loaded_tables(found, result)
    hand_out(result, tables, as_json, out, figures, curves={"orbit": found.columns},
             written="Report, pictures, orbit.csv and result.json")  # fmt: skip


def loaded_tables(found, result: dict[str, Any]):
    """Film, pressure, loss and flow of a journal under the loads of a table."""
    size = f"{result['length'] * 1e3:.4g} x {result['diameter'] * 1e3:.4g} mm"
    axes = {"fixed": "at rest", "journal": "turn with the journal", "bush": "turn with the bush"}
    points, way = found.table.angle.size, {"spline": "cubic spline", "lines": "straight lines"}
    rows = [
        ("Viscosity", "viscosity", 1e3, "mPa s", "in the film"),
        ("Speed", "speed", RPM, "rpm", "of the crank"),
        ("Loads", "table_period", 180 / math.pi, "°",
         f"{points} points, {way[found.table.between]}; axes {axes[found.table.frame]}"),
        ("Smallest film", "minimum_film", 1e6, "µm",
         f"at {math.degrees(result['minimum_film_angle']):.5g}° of the crank"),
        ("Error of the solution", "film_error", 1e6, "µm", "of that film, estimated"),
        ("Error of the table", "table_error", 1e6, "µm", "of that film, by other curves between"),
        ("Largest pressure", "peak_pressure", 1e-6, "MPa", ""),
        ("Mean loss", "mean_loss", 1.0, "W", f"{result['mean_squeeze_loss']:.4g} W of it pressure"),
        ("Mean side flow", "mean_side_flow", 6e7, "cm3/min", "out of both ends"),
        ("Oil warms by", "temperature_rise_of_oil", 1.0, "K", "if it takes the loss along"),
        ("Smallest steady film", "steady_film", 1e6, "µm", "of every load by itself, without squeeze"),
    ]  # fmt: skip
    cells = (
        (name, f"{result[key] * scale:.5g} {unit}", remark)
        for name, key, scale, unit, remark in rows
        if result[key] is not None
    )
    title = f"Journal bearing {size} under {result['loads']}, {result['model']}"
    yield row_table(title, ("Orbit of the journal", "", ""), cells, texts=3)
    yield escape(f"{result['model']}: {result['limits']}")


def _check(
    given: dict[str, float], model: str, ratios: tuple[float, float], lands: int = 1
) -> None:
    size = {name: f"--{name} {value:.6g}" for name, value in given.items()}
    units = {"length": "m", "diameter": "m", "clearance": "m", "viscosity": "Pa s"}
    for name, unit in units.items():
        refuse(given[name] <= 0, f"{size[name]} {unit}: must be > 0 {unit}")
    refuse(given["speed"] == 0, "--speed 0 rad/s: must not be 0 rad/s; a film needs motion")
    refuse(given.get("load", 0) < 0, f"{size.get('load')} N: must be >= 0 N")
    refuse(lands not in (1, 2), f"--lands {lands}: must be 1 or 2")
    radius, ratio = given["diameter"] / 2, given["length"] / given["diameter"] / lands
    what = f"must be < {radius:.6g} m, the radius of the journal"
    refuse(given["clearance"] >= radius, f"{size['clearance']} m: {what}")
    low, high = ratios
    refuse(
        not low * (1 - 1e-12) <= ratio <= high * (1 + 1e-12),
        f"{size['length']} m: length/diameter must be {low:g} to {high:g} for "
        f"the model {model}, but is {ratio:.6g}",
    )


def bearing_result(
    film_type, model: str, given: dict[str, float], lands: int = 1
) -> tuple[dict[str, Any], Any]:
    """Operating point of a bearing as plain numbers in SI units, and its pressure field.

    The keys are stable; new ones may join them. A number that the model does not give, or that is
    infinite (the Sommerfeld number at no load), is None.
    """
    import equinox as eqx
    import numpy as np

    speed, sign = abs(given["speed"]), math.copysign(1.0, given["speed"])
    size = (given[name] for name in ("diameter", "length", "clearance", "viscosity"))
    part = jc.film.JournalBearing(*size, film_type, lands=lands)
    solved = eqx.filter_jit(jc.film.operating_point)
    found = solved(part, np.float64(given["load"]), np.float64(speed))
    field, point = jc.film.pressure_field(part, found, speed), plain(found)
    friction, bush = point.pop("friction_torque"), point.pop("bush_torque")
    state = ("eccentricity_ratio", "attitude_angle", "sommerfeld_number", "phi_p", "phi_t")
    result = {
        "model": model,
        "limits": film_type.limits,
        "frame": FRAME,
        **given,
        "length_ratio": float(part.length_ratio),
        "clearance_ratio": float(part.clearance_ratio),
        **{name: point.pop(name) for name in state},
        "friction_torque": sign * friction,
        "friction_power": friction * speed,
        "bush_torque": None if bush is None else sign * bush,
        "minimum_film": point.pop("minimum_film"),
        "peak_pressure": None if field is None else field.peak_pressure,
        "side_flow": None if field is None else field.side_flow,
        **{name: _complete(value) for name, value in point.items()},
    }
    return result, field


def _complete(value: Any) -> Any:
    """`None` in place of a matrix of which an entry is missing."""
    missing = isinstance(value, list) and any(entry is None for row in value for entry in row)
    return None if missing else value


def bearing_tables(result: dict[str, Any]):
    """Position and friction, then stiffness and damping; what a model does not give is left out."""
    size = f"{result['length'] * 1e3:.4g} x {result['diameter'] * 1e3:.4g} mm"
    rows = [
        ("Viscosity", "viscosity", 1e3, "mPa s", "in the film"),
        ("Speed", "speed", RPM, "rpm", f"{result['speed']:.5g} rad/s"),
        ("Load", "load", 1.0, "N", ""),
        ("Eccentricity ratio", "eccentricity_ratio", 1.0, "", "e/c"),
        ("Attitude angle", "attitude_angle", 180 / math.pi, "°", "load to e_r"),
        ("Load number Phi_p", "phi_p", 1.0, "", "W psi^2/(eta omega L D), rad/s"),
        ("Sommerfeld number S", "sommerfeld_number", 1.0, "", "1/(2 pi Phi_p), rev/s"),
        ("Friction number Phi_T", "phi_t", 1.0, "", "pi at no load"),
        ("Friction torque", "friction_torque", 1.0, "N m", f"{result['friction_power']:.5g} W"),
        ("Minimum film", "minimum_film", 1e6, "µm", "compare with the roughness"),
        ("Peak pressure", "peak_pressure", 1e-6, "MPa", ""),
        ("Side flow", "side_flow", 6e7, "cm3/min", "out of both ends"),
        ("Largest stable mass", "critical_mass", 1.0, "kg", "rigid rotor, of one bearing"),
    ]
    title = f"Journal bearing {size}, L/D = {result['length_ratio']:.4g}, {result['model']}"
    cells = (
        (name, f"{result[key] * scale:.5g} {unit}".strip(), remark)
        for name, key, scale, unit, remark in rows
        if result[key] is not None
    )
    yield row_table(title, ("Running state", "", ""), cells, texts=3)
    matrices = {
        "K, N/m": result["stiffness"],
        "C, N s/m": result["damping"],
        "c K/W": result["dimensionless_stiffness"],
        "c omega C/W": result["dimensionless_damping"],
    }
    if matrices["K, N/m"] is not None:
        title = "Stiffness and damping: x along the load, y 90 degrees ahead with rotation"
        heads = ("", *((place, ".4g") for place in ("xx", "xy", "yx", "yy")))
        known = {name: matrix for name, matrix in matrices.items() if matrix is not None}
        yield row_table(title, heads, ((name, *x, *y) for name, (x, y) in known.items()))
    yield escape(f"{result['model']}: {result['limits']}")
