"""Units of what commands print beside results of the library, and the JSON schema of all results."""

from operator import attrgetter
from typing import Any

import jaxcomp as jc

from .._core.nested import SCHEMAS, Table, merged, schema_of, units_table
from .._core.registry import registered

# By the name of the command.
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
    "sweep": """
        shape, designs, failed
        variables.*: low, high, present, value, values, gradient, nominal, deviation {beside}
        quantities.*: lowest, highest, mean, mean_error, deviation, deviation_error {beside}
        quantities.*: percentiles {beside}; best {named}
        quantities.*.best_curve.points: across, best, between {number}; value {quantity}
        quantities.*: values {beside}
        layouts.*: * {quantity}
    """,
    "tolerance": "permitted: factor, rejects, before",
    "optimise": """
        asked: * {option}
        comparison: present, optimum {beside}
        seconds [s]
    """,
    "identify": "predicted: value, model_sd, half_width {beside}",
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
# Commands that print results of the library, whose classes have the units of their numbers.
_RESULTS: dict[str, tuple[str, ...]] = {
    "balance": ("balancing.Balance",),
    "compare": ("study.Comparison",),
    "identify": ("study.Identification",),
    "map": ("study.rating.RatingMap",),
    "optimise": ("study.Optimum", "study.ParetoFront"),
    "sensitivity": ("study.Sensitivity",),
    "tolerance": ("study.tolerance.Tolerances",),
}
COMMANDS = tuple({**_TEXTS, **_RESULTS})


def table_of(command: str) -> Table:
    """The numbers of a command's result; a run has the registered quantities among them.

    A result that is written without any command counts as that of a run.
    """
    classes = (attrgetter(name)(jc) for name in _RESULTS.get(command, ()))
    other = "" if command in _RESULTS else _TEXTS["run"]
    table = units_table(_TEXTS.get(command, other))
    table = merged(table, *(one.units_of_nested() for one in classes))
    if command in ("run", "animate") or command not in COMMANDS:
        return {one.family or one.name: one.unit for one in registered()} | table
    return table


# ------------------------------------------------------------------- schema
def results_schema() -> dict[str, Any]:
    """JSON schema of the results of all commands, each under its name in `$defs`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of jaxcomp",
        "description": "What commands print with --json and write to result.json, each under its name. "
        "Numbers are in SI units; a key has the unit behind it, in brackets.",
        "$defs": {name: schema_of(table_of(name)) for name in COMMANDS} | SCHEMAS,
    }
