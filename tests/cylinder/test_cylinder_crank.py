"""Pressure and speed of a compressor with a cylinder of its own, solved together."""

import dataclasses
import json
import re
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import golden
from typer.testing import CliRunner

from jaxcomp import BadInput, SolveFailed, Status, load, problem, solve_orbit
from jaxcomp.cli import app
from jaxcomp.cli._run_tables import undelivered_tables
from jaxcomp.compressor import cylinder_pressure
from jaxcomp.crank import Collocation, performance
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.cylinder import CycleOptions, solve_cycle
from jaxcomp.cylinder._several import SeveralCycles
from jaxcomp.motor import MotorEfficiency
from jaxcomp.scene import with_value
from jaxcomp.study import available_quantities
from jaxcomp.study.rating import QUANTITIES, RatingMap, at_rating, polynomial_terms, rating_map


def test_the_bundled_machine_is_the_golden_one():
    gas = load("r134a-7cc").machine.as_compressor().gas
    np.testing.assert_allclose(gas.behind_piston, 114.8e3, rtol=1e-12)
    np.testing.assert_allclose(gas.discharge_valve.oscillator.preload, 1e-4, rtol=1e-12)
    assert gas.inert


def test_an_unsolved_cylinder_has_no_pressure():
    machine = load("r134a-7cc").machine.as_compressor()
    with pytest.raises(TypeError, match="depends on the whole revolution"):
        cylinder_pressure(machine, jnp.zeros(3))


@pytest.mark.slow  # a minute of compilation
def test_pressure_and_speed_agree_with_each_other():
    machine = load("r134a-7cc").machine.as_compressor()

    orbit = solve_orbit(machine, throw=False)
    cycle = orbit.cycle
    assert bool(orbit.converged)
    assert abs(orbit.energy.residual) < 1e-12
    # the work of the crank and of the cycle come from different quadratures of the same polynomials,
    # whose panels end where the crank's do
    np.testing.assert_allclose(orbit.energy.gas_work, cycle.indicated_work, rtol=1e-12)
    np.testing.assert_allclose(cycle.case.speed, orbit.mean_speed, rtol=1e-12)
    # the cycle's motion is the orbit's but for the bends of the speed where a load reverses: these are
    # edges of the crank's panels alone (1.2e-7 there)
    speed = jax.vmap(cycle.case.speed_at)(orbit.state.angle)
    np.testing.assert_allclose(speed, orbit.state.speed, rtol=3e-7)
    # and it is felt: at constant speed eta_v is 1.2e-4 less
    assert 1e-4 < cycle.volumetric_efficiency / 0.7104359269 - 1 < 3e-4
    # where power and swept volume go adds up, and efficiencies are what they say
    made = performance(machine, orbit)
    np.testing.assert_allclose(sum(made.power.values()), made.electric_power, rtol=1e-12)
    assert made.to_dict()["cop"] == float(made.cop)
    assert "Power use friction" in repr(made)
    np.testing.assert_allclose(made.electric_power * 0.8222, orbit.motor_power, rtol=1e-3)
    np.testing.assert_allclose(sum(cycle.volume_losses.values()), 1.0, rtol=1e-12)
    np.testing.assert_allclose(made.cop, cycle.capacity / made.electric_power, rtol=1e-12)
    # enthalpies at ASHRAE's 32.2 C of gas and liquid by CoolProp 8.0.0
    rise = cycle.capacity / cycle.mass_flow
    np.testing.assert_allclose(rise, 185580.5234, rtol=1e-9)
    assert not any(map(bool, cycle.grazes.values()))


@pytest.mark.slow  # three sizes of a machine, half a minute of compilation each
def test_a_crank_that_nearly_halts_is_solved_as_its_march_is():
    """A light plate at low speed moves a thousand times faster than lift and angle, its scales."""
    scene = load("semi-hermetic-200cc")
    machine = with_value(scene, "motor.mean_speed", "450 rpm").as_compressor()
    orbit = solve_orbit(machine)
    assert orbit.cycle.solver == "collocation"
    # seen: 288; some bounces are at the edge of happening
    assert int(np.sum(orbit.cycle.valve_events)) == pytest.approx(288, abs=6)
    assert float(orbit.lowest_speed / orbit.mean_speed) == pytest.approx(0.212, abs=1e-3)
    solver = default_collocation(machine)
    by_march = dataclasses.replace(solver, cycle=solver.cycle.ladder()[-1])
    assert by_march.cycle.method == "march"
    marched = solve_orbit(machine, by_march)
    # seen: 1e-8 of the flow, 1e-6 of the work, which bounces move
    for figure in ("mass_flow", "indicated_work"):
        expected = getattr(marched.cycle, figure)
        np.testing.assert_allclose(getattr(orbit.cycle, figure), expected, rtol=1e-5)


