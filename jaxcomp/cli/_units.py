"""SI units of the numbers that commands give as JSON, and the JSON schema that follows from them.

A table names every number of a result by its key, `*` any key beside those that are named. What a table
does not name is no number. A list has the table of its entries, and a unit stands for all numbers
beneath a key: one, a list, or several by name.
"""

import re
from collections.abc import Mapping
from typing import Any, Union

from .._core.registry import registered, registered_quantity


class Said(str):
    """Where the unit of a number is said that is not in its key."""


Table = Mapping[str, Union[str, "Table"]]

_BESIDE = Said("in the unit that stands beside it")
_OF_QUANTITY = Said("in the unit of the quantity")
_OF_NUMBER = Said("in the unit of the number of the machine")
_RATIO = Said("in the unit of the quantity over that of the number")
_MIXED = Said("in metres along x, y and z and in radians about them")
_OPTION = Said("as the option was given")
# Quantities and numbers of a machine listed by their names, each with its unit behind its name.
_NAMED = Said("by name, with the unit that the registry or the result has for the name")
# A unit that the result has under that key.
_VIBRATION, _CORRECTION = Said("vibration_unit"), Said("correction_unit")
_ROOT = (_VIBRATION, _CORRECTION)


def _pure(*keys: str) -> dict[str, str]:
    return _of("", *keys)


def _of(unit: str, *keys: str) -> dict[str, str]:
    return dict.fromkeys(keys, unit)


_MOTION = {"ux": "m", "uy": "m", "uz": "m", "*": "rad"}
_FORCES = {"ux": "N", "uy": "N", "uz": "N", "*": "N m"}
_RUN: Table = {
    **_of("J", "motor_work", "gas_work", "losses"),
    **_of("rad/s", "lowest_speed", "highest_speed"),
    **_of("N", "peak_forces", "mean_forces"),
    "period": "s",
    "stroke": "m",
    **_pure("energy_residual", "residual", "resolution", "loss_share", "iterations", "tolerance"),
    **_pure("cycle_resolution"),
    "rod_load_reversal": {"*": {"angle": "rad", "share": ""}},
    "verification": _pure(
        "speed", "period", "mechanical_efficiency", "losses", "peak_forces", "closure", "steps"
    ),
    "moved_films": {"*": {"film_thickness": "m", "loss": "W"}},
    "vibration": {
        "harmonics": "",
        "natural_frequencies": "rad/s",
        **_of(_MIXED, "block_amplitude", "block_rms"),
        "points": {
            "*": {
                **_of("m", "position", "amplitude", "rms", "peak", "free_body"),
                "free_body_error": "",
            }
        },
    },
    "torsion": {
        **_of("rad/s", "natural_frequencies", "critical_speeds"),
        **_of("N m", "mean_torque", "peak_torque"),
        "largest_order": "",
    },
}
_ROTOR = _pure("degrees_of_freedom", "magnetic_pull_limit") | {"speeds": "rad/s"}
_MODES = _of("rad/s", "frequency", "growth") | _pure("damping_ratio", "whirl")
_BEARING = {
    **_of("m", "diameter", "length", "clearance", "minimum_film", "film_error", "table_error"),
    **_of("m", "steady_film", "contact_roughness"),
    **_of("rad/s", "speed", "journal_speed", "bush_speed", "least_friction_speed"),
    **_of("rad", "attitude_angle", "minimum_film_angle", "table_period", "period"),
    **_of("N", "load", "contact_load"),
    **_of("N m", "friction_torque", "bush_torque", "contact_torque"),
    **_of("W", "friction_power", "mean_loss", "mean_shear_loss", "mean_squeeze_loss"),
    **_of("W", "mean_contact_loss"),
    **_of("Pa", "peak_pressure", "contact_modulus"),
    **_of("m^3/s", "side_flow", "mean_side_flow"),
    "viscosity": "Pa s",
    "stiffness": "N/m",
    "damping": "N s/m",
    "critical_mass": "kg",
    "temperature_rise_of_oil": "K",
    "*": "",
}
_SETTING = {
    **_of("s", "seconds", "compile_seconds"),
    **_pure("error", "iterations", "flops", "tightness", "lines", "floor"),
    **_pure("speed_error", "margin"),
    "value": Said("an efficiency, or of a response a displacement in metres"),
}
_VARIABLE = _of(
    _BESIDE, "low", "high", "present", "value", "values", "gradient", "nominal", "deviation"
)
_SPREAD = _of(
    _BESIDE,
    "lowest",
    "highest",
    "mean",
    "mean_error",
    "deviation",
    "deviation_error",
    "percentiles",
)
_SAMPLE = _pure("count", "solved", "feasible") | {"best_objective": _OF_QUANTITY}
_LISTED = {"*": {"value": _BESIDE, "given": _BESIDE}}

