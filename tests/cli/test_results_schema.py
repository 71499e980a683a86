"""Results of all commands against the JSON schema that follows from the classes of results."""

import json
import re

import pint
import pytest
from helpers import results_validator
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from jaxcomp._core.declared import Note, declarations, kind_of
from jaxcomp.cli import app
from jaxcomp.cli._answers import answers, results_schema

RUNNER = CliRunner()
BORE = ("--variable", "mechanism.bore=120mm:140mm")
FEW = ("--objective", "swept_volume", "--minimise", "--starts", 1, "--samples", 8)
VOLUME = ("--quantity", "swept_volume")
LIMIT = ("--vary", "mechanism.bore=+-1%", "--limit", "swept_volume<=1330 cm^3", "--samples", 256)
BEARING = ("--diameter", "30mm", "--length", "25mm", "--clearance", "15um", "--speed", "3000rpm")
MOTOR = "motor={type = 'kloss', pull_out_torque = '250 N m', pull_out_slip = 0.3, \
synchronous_speed = '1050 rpm'}"
QUICK = [
    ("list",),
    ("list", "fluids"),
    ("list", "mayekawa-wbhe"),
    ("list", "--variables", "mayekawa-wbhe"),
    ("explain", "slider-crank"),
    ("cache",),
    ("check", "hermetic-68cc"),
    ("bearing", *BEARING, "--load", "2kN", "--viscosity", "10 mPa s"),
    ("sweep", "mayekawa-wbhe", "--over", "bore_at_displacement=120mm:130mm:3", *VOLUME),
    ("tolerance", "mayekawa-wbhe", *VOLUME, *LIMIT),
    ("optimise", "mayekawa-wbhe", *BORE, *FEW),
]
# What other tests print or write of these commands is checked as well, in `conftest.py`.
LONG = [
    ("run", "mayekawa-wbhe", "--verify"),
    ("balance", "hermetic-68cc"),
    ("run", "refrigeration-twin-block"),
    ("run", "slider-link-8cc"),
    ("run", "two-stage-crosshead"),
    ("run", "r134a-7cc"),
    ("compare", "mayekawa-wbhe", "--with", "motor.mean_speed=800rpm"),
    ("sensitivity", "mayekawa-wbhe"),
    ("simulate", "mayekawa-wbhe", "--duration", "1s", "--set", MOTOR),
    ("respond", "hermetic-68cc", "--speeds", "600rpm:3600rpm:4"),
    ("modes", "hermetic-68cc", "--speeds", "0rpm:6000rpm:4"),
    ("optimise", "mayekawa-wbhe", *BORE, *FEW, "--pareto", "mechanical_efficiency", "--points", 3),
    ("accuracy", "mayekawa-wbhe", "--study", "film", "--error", "1e-3"),
    ("accuracy", "mayekawa-wbhe"),
]


def wrong_places(result, command):
    return [list(error.absolute_path) for error in results_validator(command).iter_errors(result)]


def check(arguments):
    done = RUNNER.invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    assert wrong_places(json.loads(done.stdout), arguments[0]) == []


@pytest.mark.parametrize("arguments", QUICK, ids=lambda a: "-".join(map(str, a[:3])))
def test_results_fit_their_schema(arguments):
    check(arguments)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", LONG, ids=lambda a: "-".join(map(str, a[:3])))
def test_results_of_longer_work_fit_their_schema(arguments):
    check(arguments)


def test_the_schema_is_printed():
    done = RUNNER.invoke(app, ["schema", "--results"])
    schema = json.loads(done.stdout)
    assert schema == results_schema()
    Draft202012Validator.check_schema(schema)
    assert {*answers()} < {*schema["$defs"]}


def test_a_number_without_its_unit_does_not_fit():
    good = {"machine": "one", "mean_speed [rad/s]": 100.0, "losses [J]": {"wall": 1.0}}
    assert wrong_places(good, "run") == []
    for key in ("mean_speed", "mean_speed [rpm]", "unheard_of", "unheard_of [N]"):
        assert len(wrong_places({**good, key: 1.0}, "run")) == 1, key
    assert wrong_places({**good, "losses [J]": "much"}, "run") == [["losses [J]"]]
    link = {"links": {"mount": {"ux [N]": [1.0], "thx [N m]": [1.0]}}}
    assert wrong_places(link, "respond") == []
    link["links"]["mount"]["uz"] = [1.0]
    assert wrong_places(link, "respond") == [["links"]]


def test_load_steps_fit_the_schema_of_a_run():
    """Each has its name, which is no number, and the pressures between its stages by their numbers."""
    step = {"name": "full load", "mass_flow [kg/s]": 0.8, "stage_pressures [Pa]": {"1": 2.4e6}}
    assert wrong_places({"load_steps": {"steps": [step]}}, "run") == []
    # nothing but the name goes without its unit
    step["mass_flow"] = step.pop("mass_flow [kg/s]")
    assert wrong_places({"load_steps": {"steps": [step]}}, "run")


def units_in(kind):
    """Units of a class and of all records within it."""
    yield from kind.units_by_name().values()
    for declaration in declarations(kind).values():
        if declaration.kind is not None:
            yield from units_in(kind_of(declaration))
        elif declaration.unit and not isinstance(declaration.unit, Note):
            yield declaration.unit


def test_units_are_those_of_si():
    registry = pint.UnitRegistry()
    units = set()
    for kinds in answers().values():
        for kind in kinds:
            units |= {*units_in(kind)}
    assert len(units) > 15
    for unit in units - {""}:
        powers = re.sub(r"(?<=\w) (?=\w)", " * ", unit)
        assert registry.Quantity(1, powers).to_base_units().magnitude == pytest.approx(1), unit
