"""Balancing on the model of rotor, crankcase and housing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rotor_machine import machine

from jaxcomp import load
from jaxcomp.balancing import (
    classical_balance,
    direct_influence,
    least_squares,
    rod_ring,
    trial_influence,
)
from jaxcomp.rotor import BalancingPlanes, CorrectionPlane, TargetPlane, Unbalances, respond
from jaxcomp.rotor._nodes import node_names

SPEEDS = jnp.array([300.0, 360.0])
PLACES = BalancingPlanes(
    planes=(CorrectionPlane("top", 2, 0.026), CorrectionPlane("counterweight", 6, 0.026)),
    targets=(
        TargetPlane("lid", "h4", weight=2.0),
        TargetPlane("gap", 4, axes=("ux",), relative_to=1),
    ),
    speeds=SPEEDS,
)
LOADS = (Unbalances((3, 7), [3e-4, 5e-4], [0.3, 2.0]),)


@pytest.fixture(scope="module")
def model():
    return machine()


@pytest.fixture(scope="module")
def influence(model):
    return direct_influence(model, LOADS, PLACES)


def read(model, loads):
    """The targets' vibration from the response itself, in the order of the rows."""
    x = respond(model, loads, SPEEDS).displacement[0]
    at = {name: i for i, name in enumerate(node_names(model))}
    lid, gap = x[:, at["h4"]], x[:, at[4]] - x[:, at[1]]
    return jnp.stack([lid[:, 0], lid[:, 1], gap[:, 0]], axis=1).reshape(-1)


@pytest.mark.slow
def test_trial_weights_and_direct_coefficients_agree(model, influence):
    masses = 1e-4 * jnp.exp(1j * jnp.array([0.5, -1.0]))
    trials = [
        read(model, (*LOADS, Unbalances((plane.node,), [abs(m)], [jnp.angle(m)])))
        for plane, m in zip(PLACES.planes, masses, strict=True)
    ]
    by_trial = trial_influence(
        read(model, LOADS), jnp.stack(trials), masses, influence.rows, influence.planes
    )
    np.testing.assert_allclose(by_trial.initial, influence.initial, rtol=1e-11)
    size = np.max(np.abs(influence.matrix))
    # the difference of two responses of like size leaves 12 digits
    np.testing.assert_allclose(by_trial.matrix, influence.matrix, atol=1e-10 * size)
    assert [row.target for row in influence.rows] == ["lid", "lid", "gap"] * 2
    assert [row.speed for row in influence.rows] == [300.0] * 3 + [360.0] * 3
    np.testing.assert_array_equal(influence.weight, [2, 2, 1, 2, 2, 1])


def test_the_balanced_machine_vibrates_as_predicted(model, influence):
    balance = least_squares(influence)
    added = Unbalances(
        tuple(plane.node for plane in PLACES.planes),
        jnp.abs(balance.correction),
        jnp.angle(balance.correction),
    )
    after = read(model, (*LOADS, added))
    np.testing.assert_allclose(
        after, balance.residual, atol=1e-11 * float(jnp.max(jnp.abs(influence.initial)))
    )
    assert float(balance.improvement) < 1


def test_unbalance_in_the_planes_is_found(model):
    planted = jnp.array([2e-4, 3e-4]), jnp.array([1.0, -2.0])
    balance = least_squares(direct_influence(model, (Unbalances((2, 6), *planted),), PLACES))
    # the condition of the system is a few hundred
    np.testing.assert_allclose(
        balance.correction, -planted[0] * jnp.exp(1j * planted[1]), rtol=1e-9
    )


@pytest.mark.slow
def test_derivative_of_the_residual_equals_differences(model):
    @jax.jit
    def left(mount):
        return least_squares(direct_influence(machine(mount=mount), LOADS, PLACES)).objective

    step = 2e4 * 1e-4
    estimate = (left(2e4 + step) - left(2e4 - step)) / (2 * step)
    # h^2 = 1e-8 of the central difference, times a second derivative of order one
    assert float(jax.jit(jax.grad(left))(2e4)) == pytest.approx(float(estimate), rel=1e-5)


def test_ring_stands_for_the_rotating_part_of_the_rod():
    """Two planes that hold sum and couple of shaft and rod, solved by NumPy from lengths in mm."""
    scene = load("hermetic-68cc")
    machine = scene.assembly
    rotor, case, places = machine.rotor, machine.loads, machine.balancing
    unbalances = case.unbalances
    # crank radius 16.975 mm, rod of 180 g and 78 mm with its centre 22 mm from the big end
    ring = 180 * 16.975 * (78 - 22) / 78
    assert ring == pytest.approx(2194, abs=0.5)
    z = {
        6: 54,
        13: 134,
        48: 140,
        15: 146,
        16: 151,
        19: 159,
        21: 169,
        23: 179,
    }  # from the rotor's top
    magnitude = {
        node: size * 1e6 * np.cos(float(phase))
        for table in unbalances
        for node, size, phase in zip(table.nodes, table.magnitude, table.phase, strict=True)
    }
    for carried, given in ((0.0, None), (ring, rod_ring(machine))):
        total = sum(magnitude.values()) + carried
        couple = sum(z[node] * u for node, u in magnitude.items()) + z[21] * carried
        wanted = np.linalg.solve([[1, 1], [z[6], z[48]]], [-total, -couple])
        found = classical_balance(rotor, unbalances, places, speed=314.0, ring=given).correction
        # rounding of sums of a few thousand g mm
        np.testing.assert_allclose(np.asarray(found) * 1e6, wanted, rtol=1e-9)


def test_machine_without_a_rod_has_no_ring():
    assert rod_ring(load("slider-link-8cc").assembly) is None
