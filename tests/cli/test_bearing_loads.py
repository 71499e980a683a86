"""Journals under loads from a table: against an integrator of this file's own, axes, rates, bad tables.

The load table is that of notebooks/journal-loads.md: computed here, loads of the crank pin of a bundled
machine, rounded to 1 N. The 42 points of Flores (2006) would be a published one; we do not have them.
"""

import dataclasses as dc
import re
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import read_json, without_drawing
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

from jaxcomp import JournalBearing, SolveFailed, Status
from jaxcomp._core.results import load_result
from jaxcomp.cli import app
from jaxcomp.crank import LoadTable, loaded_journal
from jaxcomp.crank._journal_orbit import journal_orbit
from jaxcomp.parts import BadInput
from jaxcomp.scene import SceneError
from jaxcomp.scene.load_tables import read_loads

PAGE = Path(__file__).parents[2] / "notebooks" / "journal-loads.md"
PIN = re.search(r'title="pin.csv"\n(.*?)```', PAGE.read_text("utf-8"), re.S)[1]
SPEED = 1000 * np.pi / 30
BEARING = JournalBearing(0.09, 0.045, 45e-6, 0.01, "short")
TURN = 2 * np.pi


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("loads") / "pin.csv"
    path.write_text(PIN, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def table(file):
    return read_loads(file)


@pytest.fixture(scope="module")
def pin(table):
    return loaded_journal(BEARING, table, SPEED)


def numbers():
    angle, x, y, bush = np.loadtxt(PIN.splitlines(), delimiter=",", skiprows=1).T
    return np.radians(angle), np.stack([x, y]), bush / 1000


PLACES, WEIGHTS = np.pi / 2 * np.array(np.polynomial.legendre.leggauss(160))


def impedance(e, velocity):
    """Short film of L/D = 1: 2 int (V.n) n/(1 - e.n)^3 over the half circle about V, and its matrix."""
    line = np.arctan2(velocity[1], velocity[0])
    theta = line + PLACES
    n = np.stack([np.cos(theta), np.sin(theta)])
    return 2 * np.einsum("an,bn,n->ab", n, n, WEIGHTS / (1 - e @ n) ** 3)


def mobility(e, force):
    """The velocity that carries a force, by Newton's method: the matrix is the slope."""
    v = force
    for _ in range(8):
        before = v
        v = np.linalg.solve(impedance(e, v), force)
        # errors are squared: the next one is at rounding
        if np.abs(v - before).max() < 1e-8 * np.abs(v).max():
            break
    return v


def marched(knots, load, bush, viscosity, period=TURN, bearing=BEARING):
    """Least film [m], its angle and the mean loss [W] by Radau over three periods from the centre."""
    radius, length, gap = (
        float(x) for x in (bearing.radius, bearing.length, bearing.radial_clearance)
    )
    q = length / (2 * radius)
    unit = q**2 * viscosity * length * 2 * radius / (gap / radius) ** 2 * SPEED
    ends = np.append(knots, knots[0] + period)
    force, rate = (
        CubicSpline(ends, np.append(v, v[..., :1], axis=-1), axis=-1, bc_type="periodic")
        for v in (load, bush)
    )

    def slope(angle, e):
        return mobility(e, force(angle) / unit) + 0.5 * (1 + rate(angle)) * np.array([-e[1], e[0]])

    e, last = np.zeros(2), None
    for turn in range(3):
        last = solve_ivp(
            slope, (turn * period, (turn + 1) * period), e, method="Radau", rtol=1e-6, atol=1e-8,
            dense_output=turn == 2,
        )  # fmt: skip
        e = last.y[:, -1]
    angle = np.linspace(2 * period, 3 * period, 1441)
    e = last.sol(angle)
    eps = np.hypot(*e)
    power = [
        f @ mobility(x, f / unit) * gap * SPEED for f, x in zip(force(angle).T, e.T, strict=True)
    ]
    drag = TURN * viscosity * radius**3 * length / gap / np.sqrt(1 - eps**2)
    loss = drag * (SPEED * (1 - rate(angle))) ** 2 + power
    at = angle[np.argmax(eps)] - 2 * period
    return gap * (1 - eps.max()), at, np.mean(loss[:-1])


def agrees(found, by_march):
    film, angle, loss = by_march
    # what is promised: 1e-3; the march has 1e-6 a step
    assert float(found.film.minimum_film) == pytest.approx(film, rel=1e-3)
    assert float(found.film.mean_shear_loss + found.film.mean_squeeze_loss) == pytest.approx(
        loss, rel=1e-3
    )
    # the march is looked at every quarter of a degree, and the least film is flat
    assert np.mod(float(found.minimum_film_angle), found.table.period) == pytest.approx(
        angle, abs=np.radians(1)
    )


@pytest.mark.parametrize("viscosity", [0.01, 0.002])
def test_the_orbit_is_that_of_an_own_integrator(table, pin, viscosity):
    found = pin
    if viscosity != 0.01:
        thinner = dc.replace(BEARING, dynamic_viscosity=viscosity)
        found = loaded_journal(thinner, table, SPEED)
    assert found.status == Status.converged
    agrees(found, marched(*numbers(), viscosity))


def test_a_table_over_two_revolutions(pin):
    """The second revolution under half the load; the bush turns with a constant rate.

    Every other point, so that the table has as many as those of one revolution and shares their program.
    """
    angle, load, _ = numbers()
    twice = np.concatenate([angle, angle + TURN])[::2]
    both = np.concatenate([load, 0.5 * load], axis=1)[:, ::2]
    found = loaded_journal(BEARING, LoadTable(twice, both), SPEED, bush=0.2)
    assert found.table.period == pytest.approx(2 * TURN)
    agrees(found, marched(twice, both, np.full(36, 0.2), 0.01, 2 * TURN))
    columns = found.columns()
    assert columns["angle [rad]"][-1] == pytest.approx(2 * TURN, abs=0.1)


def rotated(vectors, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * vectors[0] - sin * vectors[1], sin * vectors[0] + cos * vectors[1]])


