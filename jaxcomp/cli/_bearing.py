"""`jaxcomp bearing`: position, friction, stiffness and damping of one journal bearing."""

import enum
import functools
import math
from typing import Annotated, Any

import typer

from ._errors import CommandError, reports_errors
from ._options import AsJson, OutWithoutScene

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
        Model, typer.Option(help="Film model; each says where it stops being right.")
    ] = Model.reynolds,
    as_json: AsJson = False,
    out: OutWithoutScene = None,
) -> None:
    """Run a journal bearing under a steady load: position, friction, stiffness and damping.

    Example: [bold]jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity "VG 46
    at 60 degC" --speed 3000rpm --load 2kN[/bold]
    """
    from rich.markup import escape

    from .._waits import spinner
    from ..scene import to_si
    from ._bearing_tables import bearing_tables
    from ._output import show_results, write_results
    from ._start import start_jax

    def number(name: str, text: str, unit: str) -> float:
        return float(to_si(text, unit, f"--{name}"))

    given = {
        "length": number("length", length, "m"),
        "diameter": number("diameter", diameter, "m"),
        "clearance": number("clearance", clearance, "m"),
        "viscosity": float(to_si(viscosity, "Pa s", "--viscosity")),
        "speed": number("speed", speed, "rad/s"),
        "load": number("load", load, "N"),
    }
    for name, unit in (
        ("length", "m"),
        ("diameter", "m"),
        ("clearance", "m"),
        ("viscosity", "Pa s"),
    ):
        if given[name] <= 0:
            raise CommandError(f"--{name} {_short(given[name])} {unit}: must be > 0 {unit}")
    if given["speed"] == 0:
        raise CommandError("--speed 0 rad/s: must not be 0 rad/s; a film needs motion")
    if given["load"] < 0:
        raise CommandError(f"--load {_short(given['load'])} N: must be >= 0 N")
    if given["clearance"] >= given["diameter"] / 2:
        raise CommandError(
            f"--clearance {_short(given['clearance'])} m: must be < {_short(given['diameter'] / 2)} m, "
            "the radius of the journal"
        )
    start_jax()
    film = _models()[model]
    low, high = film.length_ratio_range
    ratio = given["length"] / given["diameter"]
    if not low * (1 - 1e-12) <= ratio <= high * (1 + 1e-12):
        raise CommandError(
            f"--length {_short(given['length'])} m: length/diameter must be {low:g} to {high:g} for "
            f"the model {model}, but is {_short(ratio)}"
        )
    with spinner("Solving the film (the first time it is compiled as well) ..."):
        result, field = bearing_result(film, str(model), given)
    tables = [*bearing_tables(result), escape(f"{model}: {film.limits}")]
    if out is not None:
        from ..plot import film_figures

        with spinner("Drawing ..."):
            write_results(out, film_figures(film, result, field), result, tables=tables)
    show_results(result, tables, as_json, out, "Report, pictures and result")


def bearing_result(film_type, model: str, given: dict[str, float]) -> tuple[dict[str, Any], Any]:
    """What a bearing does, as plain numbers in SI units, and its pressure field.

    The keys are stable; new ones may join them. A number that the model does not give, or that is
    infinite (the Sommerfeld number at no load), is None.
    """
    import jax
    import numpy as np

    from ..film import JournalBearing

    radius, gap, speed = given["diameter"] / 2, given["clearance"], abs(given["speed"])
    part = JournalBearing(given["diameter"], given["length"], gap, given["viscosity"], film_type)
    found = _program()(part, np.float64(given["load"]), np.float64(speed))
    found = {name: np.asarray(value).tolist() for name, value in jax.device_get(found).items()}
    unit = given["viscosity"] * speed / (gap / radius) ** 2  # [Pa] of pressure
    field = _field(film_type, found)
    peak = None if field is None else field["peak"] * unit
    flow = None if field is None else field["flow"]
    result = {
        "model": model,
        "limits": film_type.limits,
        "frame": FRAME,
        **given,
        "length_ratio": float(part.length_ratio),
        "clearance_ratio": float(part.clearance_ratio),
        **{
            name: found.get(name)
            for name in ("eccentricity_ratio", "attitude_angle", "sommerfeld_number", "phi_p")
        },
        "phi_t": found["phi_t"],
        "friction_torque": math.copysign(found["friction_torque"], given["speed"]),
        "friction_power": found["friction_torque"] * speed,
        "bush_torque": _signed(found.get("bush_torque"), given["speed"]),
        "minimum_film": found.get("minimum_film"),
        "peak_pressure": peak,
        "side_flow": None if flow is None else flow * gap * radius * speed * given["length"],
        **{
            name: found.get(name)
            for name in (
                "stiffness",
                "damping",
                "dimensionless_stiffness",
                "dimensionless_damping",
                "critical_mass",
                "whirl_ratio",
            )
        },
    }
    if field is not None:
        # [MPa] over the angle from the load and the place along the bearing, for the picture
        field = {**field, "pressure": field["pressure"] * unit}
    return {name: _finite(value) for name, value in result.items()}, field


