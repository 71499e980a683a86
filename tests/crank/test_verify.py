"""The independent march of a revolution: it finds the errors that an orbit has, and no others."""

import dataclasses

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import machine

from jaxcomp import Collocation, Shooting, SolveFailed, TimeIntegration, load, solve_orbit
from jaxcomp.crank._solve_orbit import _verification
from jaxcomp.crank._verify import march_options
from jaxcomp.motor import ConstantSpeed, SlipLine
from jaxcomp.study import steady_state

COARSE = Collocation(nodes=5)


def fine(compressor):
    return solve_orbit(
        compressor, Collocation(nodes=24, reversals=compressor.mechanism.load_reversals)
    )


@pytest.fixture(scope="module")
def pair():
    """A coarse orbit with its march, and the fine one that says what its errors are."""
    compressor = load("mayekawa-wbhe").compressor
    return solve_orbit(compressor, COARSE, verify=True), fine(compressor)


def test_march_finds_the_errors_of_a_coarse_orbit(pair):
    coarse, exact = pair
    march = coarse.verification
    # 1e-9 of each value is what the march at 1e-12 is worth; errors of five nodes are 1e-7 and more
    for name, error in march.loss_error.items():
        true = float(exact.energy.losses[name] - coarse.energy.losses[name])
        assert abs(true) > 1e-8 * float(exact.energy.losses[name])
        # the march starts at a speed that is off as well, which moves its errors by some per cent
        room = 0.1 * abs(true) + 5e-9 * float(exact.energy.losses[name])
        assert float(error) == pytest.approx(true, abs=room), name
    for name, error in march.peak_error.items():
        true = float(exact.peak_forces[name] - coarse.peak_forces[name])
        # peaks are the largest of 4000 samples
        room = 0.02 * abs(true) + 3e-7 * float(exact.peak_forces[name])
        assert float(error) == pytest.approx(true, abs=room), name
    true = float(exact.mechanical_efficiency - coarse.mechanical_efficiency)
    # three losses of opposite errors, each known to 5e-9 of itself
    assert float(march.efficiency_error) == pytest.approx(true, rel=0.2)
    assert 1e-6 < float(march.speed_error) < 1e-4


def test_a_coarse_orbit_closes_its_energy_all_the_same(pair):
    coarse, _ = pair
    # why the march is there: closure says nothing of the nodes
    assert abs(float(coarse.energy.residual)) < 1e-3 * float(coarse.verification.speed_error)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        # a speed that is off everywhere by as much at its maximum
        (lambda o: (lambda o: o.state.speed, o.state.speed * (1 + 1e-4)), "speed_error"),
        (lambda o: (lambda o: o.energy.losses["wall"], 1.001 * o.energy.losses["wall"]), "wall"),
        (lambda o: (lambda o: o.peak_forces["wall"], 0.99 * o.peak_forces["wall"]), "peak"),
    ],
)
def test_march_finds_what_was_tampered_with(pair, change, found):
    compressor = load("mayekawa-wbhe").compressor
    orbit = dataclasses.replace(pair[0], verification=None)
    where, value = change(orbit)
    spoilt = eqx.tree_at(where, orbit, value)
    # the program of the coarse orbit's own march, whose errors are there as well
    march = _verification(compressor, spoilt, march_options())
    march = jax.tree.map(lambda a, b: a - b, march, pair[0].verification)
    size = {
        "speed_error": abs(float(march.closure)),
        "wall": float(march.loss_error["wall"] / orbit.energy.losses["wall"]),
        "peak": float(march.peak_error["wall"] / orbit.peak_forces["wall"]),
    }[found]
    # the wrong speed at the start decays or stays; the other two come back as they were put in
    low, high = {
        "speed_error": (1e-6, 1e-3),
        "wall": (-1.001e-3, -0.999e-3),
        "peak": (0.0099, 0.0101),
    }[found]
    assert low < size < high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider-link-8cc", "hermetic-68cc"])
def test_default_orbits_of_the_bundled_machines_are_confirmed(name):
    orbit = solve_orbit(load(name), verify=True)
    march = orbit.verification
    assert float(march.speed_error) < 1e-7
    for joint, error in march.loss_error.items():
        assert abs(float(error)) < 1e-7 * float(orbit.energy.losses[joint]), joint
    for joint, error in march.peak_error.items():
        # the estimate that the orbit has of its own is an upper one
        room = float(orbit.peak_error[joint]) + 1e-6 * float(orbit.peak_forces[joint])
        assert abs(float(error)) < room, joint


