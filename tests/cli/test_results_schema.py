"""Results of all commands against the JSON schema of results, which follows from tables of units."""

import json
import re

import pint
import pytest
from helpers import results_validator
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from jaxcomp._core.nested import UnitNote, with_units
from jaxcomp.cli import app
from jaxcomp.cli._units import COMMANDS, results_schema, table_of

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
    assert {*COMMANDS} < {*schema["$defs"]}


def test_a_number_without_its_unit_does_not_fit():
    good = with_units(
        {"machine": "one", "mean_speed": 100.0, "losses": {"wall": 1.0}}, table_of("run")
    )
    assert set(good) == {"machine", "mean_speed [rad/s]", "losses [J]"}
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
    step = {"name": "full load", "mass_flow": 0.8, "stage_pressures": {"1": 2.4e6}}
    table = table_of("run")
    assert wrong_places(with_units({"load_steps": {"steps": [step]}}, table), "run") == []
    # nothing but the name goes without its unit
    assert wrong_places({"load_steps": {"steps": [step]}}, "run")


def test_a_quantity_keeps_its_own_unit_where_a_key_elsewhere_means_something_else():
    load = {"measured_on": {"load": 1.5, "cores": 2}, "rows": [{"error": 1e-3, "seconds": 0.1}]}
    found = with_units(load, table_of("accuracy"))
    assert found["measured_on"] == {"load": 1.5, "cores": 2}  # of the computer, no force
    assert found["rows"] == [{"error": 1e-3, "seconds [s]": 0.1}]
    errors = with_units(
        {"fit_error": {"power": 0.1}, "values": {"power": [[1.0]], "cop": []}}, table_of("map")
    )
    assert errors == {"fit_error": {"power": 0.1}, "values": {"power [W]": [[1.0]], "cop": []}}
    # of a balance any unit of the vibration, or none, and of its phase the one alone
    for key in ("before [m/s]", "before [m]", "before", "before_phase [rad]"):
        assert wrong_places({"rows": [{key: 1.0}]}, "balance") == [], key
    for key in ("before_phase", "speed", "speed [m/s]"):
        assert wrong_places({"rows": [{key: 1.0}]}, "balance") == [["rows"]], key


def units_in(table):
    for told in table.values():
        if not isinstance(told, str):
            yield from units_in(told)
        elif not isinstance(told, UnitNote):
            yield told


def test_tables_have_units_of_si():
    registry = pint.UnitRegistry()
    for unit in {*(unit for name in COMMANDS for unit in units_in(table_of(name)))} - {""}:
        powers = re.sub(r"(?<=\w) (?=\w)", " * ", unit)
        assert registry.Quantity(1, powers).to_base_units().magnitude == pytest.approx(1), unit
