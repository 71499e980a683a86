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

# Notes that stand in braces in the place of a unit. Quantities and numbers of a machine listed by their
# names each have their unit behind their name; two units are those that the result has under a key.
_NAMED = Said("by name, with the unit that the registry or the result has for the name")
_ROOT = (Said("vibration_unit"), Said("correction_unit"))
_SAID = {
    "beside": Said("in the unit that stands beside it"),
    "quantity": Said("in the unit of the quantity"),
    "number": Said("in the unit of the number of the machine"),
    "ratio": Said("in the unit of the quantity over that of the number"),
    "mixed": Said("in metres along x, y and z and in radians about them"),
    "option": Said("as the option was given"),
    "bytes": Said("in bytes"),
    "parameters": Said("in the units of the parameters"),
    "celsius": Said("in SI units, temperatures in degrees Celsius"),
    "file": Said("as it stands in the file"),
    "efficiency": Said("an efficiency, or of a response a displacement in metres"),
    "named": _NAMED,
    **{str(one): one for one in _ROOT},
}

# By the name of the command; `jaxcomp schema --results` prints what follows from them. A line has keys
# with their unit, several separated by semicolons, behind the places that hold them.
_TEXTS = {
    "run": """
        motor_work, gas_work, losses [J]; lowest_speed, highest_speed [rad/s]
        peak_forces, mean_forces [N]; period [s]; stroke [m]
        energy_residual, residual, resolution, loss_share, iterations, tolerance, cycle_resolution
        rod_load_reversal.*: angle [rad]; share
        verification: speed, period, mechanical_efficiency, losses, peak_forces, closure, steps
        moved_films.*: film_thickness [m]; loss [W]
        vibration: harmonics; natural_frequencies [rad/s]; block_amplitude, block_rms {mixed}
        vibration.points.*: position, amplitude, rms, peak, free_body [m]; free_body_error
        torsion: natural_frequencies, critical_speeds [rad/s]; mean_torque, peak_torque [N m]
        torsion: largest_order
    """,
    "animate": "speed [rad/s]; largest_before, largest_after [m]; improvement",
    "simulate": """
        end_time, time_of_highest_speed, power_off [s]; end_speed, highest_speed [rad/s]
        motor_work, gas_work, losses, kinetic_energy_gained [J]
        end_angle [rad]; delivered_mass [kg]; highest_pressure [Pa]; highest_temperature [K]
        revolutions, energy_residual, steps, tolerance
        course: time [s]; angle [rad]; speed [rad/s]
    """,
    "compare": "figures: values {beside}",
    "sensitivity": """
        quantities: value {beside}
        quantities.numbers: value {beside}; elasticity; derivative {ratio}
    """,
    "sweep": """
        shape, designs, failed
        variables.*: low, high, present, value, values, gradient, nominal, deviation {beside}
        quantities.*: lowest, highest, mean, mean_error, deviation, deviation_error {beside}
        quantities.*: percentiles {beside}; best {named}
        quantities.*.best_curve.points: across, best, between {number}; value {quantity}
        quantities.*: values {beside}
    """,
    "tolerance": """
        corrections [kg m]
        variables.*: low, high, present, value, values, gradient, nominal, deviation {beside}
        variables.*: sigmas
        correlations: value
        samples, failed
        quantities.*: lowest, highest, mean, mean_error, deviation, deviation_error {beside}
        quantities.*: percentiles, nominal {beside}; skewness
        quantities.*.first_order|quantities.*.second_order: mean, deviation {quantity}
        quantities.*.contributors: share; at_low_limit, at_high_limit {quantity}
        limits: bound {quantity}; sampled, sampled_interval, beta, first_order, second_order
        limits: near_points, near_points_error, nearest_points, importance
        limits: most_likely_design {named}
        permitted: factor, rejects, before
    """,
    "optimise": """
        asked: * {option}
        variables|objective: low, high, present, value, values, gradient {beside}
        variables|objective: nominal, deviation {beside}
        objectives:
        constraints: * {beside}
        quantities {named}; stationarity, agreeing, evaluations, beaten_by
        local: * {number}
        starts: start, values, path {number}; objective, objectives {quantity}
        starts: violation, stationarity, steps, slopes
        comparison: present, optimum {beside}
        present {named}
        points: values, objectives {named}; exchange {ratio}
        sample: count, solved, feasible; best_objective {quantity}
        seconds [s]
    """,
    "map": """
        evaporating, condensing [K]
        values|polynomial_error: power [W]; * {named}
        coefficients: * {celsius}
        fit_error
    """,
    "identify": """
        parameters: start, estimate, standard_error {beside}; prior_share
        covariance {parameters}; chi_square, freedom, p_value
        held_out: points, error_rms, largest_error, share_inside
        predicted: value, model_sd, half_width {beside}
    """,
    "modes": """
        degrees_of_freedom, magnetic_pull_limit; speeds [rad/s]
        modes: frequency, growth [rad/s]; damping_ratio, whirl
        growth [rad/s]
        campbell: speeds, frequency, growth [rad/s]; damping_ratio, whirl
        campbell.critical_speeds: speed, frequency, growth [rad/s]; damping_ratio, whirl
    """,
    "update": """
        variables: factor; before, after, standard_error {number}
        modes: measured, before, after [rad/s]; mode, error
        steps
    """,
    "respond": """
        degrees_of_freedom, magnetic_pull_limit; speeds [rad/s]; orders
        nodes.*.amplitude: ux, uy, uz [m]; * [rad]
        nodes.*.phase: * [rad]
        nodes.*: major_axis, minor_axis [m]; inclination [rad]
        links.*: ux, uy, uz [N]; * [N m]
        correction
        curves: speeds [rad/s]; major_axis [m]
        linearised.*: major_axis [m]
        linearised.*.films.*: stiffness [N/m]; damping [N s/m]
    """,
    "balance": """
        planes: correction {correction_unit}; unbalance [kg m]; phase [rad]; radius [m]; mass [kg]
        rows: speed [rad/s]; weight; before, after, sensitivity {vibration_unit}
        rows: before_phase, after_phase [rad]
        worse, improvement, condition, gap; objective, bound {vibration_unit}
    """,
    "bearing": """
        diameter, length, clearance, minimum_film, film_error, table_error [m]
        steady_film, contact_roughness [m]
        speed, journal_speed, bush_speed, least_friction_speed [rad/s]
        attitude_angle, minimum_film_angle, table_period, period [rad]
        load, contact_load [N]; friction_torque, bush_torque, contact_torque [N m]
        friction_power, mean_loss, mean_shear_loss, mean_squeeze_loss, mean_contact_loss [W]
        peak_pressure, contact_modulus [Pa]; side_flow, mean_side_flow [m^3/s]; viscosity [Pa s]
        stiffness [N/m]; damping [N s/m]; critical_mass [kg]; temperature_rise_of_oil [K]; *
    """,
    "accuracy": """
        reference: value, other {quantity}; floor
        calls.*: first, second [s]; lines
        march: *
        error
        recommended|recommended_by_task.*|rows: seconds, compile_seconds [s]; error, iterations
        recommended|recommended_by_task.*|rows: flops, tightness, lines, floor, speed_error, margin
        recommended|recommended_by_task.*|rows: value {efficiency}
        cheapest [s]
        derivatives: *
        measured_on: cores, load
    """,
    "check": """
        parts.*: values, defaults, without_source
        follows: value {beside}
        unusual: * {beside}
        errors: value {file}
    """,
    "cache": "programs; size {bytes}",
    "list": "values.*|variables.*: value, given {beside}",
    "explain": "",
}
_GROUP = re.compile(r" *(?P<keys>[^[{]*?) *(\[(?P<unit>.*)\]|\{(?P<note>.*)\})?")


def _table(text: str) -> Table:
    table: dict[str, Any] = {}
    for line in text.split("\n"):
        places, colon, groups = line.strip().rpartition(":")
        for place in places.split("|"):
            there = table
            for key in place.split(".") if colon else ():
                there = there.setdefault(key, {})
            for one in filter(None, map(_GROUP.fullmatch, groups.split(";"))):
                unit = _SAID[one["note"]] if one["note"] else one["unit"] or ""
                there |= dict.fromkeys(filter(None, one["keys"].split(", ")), unit)
    return table


TABLES = {command: _table(text) for command, text in _TEXTS.items()}


def table_of(command: str) -> Table:
    """The numbers of a command's result; a run has the registered quantities among them.

    A result that is written without any command counts as that of a run.
    """
    table = TABLES.get(command, TABLES["run"])
    if table in (TABLES["run"], TABLES["animate"]):
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
