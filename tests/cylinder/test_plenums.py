"""Plenums and their necks between lines and valves: the periodic cycle against SciPy, and its limits."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import COLLOCATION, SPEED, check_figures, golden
from cylinder.test_transient_valves import BEHIND, MUFFLER, light_rod, with_plenums
from reference_valves import Reference

from jaxcomp import load
from jaxcomp.cli import app
from jaxcomp.cylinder import solve_cycle
from jaxcomp.cylinder._cylinder import prepare
from jaxcomp.cylinder._cylinder_system import Cylinders
from jaxcomp.cylinder._plenum import PassedGas, chain_scales, chains, settled_states
from jaxcomp.plot._cylinder import valve_motion


def test_the_periodic_state_returns_in_scipy():
    """One revolution of the SciPy program from the state that the collocation says repeats."""
    machine = light_rod()
    cycle = solve_cycle(with_plenums(MUFFLER, BEHIND), machine, SPEED, COLLOCATION)
    state, scales = cycle.raw[1].left[0], chain_scales(cycle.case)
    start = [state[0] * cycle.case.mass_scale, state[1] * cycle.case.suction.T, *[0.0] * 6]
    for i in range(3):
        m, T, f = state[8 + 3 * i : 11 + 3 * i]
        start += [f * scales.flow, m * scales.mass[i], T * scales.temperature]
    start = np.array(start, float)
    reference = Reference(MUFFLER, BEHIND, inertia=1e9, motor=lambda w: 0.0)
    end = reference.run(2 * np.pi / SPEED, -np.pi / 2, SPEED, SPEED, start=start)
    change = end[2:-2] - start
    change[8::3] /= scales.flow
    change /= np.where(
        np.arange(start.size) % 3 == 2, 1.0, np.where(start == 0, 1.0, np.abs(start))
    )
    # ports of shut valves keep some velocity, which means nothing; the flow in the necks swings some
    # twenty times a revolution, which ten nodes on a panel resolve to 1e-5 of its scale
    change = np.abs(np.delete(change, [4, 7]))
    assert np.max(change[[*range(6), 7, 8, 10, 11, 13, 14]]) < 1e-6
    assert np.max(change[6::3]) < 3e-5
    np.testing.assert_allclose(end[-2], cycle.delivered, rtol=1e-6)
    assert abs(cycle.mass_closure) < 1e-13
    # the plenums are adiabatic but for one, whose temperature costs heat: what they pass on is what came
    np.testing.assert_allclose(cycle.plenum_pressure[2].mean() / 5e5, 1.0, atol=0.05)
    picture = valve_motion(cycle)
    labels = {line.get_label() for line in picture.axes[2].lines}
    assert {"Suction 1", "Suction 2", "Discharge 1"} <= labels


@pytest.mark.slow  # another structure to compile
def test_a_very_large_plenum_is_a_line():
    """The golden values of constant pressures, to the swept volume over that of the plenum."""
    room = ((10.0, 300.0, 0.01, 8e-3, 0.0),)
    hall = ((10.0, 430.0, 0.01, 8e-3, 0.0),)
    cycle = solve_cycle(with_plenums(room, hall), light_rod(), SPEED, COLLOCATION)
    check_figures(cycle, "D", 2e-6)  # 7e-6 m^3 over 10 m^3, and the neck's own pressure difference


@pytest.mark.slow  # most of a minute of compilation
def test_derivatives_are_those_of_differences():
    base = with_plenums(MUFFLER, BEHIND)

    @jax.jit
    def outputs(logs):
        def get(c):
            return c.suction.plenums[0].volume, c.discharge.plenums[0].neck_length

        values = tuple(x * jnp.exp(log) for x, log in zip(get(base), logs, strict=True))
        cycle = solve_cycle(
            eqx.tree_at(get, base, values), light_rod(), SPEED, COLLOCATION, throw=False
        )
        return jnp.log(jnp.stack([cycle.indicated_work, cycle.delivered]))

    zero, step = jnp.zeros(2), 1e-4
    got = jax.jit(jax.jacrev(outputs))(zero)
    ways = step * jnp.eye(2)
    wanted = np.stack([(outputs(w) - outputs(-w)) / (2 * step) for w in ways], axis=1)
    # the panels are laid anew after every march, and ten nodes on them resolve the ringing necks to 1e-5
    np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-5)


SCENE = """
[[gas.suction.plenums]]
volume = "25 cm3"
neck_length = "20 mm"
neck_diameter = "6 mm"