# By the name of the command; `jaxcomp schema --results` prints what follows from them.
TABLES: dict[str, Table] = {
    "run": _RUN,
    "animate": _of("rad/s", "speed") | _of("m", "largest_before", "largest_after")
    | _pure("improvement"),
    "simulate": {
        **_of("s", "end_time", "time_of_highest_speed", "power_off"),
        **_of("rad/s", "end_speed", "highest_speed"),
        **_of("J", "motor_work", "gas_work", "losses", "kinetic_energy_gained"),
        "end_angle": "rad",
        "delivered_mass": "kg",
        "highest_pressure": "Pa",
        "highest_temperature": "K",
        **_pure("revolutions", "energy_residual", "steps", "tolerance"),
        "course": {"time": "s", "angle": "rad", "speed": "rad/s"},
    },
    "compare": {"figures": {"values": _BESIDE}},
    "sensitivity": {
        "quantities": {
            "value": _BESIDE,
            "numbers": {"value": _BESIDE, "elasticity": "", "derivative": _RATIO},
        }
    },
    "sweep": {
        **_pure("shape", "designs", "failed"),
        "variables": {"*": _VARIABLE},
        "quantities": {
            "*": {
                **_SPREAD,
                "best": _NAMED,
                "best_curve": {
                    "points": {
                        **_of(_OF_NUMBER, "across", "best", "between"),
                        "value": _OF_QUANTITY,
                    }
                },
                "values": _BESIDE,
            }
        },
    },
    "tolerance": {
        "corrections": "kg m",
        "variables": {"*": _VARIABLE | {"sigmas": ""}},
        "correlations": {"value": ""},
        **_pure("samples", "failed"),
        "quantities": {
            "*": {
                **_SPREAD,
                "nominal": _BESIDE,
                "skewness": "",
                **dict.fromkeys(
                    ("first_order", "second_order"),
                    _of(_OF_QUANTITY, "mean", "deviation"),
                ),
                "contributors": {
                    "share": "",
                    **_of(_OF_QUANTITY, "at_low_limit", "at_high_limit"),
                },
            }
        },
        "limits": {
            "bound": _OF_QUANTITY,
            **_pure("sampled", "sampled_interval", "beta", "first_order", "second_order"),
            **_pure("near_points", "near_points_error", "nearest_points", "importance"),
            "most_likely_design": _NAMED,
        },
        "permitted": _pure("factor", "rejects", "before"),
    },
    "optimise": {
        "asked": {"*": _OPTION},
        "variables": _VARIABLE,
        "objective": _VARIABLE,
        "objectives": {},
        "constraints": {"*": _BESIDE},
        "quantities": _NAMED,
        **_pure("stationarity", "agreeing", "evaluations", "beaten_by"),
        "local": {"*": _OF_NUMBER},
        "starts": {
            **_of(_OF_NUMBER, "start", "values", "path"),
            **_of(_OF_QUANTITY, "objective", "objectives"),
            **_pure("violation", "stationarity", "steps", "slopes"),
        },
        "comparison": _of(_BESIDE, "present", "optimum"),
        "present": _NAMED,
        "points": {"values": _NAMED, "objectives": _NAMED, "exchange": _RATIO},
        "sample": _SAMPLE,
        "seconds": "s",
    },
    "map": {
        **_of("K", "evaporating", "condensing"),
        **{key: {"power": "W", "*": _NAMED} for key in ("values", "polynomial_error")},
        "coefficients": {"*": Said("in SI units, temperatures in degrees Celsius")},
        "fit_error": "",
    },
    "identify": {
        "parameters": {
            **_of(_BESIDE, "start", "estimate", "standard_error"),
            "prior_share": "",
        },
        "covariance": Said("in the units of the parameters"),
        **_pure("chi_square", "freedom", "p_value"),
        "held_out": _pure("points", "error_rms", "largest_error", "share_inside"),
        "predicted": _of(_BESIDE, "value", "model_sd", "half_width"),
    },
    "modes": {
        **_ROTOR,
        "modes": _MODES,
        "growth": "rad/s",
        "campbell": {"speeds": "rad/s", **_MODES, "critical_speeds": {"speed": "rad/s", **_MODES}},
    },
    "update": {
        "variables": {"factor": "", **_of(_OF_NUMBER, "before", "after", "standard_error")},
        "modes": _of("rad/s", "measured", "before", "after") | _pure("mode", "error"),
        "steps": "",
    },
    "respond": {
        **_ROTOR,
        "orders": "",
        "nodes": {
            "*": {
                "amplitude": _MOTION,
                "phase": {"*": "rad"},
                **_of("m", "major_axis", "minor_axis"),
                "inclination": "rad",
            }
        },
        "links": {"*": _FORCES},
        "correction": "",
        "curves": {"speeds": "rad/s", "major_axis": "m"},
        "linearised": {
            "*": {
                "major_axis": "m",
                "films": {"*": {"stiffness": "N/m", "damping": "N s/m"}},
            }
        },
    },
    "balance": {
        "planes": {
            "correction": _CORRECTION,
            "unbalance": "kg m",
            "phase": "rad",
            "radius": "m",
            "mass": "kg",
        },
        "rows": {
            "speed": "rad/s",
            "weight": "",
            **_of(_VIBRATION, "before", "after", "sensitivity"),
            **_of("rad", "before_phase", "after_phase"),
        },
        **_pure("worse", "improvement", "condition", "gap"),
        **_of(_VIBRATION, "objective", "bound"),
    },
    "bearing": _BEARING,
    "accuracy": {
        "reference": {"value": _OF_QUANTITY, "other": _OF_QUANTITY, "floor": ""},
        "calls": {"*": {"first": "s", "second": "s", "lines": ""}},
        "march": {"*": ""},
        "error": "",
        "recommended": _SETTING,
        "recommended_by_task": {"*": _SETTING},
        "rows": _SETTING,
        "cheapest": "s",
        "derivatives": {"*": ""},
        "measured_on": _pure("cores", "load"),
    },
    "check": {
        "parts": {"*": _pure("values", "defaults", "without_source")},
        "follows": {"value": _BESIDE},
        "unusual": {"*": _BESIDE},
        "errors": {"value": Said("as it stands in the file")},
    },
    "cache": {"programs": "", "size": Said("in bytes")},
    "list": {"values": _LISTED, "variables": _LISTED},
    "explain": {},
}  # fmt: skip


