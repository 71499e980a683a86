"""`jaxcomp bearing`: position, friction, stiffness and damping of one journal bearing."""

import enum
import math
from typing import Annotated, Any

import typer
from rich.markup import escape

from .._shown import RPM
from ._errors import CommandError, reports_errors
from ._options import AsJson, OutWithoutScene
from ._output import hand_out
from ._start import start_jax
from ._tables import row_table

FRAME = "x along the load on the journal, y = x turned by 90 degrees with rotation"


class Model(enum.StrEnum):
    """How the film is described."""

    reynolds = "reynolds"
    grooved = "grooved"
    guembel = "guembel"
    ocvirk = "ocvirk"
    fit = "fit"
    petroff = "petroff"
    loaded_petroff = "loaded-petroff"


_CLASSES = {
    Model.reynolds: "Reynolds",
    Model.grooved: "GroovedReynolds",
    Model.guembel: "Guembel",
    Model.ocvirk: "Ocvirk",
    Model.fit: "ExplicitFit",
    Model.petroff: "Petroff",
    Model.loaded_petroff: "LoadedPetroff",
}


@reports_errors
def bearing(
    length: Annotated[str, typer.Option(help="Length of the bearing, such as '20 mm'.")],
    diameter: Annotated[str, typer.Option(help="Diameter of the journal, such as '40 mm'.")],
    clearance: Annotated[
        str, typer.Option(help="Radial clearance, bush radius minus journal radius.")
    ],
    viscosity: Annotated[
        str,
        typer.Option(help="Dynamic viscosity such as '5 mPa*s', or a grade as 'VG 46 at 60 degC'."),
    ],
    speed: Annotated[str, typer.Option(help="Speed of the journal, such as 3000rpm.")],
    load: Annotated[str, typer.Option(help="Load on the journal, such as '2 kN'.")],
    model: Annotated[
        Model, typer.Option(help="Film model; the output states its limits.")
    ] = Model.reynolds,
    as_json: AsJson = False,
    out: OutWithoutScene = None,
) -> None:
    """Run a journal bearing under a steady load: position, friction, stiffness and damping.

    Example: [bold]jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity "VG 46
    at 60 degC" --speed 3000rpm --load 2kN[/bold]
    """
    from .. import film as films
    from .._waits import spinner
    from ..scene import to_si

    texts = {
        "length": (length, "m"),
        "diameter": (diameter, "m"),
        "clearance": (clearance, "m"),
        "viscosity": (viscosity, "Pa s"),
        "speed": (speed, "rad/s"),
        "load": (load, "N"),
    }
    given = {name: float(to_si(text, unit, f"--{name}")) for name, (text, unit) in texts.items()}
    film_type = getattr(films, _CLASSES[model])
    _check(given, model, film_type.length_ratio_range)
    start_jax()
    with spinner("Solving the film (the first time it is compiled as well) ..."):
        result, field = bearing_result(film_type, str(model), given)

    def figures():
        from ..plot import film_figures

        return film_figures(film_type, result, field)

    tables = bearing_tables(result)
    hand_out(result, tables, as_json, out, figures, written="Report, pictures and result")


def _check(given: dict[str, float], model: str, ratios: tuple[float, float]) -> None:
    size = {name: f"--{name} {value:.6g}" for name, value in given.items()}
    for name, unit in (
        ("length", "m"),
        ("diameter", "m"),
        ("clearance", "m"),
        ("viscosity", "Pa s"),
    ):
        if given[name] <= 0:
            raise CommandError(f"{size[name]} {unit}: must be > 0 {unit}")
    if given["speed"] == 0:
        raise CommandError("--speed 0 rad/s: must not be 0 rad/s; a film needs motion")
    if given["load"] < 0:
        raise CommandError(f"{size['load']} N: must be >= 0 N")
    radius, ratio = given["diameter"] / 2, given["length"] / given["diameter"]
    if given["clearance"] >= radius:
        raise CommandError(
            f"{size['clearance']} m: must be < {radius:.6g} m, the radius of the journal"
        )
    low, high = ratios
    if not low * (1 - 1e-12) <= ratio <= high * (1 + 1e-12):
        raise CommandError(
            f"{size['length']} m: length/diameter must be {low:g} to {high:g} for "
            f"the model {model}, but is {ratio:.6g}"
        )


def bearing_result(film_type, model: str, given: dict[str, float]) -> tuple[dict[str, Any], Any]:
    """Operating point of a bearing as plain numbers in SI units, and its pressure field.

    The keys are stable; new ones may join them. A number that the model does not give, or that is
    infinite (the Sommerfeld number at no load), is None.
    """
    import equinox as eqx
    import numpy as np

    from .. import film as films
    from ._json import plain

    speed, sign = abs(given["speed"]), math.copysign(1.0, given["speed"])
    part = films.JournalBearing(
        given["diameter"], given["length"], given["clearance"], given["viscosity"], film_type
    )
    found = eqx.filter_jit(films.operating_point)(
        part, np.float64(given["load"]), np.float64(speed)
    )
    field, point = films.pressure_field(part, found, speed), plain(found._asdict())
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
    yield row_table(
        f"Journal bearing {size}, L/D = {result['length_ratio']:.4g}, {result['model']}",
        ("Running state", "", ""),
        (
            (name, f"{result[key] * scale:.5g} {unit}".strip(), remark)
            for name, key, scale, unit, remark in rows
            if result[key] is not None
        ),
        texts=3,
    )
    matrices = {
        "K, N/m": result["stiffness"],
        "C, N s/m": result["damping"],
        "c K/W": result["dimensionless_stiffness"],
        "c omega C/W": result["dimensionless_damping"],
    }
    if matrices["K, N/m"] is not None:
        yield row_table(
            "Stiffness and damping: x along the load, y 90 degrees ahead with rotation",
            ("", "xx", "xy", "yx", "yy"),
            (
                (name, *(f"{entry:.4g}" for row in matrix for entry in row))
                for name, matrix in matrices.items()
                if matrix is not None
            ),
        )
    yield escape(f"{result['model']}: {result['limits']}")
