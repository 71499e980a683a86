"""JSON whose keys carry the SI unit of what they hold, as `mean_speed [rad/s]`."""

import json
import math
import sys
from typing import Any

import typer

from .._registry import registered

# Keys that are no quantities of the registry, which has the units of those.
_BY_UNIT = {
    "": ("vibration", "rod_load_reversal"),  # of a suspended block, by what is measured
    "J": ("motor_work", "gas_work", "losses", "kinetic_energy_gained"),
    "N": ("mean_forces", "peak_forces", "load"),
    "N m": ("friction_torque", "bush_torque"),
    "s": ("period", "seconds", "end_time", "time_of_highest_speed", "time", "power_off"),
    "m": (
        "stroke", "length", "diameter", "clearance", "minimum_film", "major_axis", "minor_axis",
        "position", "rms", "peak", "free_body", "radius", "largest_before", "largest_after",
    ),
    "m^3/s": ("side_flow",),
    "rad": ("phase", "before_phase", "after_phase", "inclination", "attitude_angle", "angle",
        "end_angle"),
    "rad/s": (
        "lowest_speed", "highest_speed", "speed", "speeds", "frequency", "growth",
        "natural_frequencies", "measured", "end_speed",
    ),
    "Pa": ("peak_pressure",),
    "Pa s": ("viscosity",),
    "N/m": ("stiffness",),
    "N s/m": ("damping",),
    "kg": ("mass", "critical_mass"),
    "kg m": ("unbalance", "corrections"),
}  # fmt: skip
_UNITS = {key: unit for unit, keys in _BY_UNIT.items() for key in keys}
# Directions, whose unit follows from what they are a direction of: of ux, uy, uz, and of rotations.
_DIRECTIONS = {"amplitude": ("m", "rad"), "phase": ("rad", "rad"), "links": ("N", "N m")}


def _unit_of(key: str) -> str:
    known = (one.unit for one in registered() if key in (one.name, one.family))
    return _UNITS[key] if key in _UNITS else next(known, "")


def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers for JSON; of complex numbers the magnitudes.

    A number that is not finite becomes `None`.
    """
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, complex):
        value = abs(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def keyed(result: Any, of: str = "", units: dict[str, str] | None = None) -> Any:
    """A result with the SI unit of every number in its key.

    What stands beside a key `unit` is in that unit and keeps its name.

    Args:
        result: as the commands make it.
        of: what it is a part of.
        units: of keys that mean something else in this result.
    """
    if isinstance(result, list | tuple):
        return [keyed(one, of, units) for one in result]
    if not isinstance(result, dict):
        return result
    units = (units or {}) | _own_units(result)
    out = {}
    for key, value in result.items():
        unit = "" if "unit" in result else units.get(key, _unit_of(key))
        if of in _DIRECTIONS and key[:2] in ("ux", "uy", "uz", "th"):
            unit = _DIRECTIONS[of][key.startswith("th")]
        by_name = isinstance(value, dict)
        if isinstance(value, bool | str) or (by_name and (key in _DIRECTIONS or "unit" in value)):
            unit = ""
        inside = key if key in _DIRECTIONS else of
        # what is listed by name beneath a unit has that unit
        out[f"{key} [{unit}]" if unit else key] = (
            value if by_name and unit else keyed(value, inside, units)
        )
    return out


def _own_units(result: dict[str, Any]) -> dict[str, str]:
    """Units that the result itself names, or that follow from what it is."""
    own = {}
    for value in result.values():  # of variables and quantities that are listed with their units
        listed = value if isinstance(value, list | tuple) else [value]
        for one in listed:
            if isinstance(one, dict) and "unit" in one and "name" in one:
                own[one["name"]] = one["unit"]
            elif isinstance(one, dict):
                own |= {
                    name: inner["unit"]
                    for name, inner in one.items()
                    if isinstance(inner, dict) and "unit" in inner
                }
    if "vibration_unit" in result:
        vibration = result["vibration_unit"]
        own |= dict.fromkeys(("before", "after", "sensitivity", "objective", "bound"), vibration)
        own["correction"] = result["correction_unit"]
    if "measured" in result and "error" in result:  # a frequency before and after a fit
        own |= {"before": "rad/s", "after": "rad/s"}
    if "closure" in result:  # relative errors of an orbit
        own |= {"speed": "", "period": ""}
    if "rms" in result and "free_body" in result:
        own["amplitude"] = "m"
    return own


def json_text(result: dict[str, Any], *, ascii_only: bool = False) -> str:
    """One JSON object; a number that is not finite would be a fault and is refused."""
    return json.dumps(keyed(result), indent=2, allow_nan=False, ensure_ascii=ascii_only)


def print_json(result: dict[str, Any]) -> None:
    """Print one JSON object on standard output, in ASCII where that takes no other signs."""
    utf = (sys.stdout.encoding or "").lower().startswith("utf")
    typer.echo(json_text(result, ascii_only=not utf))