SEVERAL = ["mayekawa-4wbhe", "mayekawa-6wbhe", "mayekawa-8wbhe", "refrigeration-twin-block"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SEVERAL, "two-stage-crosshead"])
def test_default_orbits_of_several_cylinders_are_confirmed(name):
    """Dead centres of several cylinders coincide; the default leaves 1e-5 at most of the efficiency."""
    march = solve_orbit(load(name), verify=True).verification
    assert abs(float(march.efficiency_error)) < 1e-5
    assert abs(float(march.closure)) < 1e-5


def test_a_batch_of_twins_is_marched_within_a_program():
    twin = load("refrigeration-twin").as_compressor()

    @jax.jit
    @jax.vmap
    def errors(speed):
        made = eqx.tree_at(lambda c: c.motor.mean_speed, twin, speed)
        options = TimeIntegration(diffrax.Dopri5(), tolerance=1e-9, samples=200)
        orbit = solve_orbit(made, Collocation(reversals=0), verify=options, throw=False)
        return orbit.verification.efficiency_error

    # without edges at load reversals the orbit is good to 1e-5
    assert jnp.all(jnp.abs(errors(jnp.array([140.0, 150.0]))) < 3e-5)


@pytest.mark.slow
def test_shooting_and_other_motors_are_confirmed_as_well():
    compressor = machine(offset=0.01, gravity=(-9.0, 2.0))
    for motor, solver in (
        (compressor.motor, Shooting()),
        (SlipLine(20.0, 105.0), None),
        (ConstantSpeed(100.0), None),
    ):
        one = eqx.tree_at(lambda c: c.motor, compressor, motor)
        orbit = solve_orbit(one, solver, verify=True)
        assert float(orbit.verification.speed_error) < 1e-6, motor
        assert abs(float(orbit.verification.efficiency_error)) < 1e-7, motor
    held = (
        orbit.verification
    )  # of the given speed: nothing moves it, forces and losses are compared
    assert float(held.speed_error) == pytest.approx(0.0, abs=1e-12)
    assert max(abs(float(e)) for e in held.loss_error.values()) < 1e-3


@pytest.mark.slow
def test_verification_takes_part_in_compiled_functions_and_adds_no_derivative():
    compressor = load("mayekawa-wbhe").compressor
    options = TimeIntegration(diffrax.Tsit5(), 1e-8, samples=200)

    @jax.jit
    def both(mass):
        changed = eqx.tree_at(lambda c: c.mechanism.piston_mass, compressor, mass)

        def efficiency(mass):
            one = eqx.tree_at(lambda c: c.mechanism.piston_mass, changed, mass)
            orbit = solve_orbit(one, COARSE, verify=options)
            march = orbit.verification
            return orbit.mechanical_efficiency + march.speed_error, march

        (_, march), slope = jax.value_and_grad(efficiency, has_aux=True)(mass)
        plain = jax.grad(
            lambda m: (
                solve_orbit(
                    eqx.tree_at(lambda c: c.mechanism.piston_mass, compressor, m), COARSE
                ).mechanical_efficiency
            )
        )(mass)
        return slope, plain, march

    slope, plain, march = both(jnp.asarray(2.65))
    assert float(slope) == float(plain) != 0.0
    assert 1e-7 < float(march.speed_error) < 1e-4


def test_march_that_does_not_end_says_what_to_take():
    with pytest.raises(SolveFailed, match="Kvaerno5"):
        solve_orbit(
            load("mayekawa-wbhe"),
            COARSE,
            verify=TimeIntegration(diffrax.Dopri8(), 1e-12, max_steps=5),
        )


def test_result_and_report_show_what_the_march_found(pair):
    from jaxcomp.cli._run_tables import run_tables

    coarse, _ = pair
    scene = load("mayekawa-wbhe")
    state = steady_state(scene, orbit=coarse)
    result = state.entries() | {"tolerance": 1e-13, "set": {}, "design": {}}
    shown = result["verification"]
    # errors of the orbit: its values less those of the march
    assert shown["losses"]["wall"] == -float(coarse.verification.loss_error["wall"])
    *_, last = run_tables(scene, result)
    assert "Mechanical efficiency" in list(last.columns[0].cells)
    (check,) = (c for c in state.evidence() if c.name == "Errors by an independent march")
    assert check.good
    # a march whose speed differs by a thousandth of the mean
    off = eqx.tree_at(lambda o: o.verification.speed_error, coarse, jnp.asarray(1e-3))
    (check,) = (
        c
        for c in dataclasses.replace(state, orbit=off).evidence()
        if c.name == "Errors by an independent march"
    )
    assert not check.good
    assert np.isfinite(list(shown["peak_forces"].values())).all()
