"""Unloaders, pockets and load steps: against an own program in time, and machines built that way."""

import dataclasses
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import plate_valve
from reference_ends import DoubleActing as Reference
from reference_ends import Valve

from jaxcomp import BadInput, Compressor, solve_orbit
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import (
    ClearancePocket,
    CrankEnd,
    Cylinder,
    DischargeLine,
    LoadStep,
    SuctionLine,
    solve_cycle,
)
from jaxcomp.fluid import PerfectGas
from jaxcomp.machine import Machine
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import ConstantSpeed
from jaxcomp.study import load_steps
from jaxcomp.valve import Unloader

BORE, RADIUS, LENGTH, ROD, SPEED = 0.2, 0.06, 0.3, 0.05, 77.5
LOW, HIGH, WARM = 1e5, 3.2e5, 300.0
HEAD, CRANK = 0.12, 0.14
SUCTION = Valve(0.15, 60.0, 2e4, 0.0, 3e-3, 0.08, 0.06)
DISCHARGE = Valve(0.12, 60.0, 2.5e4, 3e-4, 2.5e-3, 0.07, 0.05)
FORCE = 3000.0  # [N] more than the gas that is pushed back has
LATE = np.deg2rad(250.0)
POCKET = 6e-4


def cylinder(unloader=None, **changes):
    entries = {
        "fluid": PerfectGas(287.0, 1.4),
        "suction": SuctionLine(pressure=LOW, temperature=WARM),
        "discharge": DischargeLine(pressure=HIGH),
        "suction_valve": plate_valve(SUCTION, unloader or Unloader(FORCE)),
        "discharge_valve": plate_valve(DISCHARGE),
        "clearance_ratio": HEAD,
        "crank_end": CrankEnd(rod_diameter=ROD, clearance_ratio=CRANK),
        "pocket": ClearancePocket(POCKET),
    }
    return Cylinder(**{**entries, **changes})


def throw(gas):
    mechanism = SliderCrank(BORE, RADIUS, LENGTH, 30.0, 0.0)
    return Compressor(mechanism, Crankshaft(6.0), ConstantSpeed(SPEED), gas)


def end_of(orbit, number):
    return jax.tree.map(lambda x: x[number], orbit.cycle.each)


def in_si(cycle, stops):
    """States of an end where its revolution begins, and the modes of its valves."""
    mesh, z, _ = cycle.raw
    rho = LOW / (287.0 * WARM)
    m, T, *rest = np.asarray(z.left[0])
    begin = [m * rho * float(cycle.case.swept), T * WARM]
    for i, stop in enumerate(stops):
        x, v, u = rest[3 * i : 3 * i + 3]
        begin += [x * stop, v * stop * SPEED, u * np.sqrt(287.0 * WARM)]
    return begin, np.asarray(mesh.flags[0])[[0, 3]]


@pytest.mark.slow  # compiles a machine for either unloader
@pytest.mark.parametrize("release", [None, LATE], ids=["whole stroke", "part of the stroke"])
def test_an_unloaded_end_is_that_of_an_own_program_in_time(release):
    """Both ends are tight, so that each may be marched from its own start."""
    gas = cylinder(Unloader(FORCE, release), unloaded=jnp.array([0.0, 1.0]))
    orbit = solve_orbit(throw(gas))
    head = end_of(orbit, 0)
    crank = end_of(orbit, 1)
    stops = SUCTION.stop, DISCHARGE.stop
    held = dataclasses.replace(SUCTION, held=FORCE, release=release)
    hot = WARM * (HIGH / LOW) ** (0.4 / 1.4)
    # the program has both ends at one angle of the crank: each counts where it begins itself
    own = Reference(
        BORE, RADIUS, LENGTH, ROD, (HEAD, CRANK), ((SUCTION, DISCHARGE), (held, DISCHARGE)),
        (LOW, WARM), (HIGH, hot), SPEED, 0.0, 0.0,
    )  # fmt: skip
    for number, cycle in enumerate((head, crank)):
        begin, modes = in_si(cycle, stops)
        start = -np.pi / 2 - number * np.pi
        # beside it an end that does not matter
        idle = [1e-3, 300.0, *[0.0] * 6]
        states = [*begin, *idle] if number == 0 else [*idle, *begin]
        both = [*modes, 0, 0] if number == 0 else [0, 0, *modes]
        after, sums, *_ = own.revolution(states, both, start)
        place = [8 * number, 8 * number + 1]
        error = 1e-7
        np.testing.assert_allclose(after[place], begin[:2], rtol=error)
        totals = cycle.totals
        work = -float(totals.work)
        np.testing.assert_allclose(work, -sums[number, 3], rtol=error)
        np.testing.assert_allclose(totals.suction, sums[number, 0], rtol=error, atol=1e-12)
        np.testing.assert_allclose(totals.discharge, sums[number, 1], rtol=error, atol=1e-12)
    loaded = float(head.delivered)
    if release is None:
        assert abs(float(crank.delivered)) < 1e-9 * loaded
    else:
        assert 0.2 * loaded < float(crank.delivered) < 0.7 * loaded