def fixed_and_turning(frame):
    """A smooth load at rest, and the same as it is in axes that turn with the journal or the bush."""
    angle = np.radians(np.arange(0, 360, 10.0))
    load = np.stack([2000 + 1500 * np.cos(angle), 900 * np.sin(2 * angle)])
    bush = -0.17 * np.cos(angle)
    beta = angle if frame == "journal" else -0.17 * np.sin(angle)
    speeds = {"bush_speed": bush * SPEED}
    own = LoadTable(angle, rotated(load, -beta), frame=frame, **speeds)
    return LoadTable(angle, load, **speeds), own


@pytest.mark.parametrize("frame", ["journal", "bush"])
def test_axes_that_turn_give_the_same_film(frame):
    still, turning = (loaded_journal(BEARING, one, SPEED) for one in fixed_and_turning(frame))
    # splines through 36 points of the same load in other axes: h^4 of a step of 10 degrees
    assert float(turning.film.minimum_film) == pytest.approx(
        float(still.film.minimum_film), rel=1e-4
    )
    np.testing.assert_allclose(turning.film.position, still.film.position, atol=1e-4)
    angle = np.asarray(turning.angle)
    beta = angle if frame == "journal" else -0.17 * np.sin(angle)
    np.testing.assert_allclose(rotated(turning.position, beta), still.position, atol=2e-4)


def test_a_sleeve_that_turns_has_the_film_of_a_journal_that_turns(pin, table):
    still = dc.replace(BEARING)
    both = [
        loaded_journal(still, LoadTable(table.angle, table.load), SPEED, journal=j, bush=1 - j)
        for j in (1.0, 0.0)
    ]
    # pressure follows the sum of the rates, shear the square of their difference
    for name in ("minimum_film", "mean_shear_loss", "mean_squeeze_loss", "mean_flow"):
        one, other = (float(getattr(found.film, name)) for found in both)
        assert one == pytest.approx(other, rel=1e-12)
    # and without the rod's own rate the pin's film is another one
    assert float(both[0].film.minimum_film) != pytest.approx(float(pin.film.minimum_film), rel=1e-2)