@functools.cache
def _program():
    import equinox as eqx

    return eqx.filter_jit(_numbers)


def _numbers(part, load, speed) -> dict[str, Any]:
    """Everything that the model gives, in one compiled program."""
    import jax.numpy as jnp

    from ..film import (
        AbstractCarryingFilm,
        AbstractSolvedFilm,
        bush_moment,
        coefficients_per_load,
        film_ratio,
        film_state,
        friction_moment,
        load_number,
        prepare,
        stability_threshold,
        stiffness_damping,
    )

    still = {"rest_speed": 0.0}
    part = prepare(part)
    film, gap = part.film, part.bearing.radial_clearance
    number = load_number(part, load, speed, **still)
    out = {
        "phi_p": number,
        "sommerfeld_number": 1 / (2 * jnp.pi * number),
        "phi_t": film.friction_number(number),
        "friction_torque": friction_moment(part, load, speed, **still),
    }
    if isinstance(film, AbstractCarryingFilm):
        x = film_ratio(film, number)
        out |= {
            "eccentricity_ratio": x / (1 + x),
            "minimum_film_ratio": 1 / (1 + x),
            "minimum_film": gap / (1 + x),
        }
    if isinstance(film, AbstractSolvedFilm):
        stiffness, damping = stiffness_damping(part, jnp.stack([load, 0.0 * load]), speed, **still)
        per_load = coefficients_per_load(film, number)
        threshold = stability_threshold(film, number)
        out |= {
            "attitude_angle": film_state(film, number).attitude_angle,
            "bush_torque": bush_moment(part, load, speed, **still),
            "stiffness": stiffness,
            "damping": damping,
            "dimensionless_stiffness": per_load.stiffness,
            "dimensionless_damping": per_load.damping,
            "critical_mass": threshold.critical_mass * load / (gap * speed**2),
            "whirl_ratio": threshold.whirl_ratio,
            "film_ratio": x,
            "length_ratio": part.bearing.length_ratio,
        }
    return out


# Closer than this the film is solved at this gap; pressure grows with its power -1.5 (thin zone).
_CLOSEST = 1e-4
_GRIDS = ((60, 8), (120, 16), (240, 32))


def _field(film_type, found) -> dict[str, Any] | None:
    """Pressure over eta omega/psi^2 where the model has one, peak and side flow."""
    import numpy as np

    from ..film import GroovedReynolds, Guembel, Ocvirk, Reynolds, reference_solution

    if film_type not in (Reynolds, GroovedReynolds, Guembel, Ocvirk):
        return None
    ratio, closeness = found["length_ratio"], found["minimum_film_ratio"]
    held = max(closeness, _CLOSEST)
    closer = (held / closeness) ** 1.5
    eps = found["eccentricity_ratio"] if held == closeness else 1 - held
    options = {
        Guembel: {"cavitation": "guembel"},
        GroovedReynolds: {"grooved": True},
    }.get(film_type, {})
    solved = reference_solution(eps, ratio, coefficients=False, grids=_GRIDS, **options)
    pressure, peak, flow = solved.pressure * closer, solved.peak_pressure * closer, solved.side_flow
    if film_type is Ocvirk:
        x = found["film_ratio"]
        # the largest pressure lies where (1 + eps cos) cos = -3 eps sin^2
        e = x / (1 + x)
        top = np.arccos(np.clip((1 - np.sqrt(1 + 24 * e**2)) / (4 * e) if e else 0.0, -1, 1))
        film = Ocvirk(ratio)
        pressure = np.asarray(film.pressure(x, solved.theta[:, None], solved.zeta))
        peak = float(film.pressure(x, top, 0.0))
        flow = e  # all oil between the thickest and the thinnest film leaves through the ends
    return {
        "angle": np.degrees(solved.theta - np.pi + found["attitude_angle"]),
        "zeta": solved.zeta,
        "pressure": pressure,
        "peak": peak,
        "flow": flow,
    }


def _models() -> dict[Model, Any]:
    from .. import film

    return {
        Model.reynolds: film.Reynolds,
        Model.grooved: film.GroovedReynolds,
        Model.guembel: film.Guembel,
        Model.ocvirk: film.Ocvirk,
        Model.fit: film.ExplicitFit,
        Model.petroff: film.Petroff,
        Model.loaded_petroff: film.LoadedPetroff,
    }


def _signed(value: float | None, speed: float) -> float | None:
    return None if value is None else math.copysign(1.0, speed) * value


def _finite(value: Any) -> Any:
    """None in place of what has a number that is not finite."""
    if isinstance(value, list):
        flat = [entry for row in value for entry in (row if isinstance(row, list) else [row])]
        return value if all(map(math.isfinite, flat)) else None
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _short(value: float) -> str:
    return f"{value:.6g}"