@pytest.mark.slow  # the machine, and two others
def test_every_load_step_is_a_machine_built_that_way():
    steps = (
        LoadStep("pocket", pockets=[1.0, 0.0]),
        LoadStep("half pocket", pockets=[0.5, 0.0]),
        LoadStep("head end", unloaded=[0.0, 1.0]),
        LoadStep("idle", unloaded=[0.0, 1.0], pockets=[1.0, 0.0]),
    )
    table = load_steps(Machine(throw(cylinder(load_steps=steps))))
    rows = {row.name: row for row in table.rows()}
    assert list(rows) == ["full load", "pocket", "half pocket", "head end", "idle"]
    swept = np.pi / 4 * BORE**2 * 2 * RADIUS
    plain = {"suction_valve": plate_valve(SUCTION), "pocket": None}
    for name, share in (("full load", 0.0), ("pocket", 1.0), ("half pocket", 0.5)):
        built = cylinder(clearance_ratio=HEAD + share * POCKET / swept, **plain)
        orbit = solve_orbit(throw(built))
        np.testing.assert_allclose(rows[name].mass_flow, orbit.cycle.mass_flow, rtol=1e-9)
        np.testing.assert_allclose(rows[name].shaft_power, orbit.motor_power, rtol=1e-9)
    # without the crank end: what the idle end costs is its own work
    for name, share in (("head end", 0.0), ("idle", 1.0)):
        alone = cylinder(clearance_ratio=HEAD + share * POCKET / swept, crank_end=None, **plain)
        cycle = solve_cycle(alone, throw(alone).mechanism, SPEED)
        row = rows[name]
        state = table.states[table.names.index(name)]
        np.testing.assert_allclose(row.mass_flow, cycle.mass_flow, rtol=1e-9)
        idle = end_of(state.orbit, 1).indicated_power
        np.testing.assert_allclose(row.gas_power, cycle.indicated_power + idle, rtol=1e-9)
        # valves of this size cost much
        assert 0 < float(idle) < 0.5 * float(cycle.indicated_power)
    assert rows["idle"].flow_share < rows["head end"].flow_share < 0.6
    assert rows["pocket"].rod_tension > 0
    json.dumps(table.entries())


@pytest.mark.slow  # compiles values and derivatives
def test_derivatives_by_pocket_and_release_are_those_of_differences():
    def outputs(numbers):
        gas = cylinder(Unloader(FORCE, LATE), unloaded=jnp.array([0.0, 1.0]))
        gas = eqx.tree_at(lambda c: c.suction_valve.unloader.release, gas, LATE + numbers[0])
        pockets = jnp.stack([0.5 + numbers[1], jnp.zeros(())])
        gas = eqx.tree_at(lambda c: c.pockets, gas, pockets, is_leaf=lambda x: x is None)
        orbit = solve_orbit(throw(gas))
        return jnp.log(jnp.stack([orbit.cycle.mass_flow, orbit.gas_power]))

    slopes = jax.jacfwd(outputs)(jnp.zeros(2))
    step = 1e-4
    for column in range(2):
        there = jnp.zeros(2).at[column].set(step)
        wanted = (outputs(there) - outputs(-there)) / (2 * step)
        # cycles are known to 1e-10, over the step
        np.testing.assert_allclose(slopes[:, column], wanted, rtol=1e-5, atol=1e-6)


def test_settings_that_nothing_follows_are_refused_by_name():
    bare = {"suction_valve": plate_valve(SUCTION), "pocket": None}
    with pytest.raises(BadInput, match=r"without a suction_valve\.unloader"):
        cylinder(**bare, unloaded=jnp.array([0.0, 1.0]))
    with pytest.raises(BadInput, match="without a pocket"):
        cylinder(**bare, pockets=jnp.array([0.0, 1.0]))
    with pytest.raises(BadInput, match="another name"):
        cylinder(load_steps=(LoadStep("one"), LoadStep("one")))
    with pytest.raises(BadInput, match="suction valves"):
        cylinder(discharge_valve=plate_valve(DISCHARGE, Unloader(FORCE)))
    with pytest.raises(BadInput, match="each of 2 ends"):
        solve_orbit(throw(cylinder(unloaded=jnp.zeros(3))))
    with pytest.raises(BadInput, match="one load step"):
        load_steps(Machine(throw(cylinder())))