def test_straight_lines_between_the_points(table, pin):
    lines = LoadTable(table.angle, table.load, bush_speed=table.bush_speed, between="lines")
    found = loaded_journal(BEARING, lines, SPEED)
    assert float(found.load[0].min()) >= float(table.load[0].min()) - 1e-9  # a spline swings over
    assert float(pin.load[0].min()) < float(table.load[0].min()) - 50
    # each says by how much the other differs
    apart = abs(float(found.film.minimum_film - pin.film.minimum_film))
    assert float(found.table_error) == pytest.approx(apart, rel=1e-6)
    assert float(pin.table_error) == pytest.approx(apart, rel=1e-6)


def test_the_load_function_and_its_edges_are_for_journal_orbit(table, pin):
    shares = table.shares(SPEED)
    orbit = journal_orbit(
        BEARING, lambda a: table.load_at(a, shares), SPEED, bush=lambda a: table.over(shares[1], a),
        edges=table.edges, period=table.period,
    )  # fmt: skip
    assert float(orbit.film.minimum_film) == pytest.approx(float(pin.film.minimum_film), rel=1e-6)
    np.testing.assert_allclose(table.load_at(table.angle), table.load, rtol=1e-12, atol=1e-9)


def test_a_closing_line_changes_nothing(table, file, tmp_path):
    first = PIN.splitlines()[1]
    (tmp_path / "closed.csv").write_text(PIN + "360" + first[first.index(",") :] + "\n")
    closed = read_loads(tmp_path / "closed.csv")
    np.testing.assert_array_equal(closed.angle, table.angle)
    np.testing.assert_array_equal(closed.load, table.load)
    assert closed.period == table.period == pytest.approx(TURN)


def test_the_result_is_kept_and_drawn(pin, tmp_path):
    pin.save(tmp_path / "pin.npz")
    again = load_result(tmp_path / "pin.npz")
    np.testing.assert_array_equal(again.position, pin.position)
    assert again.table.period == pin.table.period
    assert "Minimum film" in repr(pin)
    figures = pin.plot.loaded_journal_figures()
    assert set(figures) == {"path", "film"}
    least = next(text for text in figures["film"].axes[1].texts if "µm at" in text.get_text())
    assert least.get_text().startswith(f"{1e6 * float(pin.film.minimum_film):.3g} µm")


def test_films_that_close_and_rough_ones_are_failures(table):
    thin = dc.replace(BEARING, roughness=20e-6)
    with pytest.raises(SolveFailed, match="thinner than the roughness"):
        loaded_journal(thin, table, SPEED)
    found = loaded_journal(thin, table, SPEED, throw=False)
    assert found.status == Status.thin_film
    with pytest.raises(BadInput, match="film"):
        loaded_journal(dc.replace(BEARING, film="guembel"), table, SPEED)
    with pytest.raises(BadInput, match="speed"):
        loaded_journal(BEARING, table, 0.0)
    half = LoadTable(table.angle, table.load, frame="bush")
    with pytest.raises(BadInput, match="whole revolutions"):
        loaded_journal(BEARING, half, SPEED, bush=0.5)


@cache
def lines():
    return PIN.splitlines()


def changed(number, cells):
    return [*lines()[:number], cells, *lines()[number + 1 :]]


