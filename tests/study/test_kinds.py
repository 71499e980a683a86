"""Constants from readings over the crank angle, tables of quantities and vibration, and all at once."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.identify import CONDITIONS, coverage
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import BadInput, Collocation, load, solve_orbit
from jaxcomp.cli import app
from jaxcomp.cylinder import solve_cycle
from jaxcomp.machine import machine_of
from jaxcomp.plot._identified import identification_figures
from jaxcomp.scene import SceneError
from jaxcomp.scene.measured import read_measurement
from jaxcomp.scene.tolerances import identified_tolerances, read_tolerance_file, tolerances_of
from jaxcomp.study import (
    AnalysisOptions,
    DesignResult,
    Table,
    Trace,
    VibrationTest,
    identify,
    variable,
)

WALL, PIN, INERTIA = (
    "friction.wall.coefficient",
    "friction.crank_pin.coefficient",
    "crankshaft.inertia",
)
SPEED = "motor.mean_speed"
LOSSES = ("loss_power.wall", "loss_power.crank_pin")
# The fits of this file vary the same constants, and its tables have the same columns: all of them share
# one program for tables and one for traces.
VARY = {WALL: None, PIN: None, INERTIA: None}
# What was measured is computed by the same solver as what is fitted: load reversals without panel edges,
# and no estimated errors, which nothing here looks at, make programs of two thirds the size.
SOLVER = Collocation(reversals=0, estimate=False)


def changed(machine, values):
    for name, value in values.items():
        machine = variable(machine, name).apply(machine, jnp.asarray(value))
    return machine


@pytest.fixture(scope="module")
def machine():
    return machine_of(load("mayekawa-wbhe"))


@pytest.fixture(scope="module")
def truth(machine):
    now = {name: float(variable(machine, name).current(machine)) for name in (WALL, PIN, INERTIA)}
    return {WALL: 1.2 * now[WALL], PIN: 0.8 * now[PIN], INERTIA: 1.3 * now[INERTIA]}


@pytest.fixture(scope="module")
def table(machine, truth):
    """Losses by joint and shaft power at two speeds, of the machine as it really is."""
    speeds = np.array([[90.0], [120.0]])
    measured = []
    for (speed,) in speeds:
        real = changed(machine, {**truth, SPEED: speed})
        found = DesignResult(real, AnalysisOptions(SOLVER))
        losses = found.orbit.loss_power
        measured.append(
            [*(losses[name.partition(".")[2]] for name in LOSSES), found.orbit.motor_power]
        )
    return Table(
        "losses.csv",
        (*LOSSES, "motor_power"),
        np.array(measured, float),
        (SPEED,),
        speeds,
        solver=SOLVER,
    )


@pytest.fixture(scope="module")
def trace(machine, truth):
    """The speed of its crank over a revolution, by a sensor that is 0.2 degrees late."""
    angle = np.radians(np.arange(0, 360, 5.0))
    orbit = solve_orbit(changed(machine, truth).as_compressor(), SOLVER)
    speed = np.asarray(orbit.speed_at(jnp.asarray(angle - np.radians(0.2))))
    return Trace("speed.csv", ("speed",), angle, speed[None], solver=SOLVER)


def to_predict(name, speed, power):
    """A table of the shaft power alone at one speed, with the columns of `table`."""
    measured = np.array([[np.nan, np.nan, power]])
    settings = np.array([[speed]])
    return Table(name, (*LOSSES, "motor_power"), measured, (SPEED,), settings, solver=SOLVER)


@pytest.fixture(scope="module")
def identified(machine, table, trace):
    return identify(machine, [table, trace], VARY, starts=1)


def test_the_speed_at_any_angle_is_that_of_the_panels(machine):
    orbit = solve_orbit(machine.as_compressor(), SOLVER)
    np.testing.assert_allclose(
        orbit.speed_at(orbit.state.angle + 2 * jnp.pi), orbit.state.speed, rtol=1e-12
    )
    # a panel away from its nodes: the extremes are found by its polynomials as well
    fine = orbit.speed_at(jnp.linspace(0, 2 * jnp.pi, 4001))
    np.testing.assert_allclose(jnp.max(fine), orbit.highest_speed, rtol=1e-7)
    np.testing.assert_allclose(jnp.min(fine), orbit.lowest_speed, rtol=1e-7)


def test_losses_and_a_speed_over_the_revolution_in_one_fit(machine, truth, table, identified):
    found = identified
    assert found.parameters == (*VARY, "speed.csv: top_dead_centre")
    # exact readings: what is left is where the fit stops, and the priors of the sensor's angle
    error = np.abs(found.estimate[:3] - np.array([*truth.values()]))
    np.testing.assert_array_less(error, 0.05 * found.standard_error[:3])
    late = float(found.estimate[3])
    # a prior about zero takes its share of what the readings say; linear to 5 %
    share = float(found.prior_share[3]) ** 2
    assert late == pytest.approx(np.radians(0.2) * (1 - share), rel=0.05)
    assert share < 0.5
    assert found.quantities == [*LOSSES, "motor_power", "speed"]
    assert np.isnan(found.conditions["crank_angle"]).sum() == 6
    # losses alone say nothing of the inertia
    alone = identify(machine, table, VARY, starts=1)
    assert any(INERTIA in words for words in alone.weak)
    # every file is a line of its own in the picture
    speed = np.flatnonzero(found.of("speed"))
    apart = found.point.at[speed[::2]].add(1)
    for point, files in ((found.point, 1), (apart, 2)):
        figure = identification_figures(eqx.tree_at(lambda f: f.point, found, point), "m")
        lines = [line.get_xdata() for line in figure["identified_speed"].axes[0].lines]
        assert [len(line) for line in lines] == [speed.size // files] * (2 * files)
        assert all((np.diff(line) > 0).all() for line in lines)


def test_tolerances_of_what_was_identified(identified, tmp_path):
    found = identified
    file = tmp_path / "tolerances.toml"
    file.write_text(identified_tolerances(found))
    texts, correlations = read_tolerance_file(file)
    assert set(texts) == {WALL, PIN, INERTIA}
    value = found.covariance[0, 1] / (found.standard_error[0] * found.standard_error[1])
    assert correlations[(WALL, PIN)] == pytest.approx(float(value), abs=1e-6)
    assert set(correlations) == {(WALL, PIN), (WALL, INERTIA), (PIN, INERTIA)}
    assert float(texts[WALL].removeprefix("sigma ")) == pytest.approx(
        float(found.standard_error[0]), rel=1e-5
    )


def test_points_that_were_not_measured(machine, table, trace):
    found = identify(machine, [table, trace], VARY, hold_out=[1], starts=1)
    assert found.held_out["motor_power"].inside == 1
    assert found.held_out["motor_power"].rms < 1e-4
    ahead = to_predict("ahead", 105.0, np.nan)
    entries, said = found.predict(ahead)
    assert entries.quantity == ()
    wanted = to_predict("ahead", 105.0, 1.0)
    entries, said = found.predict(wanted)
    real = DesignResult(changed(found.machine, {SPEED: 105.0}), AnalysisOptions(SOLVER))
    assert said.value[0] == pytest.approx(float(real.orbit.motor_power), rel=1e-9)
    assert said.model_sd[0] > 0
    assert said.half_width[0] > 1.9 * said.model_sd[0]
    # of several measurements at once, in their order
    slower = to_predict("slower", 95.0, 1.0)
    both = found.predict(wanted, slower)
    alone = found.predict(slower).prediction
    assert both.entries.quantity == ("motor_power", "motor_power")
    np.testing.assert_allclose(both.prediction.value, [said.value[0], alone.value[0]], rtol=1e-12)
    np.testing.assert_allclose(both.prediction.inflated[1], alone.inflated[0], rtol=1e-12)


def write_csv(file, heads, rows):
    lines = [",".join(map(repr, map(float, row))) for row in rows]
    file.write_text("\n".join([",".join(heads), *lines]))


def test_the_command_identifies_and_predicts(machine, truth, table, trace, tmp_path, monkeypatch):
    # the programs of the fits above
    monkeypatch.setattr("jaxcomp.cli._identify.chosen_solver", lambda text, scene: SOLVER)
    names = ("losses.csv", "speed.csv", "ahead.csv", "found")
    losses, speed, ahead, out = (tmp_path / name for name in names)
    heads = [*(f"{name} [W]" for name in LOSSES), "motor_power [W]"]
    rows = np.hstack([table.settings, table.measured])
    write_csv(losses, ["motor.mean_speed [rad/s]", *heads], rows)
    rows = np.stack([np.degrees(trace.angle), trace.measured[0]], 1)
    write_csv(speed, ["crank_angle [deg]", "speed [rad/s]"], rows)
    ahead.write_text(
        "motor.mean_speed [rpm],loss_power.wall [W],loss_power.crank_pin [W],motor_power [kW]\n"
        "1000,,,1\n"
    )
    vary = [word for name in VARY for word in ("--vary", name)]
    given = ["identify", "mayekawa-wbhe", "--data", str(losses), "--data", str(speed), *vary]
    more = ["--predict", str(ahead), "--sd", "motor_power=0.5%", "--json", "--out", str(out)]
    done = CliRunner().invoke(app, [*given, *more, "--starts", "1"])
    assert done.exit_code == 0, done.output
    result = read_json(done.stdout)
    values = {one["name"]: one["estimate"] for one in result["parameters"]}
    # the readings are exact and the fit stops at 1e-6 of chi-square
    assert values[WALL] == pytest.approx(truth[WALL], rel=1e-3)
    assert values[PIN] == pytest.approx(truth[PIN], rel=1e-2)
    assert values[INERTIA] == pytest.approx(truth[INERTIA], rel=1e-2)
    assert result["predicted"]["quantity"] == ["motor_power"]
    assert 0 < result["predicted"]["model_sd"][0] < 0.02 * result["predicted"]["value"][0]
    again = load(out / "machine.toml")
    assert again.sources[WALL].startswith("identified from losses.csv, speed.csv, ")
    texts, _ = read_tolerance_file(out / "tolerances.toml")
    assert set(tolerances_of(again.machine, texts)) == {WALL, PIN, INERTIA}
    for name in ("identified.json", "readings.csv", "predicted.csv", "identified_motor_power.png",
                 "identified_pairs.png"):  # fmt: skip
        assert (out / name).exists(), name


def test_an_interrupt_leaves_the_best_so_far(machine, table):
    seen = []

    def keep(estimate, chi_square):
        seen.append(chi_square)
        if len(seen) == 2:
            raise KeyboardInterrupt

    found = identify(machine, table, VARY, starts=3, keep=keep)
    assert found.fit.interrupted
    assert not found.fit.converged
    assert float(found.chi_square) == pytest.approx(min(seen))
    assert any("stopped on the way" in note for note in found.notes)


FILES = {
    "trace": (
        "# motor.mean_speed = 900 rpm\n# independent = 18\n"
        "crank_angle [deg],speed [rpm],sd(speed) [%]\n0,900,0.1\n10,901,\n20,,0.1\n"
    ),
    "table": (
        "# mechanism.bore = 130 mm\nmotor.mean_speed [rpm],loss_power.wall [W],motor_power [kW]\n"
        "900,100,2\n1000,,2.2\n"
    ),
}


def test_files_of_readings_over_the_angle_and_of_tables(machine, tmp_path):
    file = tmp_path / "readings.csv"
    file.write_text(FILES["trace"])
    trace = read_measurement(file, machine)
    assert isinstance(trace, Trace)
    assert (trace.paths, trace.independent) == ((SPEED,), 18)
    np.testing.assert_allclose(trace.settings, [30 * np.pi])
    entries = trace.entries({})
    np.testing.assert_allclose(entries.measured, np.array([900, 901]) * np.pi / 30)
    np.testing.assert_allclose(entries.sd[0], 0.9 * np.pi / 30)
    file.write_text(FILES["table"])
    table = read_measurement(file, machine)
    assert isinstance(table, Table)
    assert table.paths == (SPEED, "mechanism.bore")
    np.testing.assert_allclose(table.settings, [[30 * np.pi, 0.13], [100 * np.pi / 3, 0.13]])
    entries = table.entries({"motor_power": 0.02})
    assert entries.quantity == ("loss_power.wall", "motor_power", "motor_power")
    assert entries.names[2] == "1000 rpm, 130 mm"
    np.testing.assert_allclose(entries.sd, [1, 40, 44])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FILES["trace"].replace("speed [rpm]", "sped [rpm]"), "unknown column.*speed"),
        (FILES["trace"].replace("speed [rpm]", "speed"), "needs its unit"),
        (FILES["trace"].replace("speed [rpm]", "speed [bar]"), "another dimension"),
        (FILES["trace"].replace("mean_speed", "maen_speed"), "dotted path of a number.*mean_speed"),
        (FILES["trace"].replace("0,900,0.1", "0,900"), "must have 3 cells"),
        (FILES["table"].replace("loss_power.wall", "loss_pwer.wall"), "neither a quantity"),
        (FILES["table"].replace("900,100,2", "900,x,2"), "must be a number"),
        ("motor.mean_speed [rpm]\n900", "no head is a quantity"),
        ("target,axis,speed [rpm],amplitude [um]\n", "has no readings"),
        ("target,axis,amplitude [um]\nx,ux,3", "speed.*missing"),
    ],
)
def test_files_that_cannot_be_read(machine, tmp_path, text, message):
    file = tmp_path / "readings.csv"
    file.write_text(text)
    with pytest.raises(SceneError, match=message):
        read_measurement(file, machine)


@pytest.mark.parametrize(
    ("measurement", "message"),
    [
        (Trace("p", ("pressure",), np.zeros(3), np.ones((1, 3))), "without, speed alone"),
        (Table("t", ("vibration",), np.ones((1, 1))), "of a machine with"),
        (Table("t", ("motor_power",), np.ones((1, 1)), (SPEED,), -np.ones((1, 1))), "mean_speed"),
        (VibrationTest("v", ("a",), ("ux",), *np.ones((3, 1))), "given with its targets"),
    ],
)
def test_measurements_that_do_not_suit(machine, measurement, message):
    with pytest.raises(BadInput, match=message):
        identify(machine, measurement, {WALL: None})


def test_sensors_have_constants_of_their_own():
    both = Trace("d", ("pressure", "suction_lift"), np.arange(144.0), np.ones((2, 144)))
    both = both.entries({}), [one.name for one in both.nuisances]
    assert both[1] == ["top_dead_centre", "pressure_offset", "pressure_gain", "lift_gain"]
    ramp = np.linspace(1e5, 3e5, 144)
    one = Trace("d", ("pressure",), np.arange(144.0), ramp[None]).entries({})
    # 1 % of the range, and 144 samples count as 72
    np.testing.assert_allclose(one.sd, 2e3 * 2**0.5)


@pytest.mark.slow
def test_an_indicator_diagram_tells_clearance_and_ports():
    """Pressure and a lift by sensors with an offset, a gain and a late dead centre."""
    machine = machine_of(load("r600a-8cc"))
    names = ("gas.clearance_ratio", "gas.suction_valve.flow_coefficient")
    now = [float(variable(machine, name).current(machine)) for name in names]
    truth = [1.2 * now[0], 0.9 * now[1]]
    real = changed(machine, dict(zip(names, truth, strict=True))).as_compressor()
    speed = float(real.motor.speed_guess)
    cycle = solve_cycle(real.gas, real.mechanism, speed)
    angle = np.radians(np.arange(0, 360, 5.0))
    late = jnp.asarray(angle - np.radians(0.2))
    # the polynomials of the panels go through their nodes; those of a panel without width are at the end
    # of the one before it, and the pressure there is met to 1e-7
    np.testing.assert_allclose(cycle.pressure_at(cycle.angle), cycle.pressure, rtol=1e-6)
    np.testing.assert_allclose(cycle.lift_at(cycle.angle, True), cycle.lift[1], atol=1e-9)
    pressure = 600.0 + 1.005 * np.asarray(cycle.pressure_at(late))
    lift = 0.99 * np.asarray(cycle.lift_at(late, False))
    trace = Trace("diagram", ("pressure", "suction_lift"), angle, np.stack([pressure, lift]))
    found = identify(machine, trace, dict.fromkeys(names), starts=1)
    # exact readings: within what the priors of the sensors take
    error = np.abs(np.asarray(found.estimate[:2]) - truth)
    np.testing.assert_array_less(error, 0.5 * np.asarray(found.standard_error[:2]))
    np.testing.assert_array_less(error, 0.01 * np.array(truth))
    assert float(found.chi_square) < 2
    assert found.parameters[2:] == (
        "diagram: top_dead_centre", "diagram: pressure_offset", "diagram: pressure_gain",
        "diagram: lift_gain",
    )  # fmt: skip


@pytest.mark.slow
def test_vibration_at_targets_tells_an_unbalance_and_the_gain_of_a_sensor():
    scene = load("hermetic-68cc")
    machine = machine_of(scene)
    name = "loads.unbalances.0.magnitude.0"
    real = changed(machine, {name: 1.4 * float(variable(machine, name).current(machine))})
    places = machine.parts["balancing"]
    found = np.asarray(DesignResult(real, AnalysisOptions(SOLVER)).vibration.targets)[:, 0]
    rows = [(one.name, axis) for one in places.targets for axis in one.axes]
    pairs = [(n, k) for n in range(len(places.speeds)) for k in range(len(rows))]
    value = np.array([found[pair] for pair in pairs])
    test = VibrationTest(
        "v", *(tuple(rows[k][i] for _, k in pairs) for i in range(2)),
        np.array([float(places.speeds[n]) for n, _ in pairs]),
        1.01 * np.abs(value), np.angle(value) + 0.01,
    )  # fmt: skip
    vary = {name: tuple(s * float(variable(machine, name).current(machine)) for s in (0.5, 2.0))}
    result = identify(machine, test, vary, starts=1)
    truth = 1.4 * float(variable(machine, name).current(machine))
    # the gain of the sensor has a prior of 2 %, so that 1 % of it may go into the unbalance
    assert float(result.estimate[0]) == pytest.approx(truth, rel=0.02)
    assert float(result.estimate[2]) == pytest.approx(0.01, abs=0.003)
    assert float(result.chi_square) < 1


@pytest.mark.slow  # a minute, half of it compilation
def test_intervals_of_eight_constants_hold_the_truth():
    """Flow, power, discharge temperature at two points and an indicator diagram with noise, ten times.

    A hundred repetitions with four points hold each of the eight in 90 to 95 %, all together in 93.1 %
    (`tests/benchmarks/identify.py`).
    """
    names, shares, _ = coverage(10, conditions=CONDITIONS[::3])
    assert len(names) == 8
    # 80 draws of 95 %, of which those of a repetition are correlated: 2.4 % about the mean, four times
    assert 0.85 <= shares.mean() <= 1.0
