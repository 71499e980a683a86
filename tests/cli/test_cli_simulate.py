"""`jaxcomp simulate`: the motion of the library on the command line, with picture and report."""

import json

import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import load, simulate
from jaxcomp.cli import app
from jaxcomp.crank import TimeIntegration
from jaxcomp.scene import with_value

RUNNER = CliRunner()
MOTOR = {
    "type": "kloss",
    "pull_out_torque": "250 N m",
    "pull_out_slip": 0.3,
    "synchronous_speed": "1050 rpm",
}
SET = "motor={" + ", ".join(f"{k} = {json.dumps(v)}" for k, v in MOTOR.items()) + "}"


def run(*arguments):
    return RUNNER.invoke(app, ["simulate", "mayekawa-wbhe", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("simulate") / "out"


@pytest.fixture(scope="module")
def stop(folder):
    """A crank that runs, is switched off and comes to rest."""
    result = run("--duration", "9s", "--speed", "600rpm", "--power-off", "0.2s", "--set", SET,
                 "--out", folder, "--json")  # fmt: skip
    assert result.exit_code == 0, result.output
    return read_json(result.stdout)


def test_numbers_are_those_of_the_library(stop):
    scene = with_value(load("mayekawa-wbhe"), "motor", MOTOR)
    found = simulate(
        scene, 9.0, speed=600 * np.pi / 30, power_off=0.2, options=TimeIntegration(samples=501)
    )
    assert stop["end_time"] == pytest.approx(float(found.end_time), rel=1e-9)
    assert stop["course"]["speed"] == pytest.approx(list(map(float, found.state.speed)), abs=1e-9)
    assert stop["losses"]["wall"] == pytest.approx(float(found.energy.losses["wall"][-1]), rel=1e-9)


def test_crank_comes_to_rest_and_its_energy_is_accounted_for(stop):
    assert stop["stopped"]
    assert stop["status"] == "converged"
    assert 0.2 < stop["end_time"] < 9.0
    assert abs(stop["end_speed"]) < 0.01 * stop["highest_speed"]
    spent = stop["motor_work"] - stop["gas_work"] - sum(stop["losses"].values())
    # steps of 1e-8
    assert spent == pytest.approx(stop["kinetic_energy_gained"], abs=1e-5 * stop["motor_work"])


def test_folder_has_picture_report_and_result(stop, folder):
    assert (folder / "motion.png").stat().st_size > 10_000
    assert read_json((folder / "result.json").read_text()) == stop
    assert "Energy closure" in (folder / "report.html").read_text()


def test_picture_shows_speed_and_works(stop):
    from jaxcomp.plot._transient import transient_figure

    scene = with_value(load("mayekawa-wbhe"), "motor", MOTOR)
    found = simulate(
        scene, 9.0, speed=600 * np.pi / 30, power_off=0.2, options=TimeIntegration(samples=501)
    )
    figure = transient_figure(found, "m", 0.2)
    speed = figure.axes[0].lines[0].get_ydata()
    assert speed[0] == pytest.approx(600)
    assert [line.get_label() for line in figure.axes[1].lines][:4] == [
        "Motor",
        "Gas",
        "Friction",
        "In motion",
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--duration", "1s"), "must be a torque law over speed"),
        (("--duration", "0s", "--set", SET), "--duration 0s: must be > 0"),
        (("--duration", "1kg"), "--duration"),
        ((), "--duration: is missing"),
        (("--duration", "1s", "--tolerance", "2"), "--tolerance 2: must be > 0 and < 1"),
    ],
)
def test_what_makes_no_sense_ends_in_one_line(arguments, words):
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output
