"""The verbs of a rotor on a whole machine, against the model put together by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, Collocation, damped_modes, load, respond, rotor, rotor_at
from jaxcomp.scene import with_value
from jaxcomp.study import AnalysisOptions, DesignResult
from jaxcomp.vibration._coupling import crank_loads, loaded_rotor, running_rotor

SPEEDS = jnp.array([300.0, 340.0])
FAST = Collocation(reversals=0, tolerance=1e-11)  # what forces on the rotor are solved by


@pytest.fixture(scope="module")
def scene():
    return load("hermetic-68cc")


@pytest.mark.slow
def test_response_to_the_crank_is_that_of_each_speed_alone(scene):
    found = respond(scene, spin_speeds=SPEEDS, excitation="crank").checked()
    assert found.displacement.shape[:2] == (1, 2)
    crank = crank_loads(scene.assembly, SPEEDS[1], (1,), FAST)
    alone = rotor.respond(*running_rotor(scene.assembly, crank), SPEEDS[1:]).checked()
    size = float(jnp.abs(alone.displacement).max())
    # the same equations in other batches, refined until a correction is below 1e-8
    np.testing.assert_allclose(found.displacement[:, 1:], alone.displacement, atol=1e-8 * size)
    np.testing.assert_array_equal(found.frequency, SPEEDS[None])


@pytest.mark.slow
def test_response_to_the_forces_of_the_scene_counts_corrections(scene):
    """Vibration as a quantity of the design, with a correction, in the film loads of each speed."""
    machine = with_value(scene, "rotor.dof", 4).machine
    machine.corrections["rotor-top"] = jnp.array([3e-4, 1e-4])
    at = scene.assembly.balancing.speeds
    found = respond(machine, orders=(1,)).checked()
    target = DesignResult(machine, AnalysisOptions(excitation="file")).vibration.targets[:, 0]
    node = rotor.node_index(scene.assembly.rotor, scene.assembly.balancing.targets[0].node)
    np.testing.assert_allclose(found.displacement[0, :, node, 0], target[:, 0], rtol=1e-7)
    bare = respond(scene, orders=(1,)).checked()
    assert found.spin_speed.shape == (1, *at.shape)
    assert float(jnp.abs(found.displacement - bare.displacement).max()) > 1e-6


@pytest.mark.slow
def test_modes_of_a_scene_stand_in_their_films(scene):
    model = loaded_rotor(scene.assembly, SPEEDS[:1])
    by_hand = rotor.damped_modes(model, SPEEDS[0], 4).eigenvalue
    np.testing.assert_allclose(damped_modes(scene, SPEEDS[0], 4).eigenvalue, by_hand, rtol=1e-9)
    assert rotor_at(model) is model


def test_what_is_missing_is_named(scene):
    with pytest.raises(BadInput, match="rotor"):
        respond(load("mayekawa-wbhe"))
    with pytest.raises(BadInput, match="excitation"):
        respond(scene, excitation="both")
    with pytest.raises(BadInput, match="loads"):
        respond(scene.assembly.rotor, spin_speeds=SPEEDS)
    with pytest.raises(BadInput, match="spin_speeds"):
        respond(scene.assembly.rotor, ())
    for machine in (scene, scene.assembly.rotor):
        with pytest.raises(BadInput, match=r"`loads` must be .* speeds are named"):
            respond(machine, SPEEDS, SPEEDS)
    with pytest.raises(BadInput, match="`spin_speed` must be one number"):
        damped_modes(scene, SPEEDS)
