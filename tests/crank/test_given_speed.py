"""A crank held at one speed: the limit of an endless flywheel, evaluated instead of solved."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from helpers import difference, machine, named_leaves

from jaxcomp import BadInput, Collocation, ConstantSpeed, Shooting, load, simulate, solve_orbit
from jaxcomp.compressor import at_speed
from jaxcomp.scene import with_values

SPEED = 104.72
SOLVER = Collocation(nodes=12)


@pytest.fixture(scope="module")
def held():
    return machine(motor=ConstantSpeed(SPEED), gravity=(-9.81, 0.0), offset=0.01)


@pytest.fixture(scope="module")
def solved(held):
    """The losses with their orbit over speed and bore, and their slopes: one program for all tests."""

    def loss(speed, bore):
        changed = eqx.tree_at(lambda c: (c.motor.mean_speed, c.mechanism.bore), held, (speed, bore))
        orbit = solve_orbit(changed, SOLVER, throw=False)
        return orbit.energy.total_loss, orbit

    return jax.jit(jax.value_and_grad(loss, (0, 1), has_aux=True))


@pytest.fixture(scope="module")
def orbit(held, solved):
    (_, orbit), _ = solved(jnp.asarray(SPEED, float), held.mechanism.bore)
    return orbit


def test_accounts_close_and_the_speed_stands_still(orbit):
    # what twelve nodes a panel leave of the integral of the inertia torque over the turn, which is zero
    assert abs(float(orbit.energy.residual)) < 1e-11
    assert float(orbit.speed_fluctuation) == pytest.approx(0.0, abs=1e-13)
    assert float(orbit.mean_speed) == pytest.approx(SPEED, rel=1e-14)
    assert float(orbit.motor_power) == pytest.approx(
        float(orbit.energy.motor_work) * SPEED / (2 * jnp.pi), rel=1e-14
    )
    assert bool(orbit.converged)


@pytest.mark.slow
def test_it_is_the_limit_of_a_heavy_flywheel(held, orbit):
    mean = eqx.tree_at(lambda c: c.motor, held, machine().motor)
    gaps = []
    for times in (1e3, 1e5):
        heavy = eqx.tree_at(lambda c: c.crankshaft.inertia, mean, times * mean.crankshaft.inertia)
        heavy = eqx.tree_at(lambda c: c.motor.mean_speed, heavy, jnp.asarray(SPEED))
        found = solve_orbit(heavy, SOLVER)
        gaps.append(abs(float(found.mechanical_efficiency - orbit.mechanical_efficiency)))
    # the fluctuation falls with one over the inertia; its first effect on the losses as well
    assert gaps[1] < 0.02 * gaps[0]
    assert gaps[1] < 1e-8


@pytest.mark.slow
def test_panels_end_where_loads_change_their_side(held, orbit):
    plain = solve_orbit(held, Collocation(nodes=12, reversals=0)).mechanical_efficiency
    fine = solve_orbit(held, Collocation(nodes=24)).mechanical_efficiency
    # of the edges at the load reversals: 100 times closer at the same nodes
    assert abs(orbit.mechanical_efficiency - fine) < 0.01 * abs(plain - fine)
    # as the solved orbit with these nodes, whose error `jaxcomp accuracy` gives as 5e-9
    assert abs(orbit.mechanical_efficiency - fine) < 2e-8


def test_shooting_integrates_the_losses_at_that_speed(held, orbit):
    found = solve_orbit(held, Shooting(diffrax.Dopri8(), 1e-9))
    assert found.solver == "shooting"
    assert float(found.speed_fluctuation) < 1e-14
    # seen: 2e-11 of a loss
    for name, loss in orbit.energy.losses.items():
        assert float(found.energy.losses[name]) == pytest.approx(float(loss), rel=1e-9)


@pytest.mark.slow
def test_derivatives_of_shooting_at_that_speed_are_those_of_collocation(held):
    def loss(solver):
        def at(speed, bore):
            values = speed, bore
            made = eqx.tree_at(lambda c: (c.motor.mean_speed, c.mechanism.bore), held, values)
            return solve_orbit(made, solver, throw=False).energy.total_loss

        return at

    at = jnp.asarray(SPEED), held.mechanism.bore
    wanted = jax.jit(jax.grad(loss(SOLVER), (0, 1)))(*at)
    backward = jax.jit(jax.grad(loss(Shooting(diffrax.Dopri8(), 1e-9)), (0, 1)))(*at)
    ahead = Shooting(diffrax.Dopri8(), 1e-9, adjoint=diffrax.ForwardMode())
    forward = jax.jit(jax.jacfwd(loss(ahead), (0, 1)))(*at)
    for one in (backward, forward):
        # derivatives converge after the values, see `Shooting`
        assert [float(x) for x in one] == pytest.approx([float(x) for x in wanted], rel=1e-6)


def test_derivatives_equal_differences(held, solved):
    at = jnp.asarray(SPEED, float), held.mechanism.bore
    slopes = solved(*at)[1]
    for place, slope in enumerate(slopes):
        step = 1e-3 * at[place]

        def moved(x, place=place):
            (loss, _), _ = solved(*(x if i == place else a for i, a in enumerate(at)))
            return loss

        # measured 1e-7, of the panels that end beside the load minimum
        assert float(slope) == pytest.approx(float(difference(moved, at[place], step)), rel=1e-6)
    assert all(jnp.all(jnp.isfinite(x)) for x in named_leaves(slopes).values())


def test_a_scene_file_can_ask_for_it():
    scene = with_values(
        load("mayekawa-wbhe"), {"motor.type": "constant_speed", "motor.shape": None}
    )
    assert isinstance(scene.compressor.motor, ConstantSpeed)
    assert float(scene.compressor.motor.mean_speed) == pytest.approx(1000 * jnp.pi / 30)


def test_other_speeds_keep_it_constant(held):
    other = at_speed(held, jnp.asarray(50.0))
    assert isinstance(other.motor, ConstantSpeed)
    assert float(other.motor.mean_speed) == 50.0


def test_it_has_no_torque_to_start_from_rest_with(held):
    with pytest.raises(BadInput, match="ConstantSpeed"):
        simulate(held, 1.0)
    with pytest.raises(BadInput, match="constant_speed"):
        held.motor.torque(jnp.asarray(1.0))