def table_of(command: str) -> Table:
    """The numbers of a command's result; a run has the registered quantities among them.

    A result that is written without any command counts as that of a run.
    """
    table = TABLES.get(command, _RUN)
    if table in (_RUN, TABLES["animate"]):
        return {one.family or one.name: one.unit for one in registered()} | table
    return table


def with_units(result: dict[str, Any], command: str) -> dict[str, Any]:
    """A result with the SI unit of every number in its key, as `mean_speed [rad/s]`."""
    return _Keyed(result).of(result, table_of(command))


class _Keyed:
    """Puts units into keys; knows those that the result itself says, for names and for its whole."""

    def __init__(self, result: dict[str, Any]):
        self.root, self.named = result, {}
        for value in result.values():
            for one in value if isinstance(value, list | tuple) else [value]:
                self._learn(one)

    def _learn(self, one: Any) -> None:
        if isinstance(one, dict) and {"name", "unit"} <= {*one}:
            self.named[one["name"]] = one["unit"]
        elif isinstance(one, dict):
            inner = {k: v for k, v in one.items() if isinstance(v, dict) and "unit" in v}
            self.named |= {name: entry["unit"] for name, entry in inner.items()}

    def of(self, value: Any, table: Table) -> Any:
        """A part of the result with units in its keys."""
        if isinstance(value, list | tuple):
            return [self.of(one, table) for one in value]
        if not isinstance(value, dict):
            return value
        out = {}
        for key, inner in value.items():
            told = table.get(key, table.get("*", {}))
            if told is _NAMED and not isinstance(inner, dict):  # names stand beside each other
                told = self._unit(key)
            if told is _NAMED:
                out[key] = {self._key(name, self._unit(name), x): x for name, x in inner.items()}
            elif not isinstance(told, str):
                out[key] = self.of(inner, told)
            else:
                unit = self.root.get(told, "") if told in _ROOT else told
                out[self._key(key, "" if isinstance(unit, Said) else unit, inner)] = inner
        return out

    def _unit(self, name: str) -> str:
        one = registered_quantity(name)
        return self.named.get(name, one.unit if one else "")

    @staticmethod
    def _key(key: str, unit: str, value: Any) -> str:
        return f"{key} [{unit}]" if unit and not isinstance(value, bool | str) else key


