"""`jaxcomp pulsation`: resonances of pipes against orders, with and without the cycle."""

import sys
from pathlib import Path

import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp.cli import app

sys.path.insert(0, str(Path(__file__).parents[1] / "scene"))
from test_piping_errors import MACHINE, PIPES

WIDE = {"COLUMNS": "200"}


def invoke(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)], env=WIDE)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("pipes") / "pipes.toml"
    path.write_text(MACHINE + PIPES, "utf-8")
    return path


@pytest.fixture(scope="module")
def quarter(tmp_path_factory):
    """A pipe of 1 m at the flange, whose far end is the line: a quarter wave of 86.8 Hz."""
    pipe = """
[[gas.suction.piping.pipes]]
nodes = ["flange", "line"]
length = "1 m"
diameter = "50 mm"
attenuation = "0.02 1/m"
[friction]
type = "slider_crank"
"""
    path = tmp_path_factory.mktemp("quarter") / "quarter.toml"
    path.write_text(MACHINE + pipe, "utf-8")
    return path


def test_resonances_and_the_speeds_at_which_orders_meet_them(quarter):
    answer = invoke("pulsation", quarter, "--speeds", "600rpm:1800rpm", "--json")
    assert answer.exit_code == 0, answer.output
    found = read_json(answer.stdout)
    first = found["resonances"][0]
    assert first["frequency"] == pytest.approx(86.7971773735, rel=1e-6)
    # pi f/(c alpha)
    assert first["quality"] == pytest.approx(3.14159265 * 86.797 / (347.1887 * 0.02), rel=1e-4)
    met = [one["order"] for one in first["crossings"]]
    assert met == [3, 4, 5, 6, 7, 8]
    assert first["nearest_order"] == 4


def test_tables_pictures_and_refusal(file, tmp_path):
    answer = invoke("pulsation", file, "--out", tmp_path / "result")
    assert answer.exit_code == 0, answer.output
    assert "suction" in answer.stdout
    assert (tmp_path / "result" / "resonances.png").exists()
    refused = invoke("pulsation", "mayekawa-wbhe")
    assert refused.exit_code != 0
    assert "gas.suction.piping" in refused.output


# a minute of compilation
@pytest.mark.slow
def test_coupled_answer(quarter):
    answer = invoke("pulsation", quarter, "--solve", "--json")
    assert answer.exit_code == 0, answer.output
    solved = read_json(answer.stdout)["solved"]
    assert solved["pressures"]["flange.peak_to_peak"] > 1000
    assert solved["limits"][0]["allowed"] == pytest.approx(0.07)
