"""Suction gas that losses and the gas delivered warm: closed with the periodic state that it causes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import golden

from jaxcomp import BadInput, load, solve_orbit
from jaxcomp.crank import Collocation, performance
from jaxcomp.crank._warming import at_rise
from jaxcomp.cylinder import CycleOptions, SuctionWarming, solve_cycle
from jaxcomp.motor import ConstantSpeed, MeanSpeed

LAW = 0.01, 0.1  # [W/K], [-]
# on 30 panels the valves of this cylinder have several courses, and rounding chooses among them
SOLVER = Collocation(nodes=6, reversals=0, cycle=CycleOptions(panels=48, nodes=6))


def warmed(motor=ConstantSpeed, leakage=None):
    gas = golden("D")
    gas = eqx.tree_at(
        lambda g: (g.heat, g.leakage), gas, (None, leakage), is_leaf=lambda x: x is None
    )
    law = SuctionWarming(*LAW)
    gas = eqx.tree_at(lambda g: g.suction.warming, gas, law, is_leaf=lambda x: x is None)
    machine = load("r134a-7cc").machine.as_compressor()
    motor = motor(machine.motor.speed_guess, losses=machine.motor.losses)
    return eqx.tree_at(
        lambda c: (c.gas, c.friction, c.crankshaft.main_journal, c.motor),
        machine,
        (gas, None, None, motor),
    )


def heats(machine, orbit):
    """[W] What the gas gains before the suction valve, and what the law says of it."""
    cycle, case = orbit.cycle, orbit.cycle.case
    loss = performance(machine, orbit).electric_power - orbit.gas_power
    law = machine.gas.suction.warming
    gained = cycle.mass_flow * (case.suction.h - case.comes.h)
    fluid = case.cylinder.fluid
    compressed = fluid.at_entropy(case.discharge.p, case.comes.s, case.comes).T
    leaked = cycle.totals.leakage_heat - cycle.totals.leakage * case.suction.h
    back = cycle.totals.suction * case.suction.h - cycle.totals.suction_heat
    returned = (leaked + back) * cycle.frequency
    return gained, law.heat(case.comes, compressed, cycle.mass_flow, loss, returned)


def of_factors(factors):
    """Flow, power and temperature at the valve over clearance, conductance and share of the losses."""
    machine = warmed()
    machine = eqx.tree_at(
        lambda c: (
            c.gas.clearance_ratio,
            c.gas.suction.warming.discharge_conductance,
            c.gas.suction.warming.loss_share,
        ),
        machine,
        (machine.gas.clearance_ratio * factors[0], LAW[0] * factors[1], LAW[1] * factors[2]),
    )
    orbit = solve_orbit(machine, SOLVER, throw=False)
    power = performance(machine, orbit).electric_power
    return jnp.log(jnp.stack([orbit.cycle.mass_flow, power, orbit.cycle.case.suction.T]))


def rise_of(orbit):
    """[K] Of the gas before the suction valve."""
    return float(orbit.cycle.case.suction.T - orbit.cycle.case.comes.T)


@pytest.mark.slow  # a minute of compilation
def test_a_constant_rise_of_the_same_size_is_the_same():
    machine = warmed()
    orbit = solve_orbit(machine, SOLVER)
    rise = rise_of(orbit)
    alone = solve_orbit(at_rise(machine, jnp.asarray(rise)), SOLVER)
    # on panels that another march has laid: 2.4e-6 at 30 of them, fewer than here
    np.testing.assert_allclose(alone.cycle.mass_flow, orbit.cycle.mass_flow, rtol=1e-5)
    np.testing.assert_allclose(alone.motor_power, orbit.motor_power, rtol=1e-5)


@pytest.mark.slow  # a minute of compilation
def test_slopes_over_the_law_are_those_of_differences():
    @jax.jit
    def forward(factors):
        return of_factors(factors), jax.jacfwd(of_factors)(factors)

    _, slopes = forward(jnp.ones(3))
    step = 1e-2
    for column, way in enumerate(step * jnp.eye(3)):
        difference = (forward(1 + way)[0] - forward(1 - way)[0]) / (2 * step)
        # 30 panels leave 2e-4 of the slopes, and 48 less
        np.testing.assert_allclose(slopes[:, column], difference, rtol=1e-3)
    # without the rise that follows the flow, the share of the losses would not touch it
    assert abs(slopes[0, 2]) > 0.01


@pytest.mark.slow  # a minute of compilation
def test_reverse_mode_agrees_with_forward_mode():
    forward = jax.jit(jax.jacfwd(of_factors))(jnp.ones(3))
    reverse = jax.jit(jax.grad(lambda factors: of_factors(factors)[0]))(jnp.ones(3))
    # both mix the tangents until 1e-11 is left
    np.testing.assert_allclose(reverse, forward[0], rtol=1e-6)


@pytest.mark.slow  # half a minute of compilation
def test_the_fluctuating_speed_and_the_rise_are_found_together():
    machine = warmed(MeanSpeed)
    orbit = solve_orbit(machine, SOLVER)
    gained, said = heats(machine, orbit)
    assert float(gained) == pytest.approx(float(said), rel=1e-8)
    even = solve_orbit(warmed(), SOLVER)
    change = orbit.cycle.mass_flow / even.cycle.mass_flow - 1
    # the fluctuation of the speed is felt, by as little as with a constant rise
    assert 1e-6 < abs(change) < 1e-3


def test_what_cannot_be_warmed_is_refused():
    machine = warmed()
    speed = machine.motor.speed_guess
    with pytest.raises(BadInput, match="absent for gas without its crank"):
        solve_cycle(machine.gas, machine.mechanism, speed)


@pytest.mark.slow  # a minute of compilation
def test_gas_of_a_cycle_that_is_marched_is_warmed_as_well():
    """Quasi-steady ports have no derivatives, and a march for their cycle."""
    machine = eqx.tree_at(
        lambda c: c.gas.suction_valve.port_length, warmed(), None, is_leaf=lambda x: x is None
    )
    orbit = solve_orbit(machine, SOLVER)
    assert orbit.cycle.solver == "march"
    gained, said = heats(machine, orbit)
    # the rise is within 1e-6 of 100 K of what follows from it
    assert float(gained) == pytest.approx(float(said), rel=1e-5)
