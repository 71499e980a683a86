"""`jaxcomp bearing`: position, friction, stiffness and damping of one journal bearing."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape

import jaxcomp as jc

from .._shown import RPM
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


@reports_errors
def bearing(
    length: Annotated[str, typer.Option()],
    diameter: Annotated[str, typer.Option()],
    clearance: Annotated[str, typer.Option()],
    viscosity: Annotated[str, typer.Option()],
    speed: Annotated[str, typer.Option()],
    load: Annotated[str, typer.Option()],
    model: Model = "reynolds",
    as_json: AsJson = False,
    out: OutWithoutScene = None,
) -> None:
    """Run a journal bearing under a steady load: position, friction, stiffness and damping.

    Example: [bold]jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity "VG 46
    at 60 degC" --speed 3000rpm --load 2kN[/bold]

    Args:
        length: Length of the bearing, such as '20 mm'.
        diameter: Diameter of the journal, such as '40 mm'.
        clearance: Radial clearance, bush radius minus journal radius.
        viscosity: Dynamic viscosity such as '5 mPa*s', or a grade as 'VG 46 at 60 degC'.
        speed: Speed of the journal, such as 3000rpm.
        load: Load on the journal, such as '2 kN'.
        model: Film model; the output states its limits.
    """
    texts = {
        "length": (length, "m"),
        "diameter": (diameter, "m"),
        "clearance": (clearance, "m"),
        "viscosity": (viscosity, "Pa s"),
        "speed": (speed, "rad/s"),
        "load": (load, "N"),
    }
    given = {
        name: float(jc.scene.to_si(text, unit, f"--{name}")) for name, (text, unit) in texts.items()
    }
    film_type = getattr(jc.film, _CLASSES[model])
    _check(given, model, film_type.length_ratio_range)
    start_jax()
    with waiting("Solving the film (the first time it is compiled as well) ..."):
        result, field = bearing_result(film_type, model, given)

    def figures():
        return jc.plot.film_figures(film_type, result, field)

    tables = bearing_tables(result)
    hand_out(result, tables, as_json, out, figures, written="Report, pictures and result")


def _check(given: dict[str, float], model: str, ratios: tuple[float, float]) -> None:
    size = {name: f"--{name} {value:.6g}" for name, value in given.items()}
    units = {"length": "m", "diameter": "m", "clearance": "m", "viscosity": "Pa s"}
    for name, unit in units.items():
        refuse(given[name] <= 0, f"{size[name]} {unit}: must be > 0 {unit}")
    refuse(given["speed"] == 0, "--speed 0 rad/s: must not be 0 rad/s; a film needs motion")
    refuse(given["load"] < 0, f"{size['load']} N: must be >= 0 N")
    radius, ratio = given["diameter"] / 2, given["length"] / given["diameter"]
    what = f"must be < {radius:.6g} m, the radius of the journal"
    refuse(given["clearance"] >= radius, f"{size['clearance']} m: {what}")
    low, high = ratios
    refuse(
        not low * (1 - 1e-12) <= ratio <= high * (1 + 1e-12),
        f"{size['length']} m: length/diameter must be {low:g} to {high:g} for "
        f"the model {model}, but is {ratio:.6g}",
    )


def bearing_result(film_type, model: str, given: dict[str, float]) -> tuple[dict[str, Any], Any]:
    """Operating point of a bearing as plain numbers in SI units, and its pressure field.

    The keys are stable; new ones may join them. A number that the model does not give, or that is
    infinite (the Sommerfeld number at no load), is None.
    """
    import equinox as eqx
    import numpy as np

    speed, sign = abs(given["speed"]), math.copysign(1.0, given["speed"])
    size = (given[name] for name in ("diameter", "length", "clearance", "viscosity"))
    part = jc.film.JournalBearing(*size, film_type)
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
