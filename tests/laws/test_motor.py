import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import machine

from jaxcomp import Collocation, Shooting, load, solve_orbit
from jaxcomp._core.fields import replaced
from jaxcomp.motor import ConstantSpeed, ConstantTorque, Kloss, MeanSpeed, SlipLine
from jaxcomp.scene import with_values

MOTORS = {
    "mean speed": MeanSpeed(100.0),
    "proportional": MeanSpeed(100.0, shape="proportional"),
    "constant": ConstantTorque(40.0),
    "slip line": SlipLine(5.0, 105.0),
    "kloss": Kloss(150.0, 0.1, 105.0),
}


@pytest.mark.parametrize("name", list(MOTORS))
def test_torque_keeps_the_shape_and_is_finite_with_its_slope(name):
    motor = MOTORS[name]
    speed = jnp.asarray([0.0, 1e-3, 50.0, 105.0, 300.0, -20.0])
    torque = motor.torque(speed)
    assert torque.shape == speed.shape
    assert np.all(np.isfinite(torque))
    assert np.all(np.isfinite(jax.vmap(jax.grad(motor.torque))(speed)))
    assert np.isfinite(motor.speed_guess)
    assert motor.speed_guess > 0


def test_slip_line_vanishes_at_the_synchronous_speed():
    motor = MOTORS["slip line"]
    np.testing.assert_allclose(motor.torque(jnp.asarray([105.0, 103.0, 107.0])), [0, 10, -10])


def test_kloss_peaks_at_the_pull_out_slip_on_both_sides():
    motor = MOTORS["kloss"]
    speed = jnp.linspace(0.0, 210.0, 100001)
    torque = np.asarray(motor.torque(speed))
    # a scan meets the peak to the square of its step
    assert torque.max() == pytest.approx(150.0, rel=1e-6)
    assert torque.min() == pytest.approx(-150.0, rel=1e-6)
    assert float(speed[torque.argmax()]) == pytest.approx(105.0 * 0.9, rel=1e-4)
    assert float(motor.torque(jnp.asarray(0.0))) == pytest.approx(2 * 150 * 0.1 / (1 + 0.01))


def test_kloss_is_a_slip_line_near_the_synchronous_speed():
    line = SlipLine(2 * 150.0 / 0.1 / 105.0, 105.0)
    speed = jnp.asarray([104.9, 105.1])
    # the curve leaves the line by (s/s_b)^2 = 1e-4
    np.testing.assert_allclose(MOTORS["kloss"].torque(speed), line.torque(speed), rtol=2e-4)


def test_slip_line_turns_a_machine_without_friction():
    """Nothing is lost; the two solvers share no more than the laws."""
    frictionless = machine(motor=SlipLine(20.0, 110.0), friction=None)
    found, marched = (solve_orbit(frictionless, solver) for solver in (Collocation(), Shooting()))
    assert found.loss_error == {}
    # shooting closes to 1e-9
    np.testing.assert_allclose(found.mechanical_efficiency, 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.mean_speed, marched.mean_speed, rtol=1e-7)


@pytest.mark.parametrize("slip", [1e-3, 1e-6])
def test_a_stiff_motor_is_the_limit_of_constant_speed(slip):
    """A torque curve that leaves the speed no room solves as the given speed does."""
    kloss = {"type": "kloss", "pull_out_torque": "2000 N m", "pull_out_slip": slip}
    machine = with_values(
        load("mayekawa-wbhe"), {"motor": {**kloss, "synchronous_speed": "1000 rpm"}}
    ).compressor
    held = replaced(machine, motor=ConstantSpeed(machine.motor.synchronous_speed))
    stiff, constant = solve_orbit(machine), solve_orbit(held)
    # the swing of the speed, a tenth of the pull-out slip, moves the efficiency by 2e-4 of the slip
    assert float(stiff.mechanical_efficiency) == pytest.approx(
        float(constant.mechanical_efficiency), abs=1e-9 + 3e-4 * slip
    )
    assert float(stiff.speed_fluctuation) == pytest.approx(0.0997 * slip, rel=1e-3)
