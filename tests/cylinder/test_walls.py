"""The wall's temperature by a steady network: its balance, limits, and root of given temperatures."""

import dataclasses

import jax
import numpy as np
import pytest
from cylinder.test_cylinder import COLLOCATION, SPEED, check_figures, golden
from cylinder.test_transient_valves import BEHIND, MUFFLER, light_rod, with_plenums
from scipy.optimize import brentq

from jaxcomp import load
from jaxcomp.cli import app
from jaxcomp.cylinder import WallNetwork, solve_cycle
from jaxcomp.study import available_quantities


def walled(gas, **conductances):
    return dataclasses.replace(gas, walls=WallNetwork(350.0, **conductances))


@pytest.fixture(scope="module")
def solve():
    """Cycles of one program."""

    @jax.jit
    def solved(gas):
        return solve_cycle(gas, light_rod(), SPEED, COLLOCATION, throw=False)

    return solved


def test_the_wall_has_the_temperature_at_which_its_heat_balances(solve):
    """That of the network is the root of the balance over cycles with given temperatures."""
    conductance = 0.5
    cycle = solve(walled(golden("D"), ambient_conductance=conductance))
    wall = float(cycle.wall_temperature)
    assert bool(cycle.converged)
    assert 351 < wall < 450
    to_gas = float(cycle.totals.heat * cycle.frequency)
    np.testing.assert_allclose(-to_gas, conductance * (wall - 350.0), rtol=1e-9)

    def given(T):
        """A wall that is tied to its surroundings has their temperature, to 1e-6 K: the test below."""
        tied = dataclasses.replace(golden("D"), walls=WallNetwork(T, ambient_conductance=1e8))
        return solve(tied).totals.heat

    def excess(T):
        return -float(given(T)) * SPEED / (2 * np.pi) - conductance * (T - 350.0)

    root = brentq(excess, wall - 5.0, wall + 5.0, xtol=1e-9)
    # the heat is a small difference of large amounts: 1e-10 of it is 1e-8 of the wall's excess
    np.testing.assert_allclose(wall, root, rtol=1e-8)


def test_a_wall_tied_to_its_surroundings_is_given_and_a_free_one_takes_no_heat(solve):
    tied = solve(walled(golden("D"), ambient_conductance=1e8))
    check_figures(tied, "D", 1e-7)
    free = solve(walled(golden("D"), ambient_conductance=1e-9))
    assert abs(float(free.totals.heat)) < 1e-9 * float(free.indicated_work)
    assert free.wall_temperature > tied.wall_temperature + 5


@pytest.mark.slow  # a structure of its own, half a minute of compilation
def test_the_wall_heats_the_suction_plenum_and_cools_the_discharge_plenum():
    gas = with_plenums(MUFFLER[:1], BEHIND)
    tied = walled(gas, ambient_conductance=0.2, suction_conductance=0.1, discharge_conductance=0.3)
    cycle = solve_cycle(tied, light_rod(), SPEED, COLLOCATION)
    state, scale = cycle.raw[1].points, cycle.case.suction.T
    weight = np.asarray(cycle.weight)
    # mean temperatures of the plenums, whose states (mass, temperature, flow) stand last
    before, behind = (
        float(weight @ np.asarray(state[:, :-1, i]).reshape(-1) * scale) / (2 * np.pi)
        for i in (-5, -2)
    )
    wall = float(cycle.wall_temperature)
    assert 300 < before < wall < behind
    flows = 0.2 * (wall - 350.0) + 0.1 * (wall - before) + 0.3 * (wall - behind)
    np.testing.assert_allclose(-float(cycle.totals.heat * cycle.frequency), flows, rtol=1e-9)
    # what the plenum's gas gains beyond the line's is what it was given
    heated = cycle.totals.suction_heat - cycle.totals.suction * cycle.case.suction.h
    assert heated > 0


def test_walls_need_what_they_tie():
    with pytest.raises(ValueError, match=r"needs `suction\.plenums`"):
        walled(golden("D"), ambient_conductance=0.2, suction_conductance=0.1)
    with pytest.raises(ValueError, match="need a `heat`"):
        dataclasses.replace(
            golden("D"), heat=None, walls=WallNetwork(350.0, ambient_conductance=1.0)
        )


def test_check_and_the_list_of_quantities_know_the_network(tmp_path):
    from importlib.resources import files

    from typer.testing import CliRunner

    text = (files("jaxcomp") / "machines" / "r134a-7cc.toml").read_text()
    network = '\n[gas.walls]\nambient_temperature = "330 K"\nambient_conductance = "1.25 W/K"\n'
    path = tmp_path / "walls.toml"
    path.write_text(text + network)
    machine = load(path).machine
    assert not available_quantities(machine)["wall_temperature"].missing(machine)
    plain = load("r134a-7cc").machine
    assert "walls" in available_quantities(machine)["wall_temperature"].missing(plain)
    shown = CliRunner().invoke(app, ["check", str(path), "--json"])
    assert shown.exit_code == 0, shown.output
    assert '"Conductance of the wall"' in shown.output
    assert "1.25" in shown.output
    path.write_text(text + network.replace("1.25", "-1.25"))
    shown = CliRunner().invoke(app, ["check", str(path)])
    assert shown.exit_code != 0
    assert "gas.walls.ambient_conductance" in shown.output + shown.stderr
