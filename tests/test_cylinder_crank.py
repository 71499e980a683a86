"""Pressure and speed of a compressor with a cylinder of its own, solved together."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load, solve_orbit
from jaxcomp.compressor import cylinder_pressure


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
    # the work of the crank and of the cycle come from different quadratures of the pressure; not every
    # event of a valve is an edge of the crank's panels
    np.testing.assert_allclose(orbit.energy.gas_work, cycle.indicated_work, rtol=3e-6)
    np.testing.assert_allclose(cycle.case.speed, orbit.mean_speed, rtol=1e-12)
    # the cycle's motion is the orbit's, but for the harmonics left out: 1 % of a fluctuation of 1.9 %
    speed = jax.vmap(cycle.case.speed_at)(orbit.state.angle)
    np.testing.assert_allclose(speed, orbit.state.speed, rtol=3e-4)
    # and it is felt: at constant speed eta_v is 1.2e-4 less
    assert 1e-4 < cycle.volumetric_efficiency / 0.7104359269 - 1 < 3e-4