[[gas.discharge.plenums]]
volume = "12 cm3"
neck_length = "30 mm"
neck_diameter = "4 mm"
loss_coefficient = 2
"""


def test_a_scene_has_plenums_and_check_tells_their_resonance(tmp_path):
    from importlib.resources import files

    from typer.testing import CliRunner

    text = (files("jaxcomp") / "machines" / "r134a-7cc.toml").read_text()
    path = tmp_path / "muffler.toml"
    path.write_text(text + SCENE)
    gas = load(path).as_compressor().gas
    assert len(gas.plenums) == 2
    np.testing.assert_allclose(gas.suction.plenums[0].volume, 25e-6, rtol=1e-12)
    shown = CliRunner().invoke(app, ["check", str(path), "--json"])
    assert shown.exit_code == 0, shown.output
    sound = float(gas.suction.state(gas.fluid).speed_of_sound)
    own = sound / (2 * np.pi) * np.sqrt(np.pi * 3e-3**2 / (25e-6 * 0.02))
    assert "Resonance of suction plenum 1" in shown.output
    assert f"{own:.6g}"[:5] in shown.output
    path.write_text((text + SCENE).replace("12 cm3", "-12 cm3"))
    shown = CliRunner().invoke(app, ["check", str(path)])
    assert shown.exit_code != 0
    assert "gas.discharge.plenums.0.volume" in shown.output + shown.stderr


def test_a_settled_plenum_passes_on_the_enthalpy_that_comes():
    """Of a perfect gas at its pressure, with gas that flows back: the balances over a revolution."""
    gas = with_plenums(((20e-6, None, 0.02, 3e-5, 1.5),), ((50e-6, None, 0.03, 3e-5, 1.5),))
    case = prepare(gas, light_rod(), SPEED)
    plenums = Cylinders(case, jnp.zeros(1)).initial(-1.5)[0][-6:]
    before, behind = (chain.gases[0] for chain in chains(case, plenums))
    forward, back = 7e-6, 1e-6  # [kg]
    warm = before.h + 3e3  # [J/kg] of what flows back into the suction plenum
    hot = behind.h + 4e4  # of what comes out of the cylinder
    of_suction = PassedGas(forward - back, back, forward * before.h - back * warm)
    of_discharge = PassedGas(forward - back, back, forward * hot - back * behind.h)
    settled = settled_states(case, plenums, (of_suction, of_discharge))
    new_before, new_behind = (chain.gases[0] for chain in chains(case, settled))
    # h of a perfect gas is linear in T, and so are both balances: to rounding
    comes = (forward - back) * case.suction.h + back * warm
    np.testing.assert_allclose(forward * new_before.h, comes, rtol=1e-12)
    np.testing.assert_allclose(new_behind.h, hot, rtol=1e-12)
    np.testing.assert_allclose(new_behind.p, behind.p, rtol=1e-12)


def test_a_plenum_of_a_given_temperature_does_not_settle():
    held = with_plenums((), ((50e-6, 400.0, 0.03, 3e-5, 1.5),))
    case = prepare(held, light_rod(), SPEED)
    start = Cylinders(case, jnp.zeros(1)).initial(-1.5)[0][-3:]
    passed = PassedGas(jnp.asarray(7e-6), jnp.asarray(0.0), jnp.asarray(3.5))
    np.testing.assert_array_equal(settled_states(case, start, (passed, passed)), start)


@pytest.mark.slow  # half a minute of compilation
def test_a_plenum_of_many_strokes_is_solved_far_from_the_temperature_of_its_line():
    """Its gas takes hundreds of revolutions to warm by 100 K; before that Newton's method fails."""
    gas = with_plenums((), ((1e-3, None, 0.03, 3e-5, 1.5),))
    gas = eqx.tree_at(lambda g: g.discharge.temperature, gas, jnp.asarray(300.0))
    cycle = solve_cycle(gas, light_rod(), SPEED, COLLOCATION)
    assert cycle.converged
    assert abs(cycle.mass_closure) < 1e-12
    warmed = cycle.raw[1].left[0][-2] * cycle.case.suction.T
    assert warmed > 400.0  # [K] beside the 300 K of its line


def test_plenums_that_are_absent_are_not_traced():
    def operations(cylinder):
        system = Cylinders(prepare(cylinder, light_rod(), SPEED), jnp.zeros(1))
        state, flags = system.initial(-1.5)
        law = jax.make_jaxpr(lambda y: system.rates(jnp.asarray(-1.5), y, flags).state)
        return len(law(state).eqns)

    assert operations(golden("D")) < operations(with_plenums(BEHIND)) - 30
