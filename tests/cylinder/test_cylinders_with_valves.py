"""Several cylinders with valves on one crank, between lines of constant pressure."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load, solve_orbit
from jaxcomp.crank import performance
from jaxcomp.scene import with_value, with_values

TWIN = {"crankshaft.layout": "in-line-2", "crankshaft.throw_pitch": "40 mm"}


@pytest.mark.slow
def test_each_cylinder_at_constant_speed_has_the_cycle_of_a_machine_of_its_own():
    """A bore that is one number gives one cycle twice; a list gives each its own."""
    scene = with_values(load("r134a-7cc"), TWIN)
    scene = with_value(scene, "motor", {"type": "constant_speed", "mean_speed": "2950 rpm"})
    scene = with_value(scene, "mechanism.bore", ["22 mm", "24 mm"])
    machine = scene.as_compressor()
    orbit = solve_orbit(machine)
    cycle = orbit.cycle
    # golden machine C: 8 nodes a panel leave 4e-8
    np.testing.assert_allclose(cycle.each.volumetric_efficiency[0], 0.7104359269, rtol=3e-7)
    np.testing.assert_allclose(cycle.each.indicated_work[0], 1.888945294, rtol=3e-7)
    # a larger bore with the same ports: d ln eta_v/d ln bore is -0.46 at 22 mm
    share = cycle.each.volumetric_efficiency[1] / cycle.each.volumetric_efficiency[0]
    assert -0.5 < np.log(share) / np.log(24 / 22) < -0.1
    np.testing.assert_allclose(cycle.mass_flow, cycle.each.mass_flow.sum(), rtol=1e-14)
    np.testing.assert_allclose(sum(cycle.volume_losses.values()), 1.0, rtol=1e-12)
    np.testing.assert_allclose(sum(cycle.work_losses.values()), cycle.indicated_work, rtol=1e-12)
    # each pressure stands at its own crank angle: half a revolution apart on the crank's
    top = [orbit.state.angle[np.argmax(p)] for p in np.asarray(orbit.pressure)]
    apart = np.mod(top[1] - top[0], 2 * np.pi)
    np.testing.assert_allclose(apart, np.pi, atol=0.05)
    # the crank's quadrature of the pressures and the cycle's own
    np.testing.assert_allclose(orbit.energy.gas_work, cycle.indicated_work, rtol=1e-9)
    made = performance(machine, orbit)
    np.testing.assert_allclose(sum(made.power.values()), made.electric_power, rtol=1e-12)


@pytest.mark.slow  # a minute of compilation
def test_cylinders_that_are_alike_have_one_cycle_with_a_speed_that_varies_as_well():
    twin = with_values(load("r134a-7cc"), TWIN)
    orbit = solve_orbit(twin)
    cycle = orbit.cycle
    assert abs(orbit.energy.residual) < 1e-12
    np.testing.assert_allclose(orbit.energy.gas_work, cycle.indicated_work, rtol=1e-9)
    # even orders of the speed alone: both see the same fluctuation
    work = cycle.each.indicated_work
    np.testing.assert_allclose(work[0], work[1], rtol=1e-9)
    # each feels it: the motion of a cylinder's cycle is the orbit's, to the harmonics left out
    own = orbit.state.angle + twin.as_compressor().crankshaft.phase[1]
    second = jax.tree.map(lambda leaf: leaf[1], cycle.each)
    speed = jax.vmap(second.case.speed_at)(own)
    np.testing.assert_allclose(speed, orbit.state.speed, rtol=3e-4)


@pytest.mark.slow  # two minutes of compilation
def test_derivatives_of_several_coupled_cycles_are_those_of_differences():
    twin = with_values(load("r134a-7cc"), TWIN).as_compressor()

    @jax.jit
    def outputs(log):
        made = eqx.tree_at(lambda c: c.gas.suction_valve.stiffness, twin, 250.0 * jnp.exp(log))
        orbit = solve_orbit(made, throw=False)
        cycle = orbit.cycle
        return jnp.log(jnp.stack([cycle.mass_flow, cycle.indicated_work, orbit.motor_power]))

    zero, step = jnp.zeros(()), 1e-3
    got = jax.jit(jax.jacfwd(outputs))(zero)
    wanted = (outputs(step) - outputs(-step)) / (2 * step)
    # the differences' own error is of step^2 and of 1e-9 over the step
    np.testing.assert_allclose(got[:2], wanted[:2], rtol=1e-4, atol=1e-6)
    # reversals of joint loads are no edges by default, which costs derivatives of friction 1e-3
    np.testing.assert_allclose(got[2], wanted[2], rtol=1e-3)