BAD = {
    "one column": (["angle [deg]", "0", "10"], "W_x: is a missing column"),
    "no unit": (changed(0, "angle [deg],W_x,W_y [N],bush_speed [rpm]"), "W_x: needs its unit"),
    "unit of another kind": (changed(0, "angle [deg],W_x [mm],W_y [N],bush_speed [rpm]"), "W_x"),
    "unknown": (changed(0, "angle [deg],W_z [N],W_y [N],bush_speed [rpm]"), "is an unknown column"),
    "empty": ([], "is empty"),
    "short": (lines()[:3], "at least one for each 45°"),
    "no number": (changed(4, "30,much,936,-147.8"), 'line 5.W_x = "much": must be a number'),
    "cells": (changed(4, "30,936,-147.8"), "line 5 = 3: must have 4 cells"),
    "not finite": (changed(4, "30,nan,936,-147.8"), "line 5.W_x = nan: must be finite"),
    "unsorted": (changed(4, "15,3181,936,-147.8"), "line 5.angle = \"15°\": must be greater than 20°"),
    "gap": ([*lines()[:10], *lines()[11:]], 'line 10.angle = "80°": must be without a gap'),
    "end": (lines()[:20], 'line 20.angle = "180°": must be without a gap'),
    "not periodic": ([*lines(), "360,4000,0,-170"], "line 38.W_x"),
    "jump": ([lines()[0], *(f"{10 * k},{90 * k},0,0" for k in range(36))], "periodic: from it to 0°"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_tables_are_refused_with_line_and_reason(case, tmp_path):
    text, words = BAD[case]
    path = tmp_path / "bad.csv"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    with pytest.raises(SceneError) as error:
        read_loads(path)
    assert "bad.csv" in str(error.value)
    assert words in str(error.value)


def test_a_period_that_the_angles_do_not_tell(table):
    half = LoadTable(table.angle[:19], jnp.cos(table.angle[:19] * 2) * jnp.ones((2, 1)), np.pi)
    assert half.period == np.pi
    assert half.angle.size == 18
    with pytest.raises(BadInput, match="period"):
        LoadTable(table.angle, table.load, np.pi)


COMMAND = ["bearing", "--length", "45mm", "--diameter", "90mm", "--clearance", "45um",
           "--viscosity", "10 mPa s", "--speed", "1000rpm"]  # fmt: skip


def test_the_command_prints_numbers_and_writes_pictures(pin, file, tmp_path, monkeypatch):
    without_drawing(monkeypatch)  # their curves are looked at above
    arguments = [*COMMAND, "--loads", str(file), "--model", "short", "--out", str(tmp_path / "o")]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    found = read_json(done.stdout)
    assert found["minimum_film"] == pytest.approx(float(pin.film.minimum_film), rel=1e-9)
    assert found["mean_side_flow"] == pytest.approx(float(pin.film.mean_flow), rel=1e-9)
    assert found["minimum_film_angle"] == pytest.approx(float(pin.minimum_film_angle), abs=1e-9)
    names = {path.name for path in (tmp_path / "o").iterdir()} - {
        "interactive.html",
        "results.xlsx",
        ".jaxcomp.json",
    }
    assert names == {"path.png", "film.png", "orbit.csv", "result.json", "report.html"}
    table = CliRunner().invoke(app, arguments[:-2])
    assert "Error of the table" in table.stdout


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--load", "2kN"], "--load: cannot be combined with --loads"),
        (["--model", "guembel"], "--model guembel: no journal moves in it"),
        (["--bush-speed", "10rpm"], "has a column bush_speed"),
        (["--lands", "3"], "--lands 3: must be 1 or 2"),
        (["--period", "180 deg"], "period"),
    ],
)
def test_the_command_refuses_what_contradicts(more, message, file):
    done = CliRunner().invoke(app, [*COMMAND, "--loads", str(file), *more])
    assert done.exit_code == 2
    assert message in done.stderr
    assert "Traceback" not in done.output


def test_options_of_tables_need_a_table():
    done = CliRunner().invoke(app, [*COMMAND, "--load", "2kN", "--frame", "bush"])
    assert done.exit_code == 2
    assert "--frame: needs --loads" in done.stderr