# ------------------------------------------------------------------- schema
_WORDS = {"$ref": "#/$defs/words"}
_NUMBERS = {"$ref": "#/$defs/numbers"}


def results_schema() -> dict[str, Any]:
    """JSON schema of the results of all commands, each under its name in `$defs`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of jaxcomp",
        "description": "What commands print with --json and write to result.json, each under its name. "
        "Numbers are in SI units; a key has the unit behind it, in brackets.",
        "$defs": {
            **{name: _object(table_of(name)) for name in TABLES},
            "words": _any_depth("words", {"type": ["string", "boolean", "null"]}),
            "numbers": _any_depth("numbers", {"type": ["number", "null"]}),
            "stated": _any_depth("stated", {"type": ["number", "string", "boolean", "null"]}),
        },
    }


def _any_depth(name: str, one: dict[str, Any]) -> dict[str, Any]:
    again = {"$ref": f"#/$defs/{name}"}
    lists = {"type": "array", "items": again}
    return {"anyOf": [one, lists, {"type": "object", "additionalProperties": again}]}


def _object(table: Table) -> dict[str, Any]:
    """A result, or a part of it, or a list of such parts."""
    properties, patterns, others = {}, {}, _WORDS
    for key, told in table.items():
        if not isinstance(told, str):
            inner = _listed(_object(told))
            key_is, schema = key, {"anyOf": [inner, _WORDS]}
        elif told in _ROOT:
            patterns[rf"^{key}( \[.+\])?$"] = _NUMBERS | {"description": f"in the unit of `{told}`"}
            continue
        elif isinstance(told, Said):
            key_is, schema = key, {"$ref": "#/$defs/stated", "description": str(told)}
        else:
            key_is, schema = f"{key} [{told}]" if told else key, _NUMBERS
        if key == "*" and told and key_is != key:
            patterns[rf" \[{re.escape(told)}\]$"] = schema
        elif key == "*":
            others = {"anyOf": [schema, _WORDS]}
        else:
            properties[key_is] = schema
    return {
        "type": "object",
        "properties": properties,
        "patternProperties": patterns,
        "additionalProperties": others,
    }


def _listed(one: dict[str, Any]) -> dict[str, Any]:
    twice = {"type": "array", "items": one}
    return {"anyOf": [one, {"type": "array", "items": {"anyOf": [one, twice]}}]}
