"""Units of what commands print beside results of the library, and the JSON schema of all results."""

from operator import attrgetter
from typing import Any

import jaxcomp as jc

from .._core.nested import SCHEMAS, Table, merged, schema_of, units_table
from .._core.registry import registered

# By the name of the command: of what it has beside a result of the library.
_TEXTS = {
    "run": "tolerance",
    "animate": "frames, energy_residual; speed [rad/s]; largest_before, largest_after [m]; improvement",
    "simulate": "tolerance; power_off [s]",
    "sweep": """
        shape, designs, failed
        failed_by_status: *
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
    "check": """
        examples
        parts.*: values, defaults, without_source
        follows: value {beside}
        unusual: * {beside}
        errors: value {file}
    """,
    "cache": "programs; size {bytes}",
    "pulsation": """
        speed, lowest_speed, highest_speed [rad/s]; orders
        resonances: number, quality, margin, nearest_order; frequency [Hz]
        resonances.crossings: order; speed [rad/s]
        solved: resolution, linear_error, mach
        solved.pressures: * [Pa]
        solved.spectra: * [Pa]
        solved.limits: order, value, allowed, margin
        solved.approach_1.*: value, allowed
        solved.shaking: * [N]
        solved.pressure_drop: * [Pa]
    """,
    "list": """
        values.*|variables.*: value, given {beside}
        fluids: lowest, highest, critical_temperature [K]; highest_pressure [Pa]
        blends: lowest, highest, glide [K]
        blends.mass_fractions: *
    """,
    "explain": "",
}
# Commands that print results of the library, whose classes have the units of their numbers.
_RESULTS: dict[str, tuple[str, ...]] = {
    "accuracy": ("study.accuracy.Report", "study.accuracy.Extremes"),
    "balance": ("balancing.Balance",),
    "bearing": ("film.SteadyBearing", "film.StribeckCurve", "crank.LoadedJournal"),
    "compare": ("study.Comparison",),
    "identify": ("study.Identification",),
    "map": ("study.rating.RatingMap",),
    "modes": ("rotor.RotorModes", "campbell: rotor.CampbellDiagram"),
    "optimise": ("study.Optimum", "study.ParetoFront"),
    "respond": ("vibration.RotorMotion", "curves: vibration.MotionOverSpeed"),
    "run": (
        "study.SteadyState",
        "load_steps: study.LoadSteps",
        "vibration: vibration.BlockVibration",
        "torsion: crank.TrainTorques",
        "api_618: study.ProcessSheet",
    ),
    "sensitivity": ("study.Sensitivity",),
    "simulate": ("crank.Transient",),
    "tolerance": ("study.tolerance.Tolerances",),
}
COMMANDS = tuple({**_TEXTS, **_RESULTS})


def beside_of(command: str) -> Table:
    """The numbers of a command beside its result of the library."""
    return units_table(_TEXTS.get(command, ""))


def table_of(command: str) -> Table:
    """The numbers of a command's result.

    A result that is written without any command counts as that of a run.
    """
    if command not in COMMANDS:
        command = "run"
    table = beside_of(command)
    for name in _RESULTS.get(command, ()):
        key, _, name = name.rpartition(": ")
        kind = attrgetter(name)(jc)
        if not hasattr(kind, "nested"):
            continue
        units = kind.units_of_nested()
        if key:
            units = {key: units}
        table = merged(table, units)
    if command == "animate":
        of_quantities = {}
        for quantity in registered():
            of_quantities[quantity.family or quantity.name] = quantity.unit
        table = of_quantities | table
    return table


# ------------------------------------------------------------------- schema
def results_schema() -> dict[str, Any]:
    """JSON schema of the results of all commands, each under its name in `$defs`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of jaxcomp",
        "description": "What commands print with --json and write to result.json, each under its name. "
        "Numbers are in SI units; a key has the unit behind it, in brackets.",
        "$defs": {name: _schema_of_command(name) for name in COMMANDS} | SCHEMAS,
    }


def _schema_of_command(name: str) -> dict[str, Any]:  # TRANSITION
    from .._core import declared

    document = schema_of(table_of(name))
    for entry in _RESULTS.get(name, ()):
        key, _, path = entry.rpartition(": ")
        kind = attrgetter(path)(jc)
        if hasattr(kind, "nested"):
            continue
        if key:
            document["properties"][key] = declared._listed(declared.schema_of(kind))
        else:
            own = declared.schema_of(kind)
            document["properties"] |= own["properties"]
            document["patternProperties"] |= own["patternProperties"]
    return document