@pytest.mark.slow  # a minute of compilation
def test_the_default_is_as_exact_as_twice_the_panels():
    """Relative, measured: power 2e-9, flow 4e-11, peak pressure 1.3e-8; harmonics lost 2e-6 to 3e-5."""
    machine = load("r134a-7cc").machine.as_compressor()
    fine = Collocation(reversals=machine.load_reversals, cycle=CycleOptions(panels=80, nodes=8))
    coarse, fine = (solve_orbit(machine, solver) for solver in (None, fine))
    np.testing.assert_allclose(coarse.motor_power, fine.motor_power, rtol=1e-8)
    np.testing.assert_allclose(coarse.cycle.mass_flow, fine.cycle.mass_flow, rtol=1e-9)
    np.testing.assert_allclose(coarse.cycle.peak_pressure, fine.cycle.peak_pressure, rtol=3e-8)


@pytest.mark.slow  # half a minute of compilation
def test_run_writes_the_pictures_of_a_cycle(tmp_path):
    result = CliRunner().invoke(app, ["run", "r134a-7cc", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.stderr
    names = {"pv_diagram", "valve_losses", "valve_motion", "log_p_h", "power_use"}
    assert names <= {file.stem for file in tmp_path.glob("*.png")}


def test_a_map_writes_its_points_and_pictures(tmp_path, monkeypatch):
    """Of numbers that no compressor has: what is tested is what becomes of them."""

    def made_up(scene, evaporating, condensing, standard, options, solver, reference):
        S, D = np.meshgrid(evaporating, condensing, indexing="ij")
        values = {name: S + number * D for number, (name, _, _) in enumerate(QUANTITIES)}
        values["cop"][0, 0] = np.nan
        ok = np.isfinite(values["cop"])
        return RatingMap(evaporating, condensing, values, ok, {}, {}, standard)

    monkeypatch.setattr("jaxcomp.study.rating.rating_map", made_up)
    given = ["--evaporating=-30:-10:3", "--condensing=40:50:2", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["map", "r134a-7cc", *given])
    assert result.exit_code == 0, result.stderr
    assert "1 of 6 points failed" in result.stdout
    pictures = {file.stem for file in tmp_path.glob("*.png")}
    assert pictures == {"capacity", "power", "cop", "overall_efficiency"}
    rows = (tmp_path / "map.csv").read_text().splitlines()
    assert len(rows) == 1 + 6
    assert rows[0].startswith("evaporating [degC],condensing [degC],capacity [W]")
    assert rows[-1].startswith("-10.0,50.0,263.15,586.3,909.45,")
    assert "discharge_temperature [degC]" in rows[0]
    assert max(map(len, ",".join(rows[1:]).split(","))) <= len("-0.000123456")


@pytest.mark.slow  # two minutes of compilation
def test_derivatives_of_cycle_and_crank_agree_with_differences():
    names = ("gas.suction_valve.stiffness", "gas.discharge_valve.stop", "mechanism.bore")
    made = problem(load("r134a-7cc"), names, ["cop", "isentropic_efficiency", "mass_flow"])
    here = made.current

    @jax.jit
    def logarithms(factors):
        return jnp.log(made(factors * here).values)

    forward = jax.jit(jax.jacfwd(logarithms))(jnp.ones(3))
    reverse = jax.jit(jax.grad(lambda factors: logarithms(factors)[0]))(jnp.ones(3))
    np.testing.assert_allclose(reverse, forward[0], rtol=1e-10)
    step = 1e-4
    for column, way in enumerate(jnp.eye(3)):
        ends = [logarithms(1 + sign * step * way) for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        # third derivatives of the mass flow, 50, at this step, and values to 1e-11
        np.testing.assert_allclose(forward[:, column], difference, atol=2e-6)


@pytest.mark.slow  # half a minute of compiling
def test_a_change_of_the_crank_reaches_the_cycle_through_the_motion_alone():
    """Nothing in the cylinder knows the inertia of the crank: its derivative is that of the coupling."""
    plain = eqx.tree_at(
        lambda gas: (gas.heat, gas.leakage), golden("D"), (None, None), is_leaf=lambda x: x is None
    )
    machine = load("r134a-7cc").machine.as_compressor()
    machine = eqx.tree_at(
        lambda c: (c.gas, c.friction, c.crankshaft.main_journal), machine, (plain, None, None)
    )
    # with 30 panels the valves have several courses at this motion, and rounding chooses among them
    solver = Collocation(nodes=6, reversals=0, cycle=CycleOptions(panels=48, nodes=6))

    def solved(log):
        # light enough for the speed to vary by 9 %
        light = eqx.tree_at(lambda c: c.crankshaft.inertia, machine, 1e-4 * jnp.exp(log))
        orbit = solve_orbit(light, solver, throw=False)
        cycle = orbit.cycle
        values = [cycle.mass_flow, cycle.indicated_work, orbit.speed_fluctuation]
        return jnp.log(jnp.stack(values)), orbit.converged

    @jax.jit
    def with_slope(log):
        return jax.jvp(solved, (log,), (jnp.ones(()),))

    step = 1e-2
    (_, converged), (slope, _) = with_slope(jnp.zeros(()))
    assert bool(converged)
    ends = [with_slope(jnp.zeros(()) + way)[0][0] for way in (step, -step)]
    difference = (ends[0] - ends[1]) / (2 * step)
    # 9e-5 is what 48 panels leave; without the motion, the slopes of flow and work are zero
    np.testing.assert_allclose(slope, difference, rtol=3e-4)


def test_quantities_of_the_gas_are_those_of_machines_with_valves():
    valves, plain = (load(name).machine for name in ("r134a-7cc", "mayekawa-wbhe"))
    known = available_quantities(valves)
    assert {"cop", "capacity", "mass_flow", "impact_speed.<contact>", "power_use.<cause>"} <= {
        *known
    }
    assert not {"cop", "mass_flow", "electric_power"} & {*available_quantities(plain)}
    assert "valves" in known["cop"].missing(plain)
    bare = with_value(load("r134a-7cc"), "motor.losses", None).machine
    assert "losses" in known["electric_power"].missing(bare)
    assert not known["cop"].missing(bare)


def test_motor_efficiency_over_torque():
    losses = MotorEfficiency([0.7, 0.8, 0.82], [0.1, 0.2, 0.4])
    np.testing.assert_allclose([losses.at(t) for t in (0.0, 0.15, 0.9)], [0.7, 0.75, 0.82])
    np.testing.assert_allclose(MotorEfficiency([0.85]).at(3.0), 0.85)
    with pytest.raises(ValueError, match="same number"):
        MotorEfficiency([0.7, 0.8])


@pytest.mark.parametrize("rating", ["ashrae", "en12900-superheat"])
def test_a_rating_point_has_the_lines_of_its_standard(rating):
    compressor = at_rating(load("r134a-7cc"), 249.85, 327.55, rating)
    gas = compressor.gas
    valve, comes = gas.suction.states(gas.fluid)
    # saturated R134a at -23.3 and 54.4 degrees Celsius, as the properties' golden values
    np.testing.assert_allclose(comes.p, 114842.64, rtol=1e-7)
    np.testing.assert_allclose(gas.discharge.states(gas.fluid, valve)[0].p, 1469822.3, rtol=1e-7)
    np.testing.assert_allclose(comes.T, 305.35 if rating == "ashrae" else 259.85, rtol=1e-12)
    np.testing.assert_allclose(valve.T - comes.T, 22.8, rtol=1e-12)
    with pytest.raises(BadInput, match="rating"):
        at_rating(load("r134a-7cc"), 250.0, 320.0, "ashray")
    with pytest.raises(BadInput, match="with valves and a real gas, for rating points"):
        at_rating(load("mayekawa-wbhe"), 250.0, 320.0)


@pytest.mark.slow  # a minute of compilation
def test_a_map_is_its_points_and_its_polynomial():
    machine = load("r134a-7cc")
    evaporating, condensing = (
        273.15 + np.array([-30, -25, -20, -15]),
        273.15 + np.array([40, 45, 50, 55]),
    )
    found = rating_map(machine, evaporating, condensing, "ashrae")
    assert found.ok.all()
    for place in ((0, 2), (1, 0), (3, 1)):
        here = at_rating(machine, evaporating[place[0]], condensing[place[1]], "ashrae")
        speed = here.motor.speed_guess
        cycle = solve_cycle(here.gas, here.mechanism, speed)
        # nodes and panels of a map are fewer: six digits
        np.testing.assert_allclose(found.values["capacity"][place], cycle.capacity, rtol=3e-5)
    terms = polynomial_terms(evaporating[:, None], condensing)
    fitted = terms @ found.coefficients["capacity"]
    error = np.abs(fitted / found.values["capacity"] - 1).max()
    np.testing.assert_allclose(error, found.fit_error["capacity"], rtol=1e-6)
    assert error < 5e-3


def test_the_terminal_and_the_file_of_coefficients_state_one_error(tmp_path, monkeypatch):
    """Of a capacity that falls to a third over the map: the largest error is at a small one."""

    def points(compressor, rating, options, solver, evaporating, condensing):
        values = 900.0 * np.exp(0.055 * (evaporating - 263.15)) + 1e-3 * condensing
        values = values * (1 + 4e-3 * np.cos(evaporating))
        true = np.ones(values.shape, bool)
        return {name: values for name, *_ in QUANTITIES}, true, ~true

    monkeypatch.setattr("jaxcomp.study.rating._along", points)
    given = ["map", "r134a-7cc", "--evaporating=-30:-10:5", "--condensing=40:55:4"]
    wide = {"COLUMNS": "200"}  # a table of whole lines
    shown = CliRunner().invoke(app, [*given, "--out", str(tmp_path)], env=wide)
    assert shown.exit_code == 0, shown.stderr
    head = (tmp_path / "coefficients.csv").read_text()
    stated = re.search(r"largest error of capacity = ([\d.]+)% at (\S+)/(\S+) C", head)
    printed = re.search(r"largest error, of the point +([\d.]+) %", shown.stdout)
    assert float(stated[1]) == pytest.approx(float(printed[1]), abs=0.051)  # of the last digit
    assert f"at S, D   {stated[2]}, {stated[3]}" in re.sub(" {3,}", "   ", shown.stdout)
    result = json.loads((tmp_path / "result.json").read_text())
    assert float(stated[1]) == pytest.approx(100 * result["fit_error"]["capacity"], abs=0.0051)


def test_a_map_tells_the_error_of_its_polynomial_at_every_point(tmp_path, monkeypatch):
    """A polynomial that is 3 W too high at one point of sixteen."""

    def made_up(scene, evaporating, condensing, standard, options, solver, reference):
        shape = len(evaporating), len(condensing)
        row = np.zeros(10)
        row[0] = 900.0
        values = {name: np.full(shape, 900.0) for name, *_ in QUANTITIES}
        values["power"][2, 1] -= 3.0
        terms = {name: row for name in ("capacity", "power", "mass_flow")}
        error = {"capacity": 0.0, "power": 3 / 900, "mass_flow": 0.0}
        ok = np.ones(shape, bool)
        return RatingMap(evaporating, condensing, values, ok, terms, error, standard)

    monkeypatch.setattr("jaxcomp.study.rating.rating_map", made_up)
    given = ["map", "r134a-7cc", "--evaporating=-30:-10:4", "--condensing=40:55:4"]
    result = CliRunner().invoke(app, [*given, "--json"])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert {"power [W]", "capacity [W]", "mass_flow [kg/s]"} <= set(told["values"])
    assert told["fit_error"]["power"] == 3 / 900
    errors = np.array(told["polynomial_error"]["power [W]"])
    assert errors[2, 1] == 3.0
    assert np.count_nonzero(errors) == 1
    shown = CliRunner().invoke(app, [*given, "--out", str(tmp_path)])
    assert "-16.67, 45" in shown.stdout, shown.stderr
    assert "polynomial_error.power [W]" in (tmp_path / "map.csv").read_text().splitlines()[0]


@pytest.mark.slow  # a quarter of a minute of compilation
def test_a_machine_that_delivers_nothing_says_what_it_lacks(monkeypatch):
    """One cylinder through the command, then two of which one delivers."""
    shut = with_value(load("r290-6cc"), "gas.leakage.gap", "60 um").machine.as_compressor()
    results = [
        solve_cycle(one.gas, one.mechanism, one.motor.speed_guess, throw=False)
        for one in (shut, load("r290-6cc").machine.as_compressor())
    ]

    def fails(*_, **__):
        raise SolveFailed(Status.no_delivery, result=SimpleNamespace(cycle=results[0]))

    monkeypatch.setattr("jaxcomp.study._steady_state.solve_orbit", fails)
    result = CliRunner().invoke(app, ["run", "r290-6cc"], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "nothing is delivered" in result.stderr
    shown = " ".join(result.stdout.split())
    assert "Cylinder: no gas is delivered" in shown
    found = re.search(r"reaches (\S+) bar; .* valve are (\S+) bar: (\S+) bar are lacking", shown)
    peak, behind, lack = map(float, found.groups())
    assert behind == pytest.approx(18.83, abs=0.02)  # propane at 54.4 degrees
    assert lack == pytest.approx(behind - peak, abs=0.01)  # of printed digits
    both = SeveralCycles(jax.tree.map(lambda *x: jnp.stack(x), results[1], results[0]))
    table, *_ = undelivered_tables(SimpleNamespace(cycle=both))
    assert table.title == "Cylinder 2: no gas is delivered"
