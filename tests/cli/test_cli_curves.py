"""`curves.csv` of `jaxcomp run`: what the report draws, at nodes or on even degrees."""

import csv

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import without_drawing
from typer.testing import CliRunner

from jaxcomp import load, solve_orbit
from jaxcomp.cli import app
from jaxcomp.study import steady_state


def run(*words):
    return CliRunner().invoke(app, ["run", *map(str, words)])


def curves(folder, *words):
    done = run(*words, "--out", folder)
    assert done.exit_code == 0, done.output
    with (folder / "curves.csv").open() as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, np.array(rows, float).T, strict=True))


def unverified(scene, method, verify, moving_films, output):
    del verify, output
    return steady_state(scene, method, moving_films=moving_films)


def test_curves_on_even_degrees(tmp_path, monkeypatch):
    without_drawing(monkeypatch)
    # nor marched beside it, which takes half of the time and no curve comes from
    monkeypatch.setattr("jaxcomp.cli._run._solved", unverified)
    table = curves(tmp_path, "mayekawa-wbhe", "--step", "0.5")
    compressor = load("mayekawa-wbhe").compressor
    orbit = solve_orbit(compressor)
    degrees = table["crank_angle [deg]"]
    assert np.array_equal(degrees, np.arange(-360, 361) / 2)
    # the polynomials of the panels beside cubics through their nodes, as pictures draw
    speed = np.asarray(orbit.speed_at(jnp.asarray(np.deg2rad(degrees))))
    assert table["speed [rad/s]"] == pytest.approx(speed, rel=2e-5)
    volume = table["displaced_volume [m^3]"]
    assert volume.max() == pytest.approx(float(compressor.swept_volume), rel=1e-4)
    # trapezoids of half a degree; the pressure has kinks where ideal valves open and shut
    work = -np.trapezoid(table["pressure [Pa]"], volume)
    assert work == pytest.approx(float(orbit.energy.gas_work), rel=1e-3)
    assert table["time [s]"][0] == 0
    assert table["time [s]"][-1] == pytest.approx(float(orbit.period), rel=1e-12)
    assert np.all(np.diff(table["time [s]"]) > 0)
    for name, values in table.items():
        if name not in ("crank_angle [deg]", "crank_angle [rad]", "time [s]"):
            size = np.abs(values).max()
            assert values[0] == pytest.approx(values[-1], abs=1e-9 * size), name


def test_a_step_that_makes_no_sense_is_refused(tmp_path):
    for step, words in (
        ("0.7", "must divide 360"),
        ("0", "must divide 360"),
        ("1", "--out FOLDER"),
    ):
        done = run("mayekawa-wbhe", "--step", step)
        assert done.exit_code == 2
        assert words in done.stderr


@pytest.mark.slow  # compiles machines with valves, one of two cylinders
@pytest.mark.parametrize("count", [1, 2])
def test_curves_of_machines_with_valves(tmp_path, count):
    twin = ("crankshaft.layout=in-line-2", "crankshaft.throw_pitch=40 mm")[: 2 * (count - 1)]
    words = [word for one in twin for word in ("--set", one)]
    table = curves(tmp_path, "r290-6cc", "--step", "0.25", *words)
    compressor = load(tmp_path / "machine.toml").compressor
    assert compressor.crankshaft.count == count
    cycle = solve_orbit(compressor).cycle
    first = getattr(cycle, "first", cycle)
    several = ".1" if count > 1 else ""
    flow = table[f"flow.discharge_valve{several} [kg/s]"]
    passed = np.trapezoid(flow, table["crank_angle [rad]"])
    # trapezoids of a quarter of a degree of a flow that begins and ends at once
    assert passed == pytest.approx(float(first.flow[1] @ first.weight), rel=3e-3)
    lift = table[f"lift.suction_valve{several} [m]"]
    assert lift.max() == pytest.approx(float(jnp.max(first.lift[0])), rel=1e-2)
    volume = table[f"volume{several} [m^3]"]
    swept = float(jnp.ptp(first.volume))
    assert np.ptp(volume) == pytest.approx(swept, rel=1e-4)
    # the law of the gas between what stands side by side: the pressure rises as volume falls
    shut = (table[f"lift.discharge_valve{several} [m]"] == 0) & (lift == 0)
    pressure = table[f"pressure{several} [Pa]"]
    rising = shut[1:] & shut[:-1] & (np.diff(volume) < 0)
    assert np.mean(np.diff(pressure)[rising] > 0) > 0.98
    assert f"gas_temperature{several} [K]" in table
    assert ("volume.2 [m^3]" in table) == (count > 1)
