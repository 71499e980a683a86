"""Energy of the whole machine: its electric power is what refrigerant and surroundings gain as heat."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from crank.test_warming import SOLVER, heats, rise_of, warmed
from cylinder import test_double_acting, test_load_steps, test_piped_cycles
from cylinder.test_cylinders_with_valves import TWIN
from cylinder.test_shared_plenums import SOLVER as SHARED
from cylinder.test_shared_plenums import twin
from cylinder.test_transient_valves import BEHIND, MUFFLER, with_plenums
from reference_pipes import SPEED as PIPED_SPEED
from reference_pipes import crank as piped_crank
from reference_pipes import cylinder as piped_cylinder
from reference_pipes import suction_pipe

from jaxcomp import Compressor, load, solve_orbit
from jaxcomp.crank import performance
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import LaminarGap, LoadStep, WallNetwork
from jaxcomp.machine import Machine
from jaxcomp.motor import ConstantSpeed, MotorEfficiency
from jaxcomp.scene import with_value, with_values
from jaxcomp.study import load_steps

# The iteration of the rise stops at 1e-10 of 100 K, of 5 to 60 K here; without a law the cycle's own
# balance is left, 1e-10 on the panels of these machines.
CLOSED = 1e-8


def balance_of(machine, *solver):
    orbit = solve_orbit(machine, *solver)
    assert orbit.converged
    return orbit, performance(machine, orbit)


def heat_brought_back(orbit):
    """[W] That gas brings back to the suction line, past the piston and through the valve."""
    totals, line = orbit.cycle.totals, orbit.cycle.case.suction.h
    leaked = totals.leakage_heat - totals.leakage * line
    back = totals.suction * line - totals.suction_heat
    return (leaked + back) * orbit.cycle.frequency


def work_left(orbit, answer):
    """[-] By which crank and cylinder differ in the work on the gas: 1e-6 on the panels here."""
    left = float((orbit.gas_power - orbit.cycle.indicated_power) / answer.electric_power)
    assert abs(left) < 1e-5
    return left


def test_power_becomes_heat_with_a_constant_rise_leakage_and_a_warm_wall():
    machine = load("r134a-7cc").machine.as_compressor()
    orbit, answer = balance_of(machine)
    assert abs(answer.heat_closure) < CLOSED
    case, cycle = orbit.cycle.case, orbit.cycle
    left = case.cylinder.fluid.state(
        cycle.discharge_temperature,
        case.cylinder.fluid.density(cycle.discharge_temperature, case.discharge.p),
    )
    gained = cycle.mass_flow * (left.h - case.comes.h)
    assert float(answer.heat["refrigerant"]) == pytest.approx(float(gained), rel=1e-9)
    # 1.8 W that leaked gas brings back would be missing
    assert 1.5 < float(heat_brought_back(orbit)) < 2.5


@pytest.fixture(scope="module")
def leaking():
    """A machine that leaks and whose suction gas is warmed, with its orbit and its performance."""
    machine = warmed(leakage=LaminarGap(1.5e-5, 12e-3, 1.9e-5))
    return machine, *balance_of(machine, SOLVER)


def test_the_shell_loses_no_energy(leaking):
    machine, orbit, _ = leaking
    gained, said = heats(machine, orbit)
    assert 5 < rise_of(orbit) < 60
    # the iteration stops at 1e-10 of 100 K
    assert float(gained) == pytest.approx(float(said), rel=1e-8)


def test_power_becomes_heat_with_a_law_of_warming_and_leakage(leaking):
    machine, orbit, answer = leaking
    assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)
    law, loss = machine.gas.suction.warming, answer.electric_power - orbit.gas_power
    # what gas brings back warms the gas that is drawn, and the shell has what is left of the losses
    rest = (1 - law.loss_share) * loss
    assert float(answer.heat["surroundings"]) == pytest.approx(float(rest), rel=1e-10)
    assert float(heat_brought_back(orbit)) > 0.01 * float(answer.electric_power)


# a minute of compilation each
@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["r600a-8cc", "r290-6cc", "mayekawa-wbhe-r22", "carlyle-06dm313", "danfoss-vtz038-g"],
)
def test_power_of_bundled_machines_becomes_heat(name):
    _, answer = balance_of(load(name).machine.as_compressor())
    assert abs(answer.heat_closure) < CLOSED


@pytest.mark.slow  # half a minute of compilation
def test_power_becomes_heat_with_plenums_and_a_wall_network():
    machine, gas = warmed(), with_plenums(MUFFLER[:1], BEHIND)
    walls = WallNetwork(350.0, 0.2, suction_conductance=0.1, discharge_conductance=0.3)
    machine = dataclasses.replace(machine, gas=dataclasses.replace(gas, walls=walls))
    orbit, answer = balance_of(machine, SOLVER)
    assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_in_two_unequal_cylinders_with_a_law_of_warming():
    """Their flows, losses and leaked gas warm what both draw."""
    law = {"discharge_conductance": "0.1 W/K", "loss_share": 0.3}
    scene = with_values(load("r134a-7cc"), TWIN)
    scene = with_value(scene, "mechanism.bore", ["22 mm", "24 mm"])
    scene = with_value(with_value(scene, "gas.suction.heating", None), "gas.suction.warming", law)
    machine = scene.as_compressor()
    orbit, answer = balance_of(machine)
    assert orbit.cycle.each.mass_flow.shape == (2,)
    assert abs(answer.heat_closure) < CLOSED
    # the law acts: without it the refrigerant would have what the shell has now
    assert float(orbit.cycle.case.suction.T - orbit.cycle.case.comes.T) > 2.0


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_in_cylinders_that_share_their_plenums():
    machine = dataclasses.replace(twin(np.pi), motor=warmed().motor)
    orbit, answer = balance_of(machine, SHARED)
    assert orbit.cycle.together is not None
    assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_where_the_cycle_is_marched():
    machine = warmed(leakage=LaminarGap(1.5e-5, 12e-3, 1.9e-5))
    machine = eqx.tree_at(
        lambda c: c.gas.suction_valve.port_length, machine, None, is_leaf=lambda x: x is None
    )
    orbit, answer = balance_of(machine, SOLVER)
    assert orbit.cycle.solver == "march"
    # the rise is within 1e-6 of 100 K of what follows from it, and the march repeats within 1e-7
    assert abs(answer.heat_closure) < 1e-5


def with_motor_losses(machine):
    """The machine with losses of its motor, which surroundings have to take."""
    losses = MotorEfficiency(efficiency=[0.9], fixed_power=50.0)
    return dataclasses.replace(machine, motor=dataclasses.replace(machine.motor, losses=losses))


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_in_a_double_acting_cylinder():
    """Gas leaks past the rings from end to end, and by the packing to the surroundings."""
    machine = with_motor_losses(test_double_acting.throw(test_double_acting.cylinder()))
    orbit, answer = balance_of(machine)
    assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)
    # the losses of the motor alone would be a tenth and 50 W of it
    assert float(answer.heat["surroundings"]) > 0.1 * float(answer.electric_power)


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_at_a_load_step():
    """With a pocket at the head end, and with its suction valve held open."""
    steps = (
        LoadStep("pocket", pockets=[1.0, 0.0]),
        LoadStep("head end", unloaded=[0.0, 1.0]),
    )
    machine = with_motor_losses(test_load_steps.throw(test_load_steps.cylinder(load_steps=steps)))
    table = load_steps(Machine(machine))
    for state in table.states:
        orbit = state.orbit
        answer = performance(state.compressor, orbit)
        assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)


@pytest.mark.slow  # a minute of compilation
def test_power_becomes_heat_with_pipes_at_both_valves():
    gas = piped_cylinder(suction_pipe(1.8), test_piped_cycles.discharge_pipe())
    motor = ConstantSpeed(PIPED_SPEED)
    machine = with_motor_losses(Compressor(piped_crank(), Crankshaft(0.05), motor, gas))
    orbit, answer = balance_of(machine)
    assert float(answer.heat_closure) == pytest.approx(work_left(orbit, answer), abs=CLOSED)
