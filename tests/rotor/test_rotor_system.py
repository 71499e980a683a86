"""The prepared rotor: every verb takes it in place of the model, with the same numbers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load
from jaxcomp.rotor import (
    Disks,
    Link,
    ModalDamping,
    Mount,
    RotorModel,
    ShaftElements,
    Unbalances,
    critical_speeds,
    damped_modes,
    respond,
    transmitted_forces,
    undamped_modes,
)
from jaxcomp.rotor._prepare import prepare
from jaxcomp.vibration import loaded_rotor

LOADS = (Unbalances((1,), 1e-4, 0.3),)
SPEEDS = jnp.array([120.0, 340.0])


def machine(damping=None):
    shaft = ShaftElements((1, 2, 3), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    bearing = Mount([1e7, 2e7], [100.0, 100.0])
    links = (Link((1, None), bearing), Link((3, None), bearing))
    return RotorModel((shaft,), (Disks((2,), 5.0, 6e-3, 12e-3),), links=links, damping=damping)


VERBS = {
    "undamped_modes": lambda m: undamped_modes(m, 4),
    "damped_modes": lambda m: damped_modes(m, 200.0, 4).eigenvalue,
    "critical_speeds": lambda m: critical_speeds(m, 2).speed,
}


@pytest.fixture(scope="module")
def responses():
    """Transmitted forces, and the slope of the amplitudes by the diameters: directly and prepared.

    Both of one program each.
    """
    model = machine()

    def amplitude(diameter, through):
        rotor = through(eqx.tree_at(lambda m: m.shafts[0].outer_diameter, model, diameter))
        response = respond(rotor, LOADS, SPEEDS)
        forces = transmitted_forces(rotor, response)
        return jnp.sum(jnp.abs(response.displacement)), forces

    at = model.shafts[0].outer_diameter
    with_slope = jax.jit(jax.grad(amplitude, has_aux=True), static_argnums=1)
    return [with_slope(at, through) for through in (_unchanged, prepare)]


def _unchanged(model):
    return model


def assert_alike(direct, prepared):
    # two programs round differently
    np.testing.assert_allclose(direct, prepared, rtol=1e-8, atol=1e-8 * np.abs(direct).max())


def test_a_prepared_rotor_has_the_forces_of_its_model(responses):
    assert_alike(*(forces for _, forces in responses))


@pytest.mark.parametrize("verb", VERBS)
def test_a_prepared_rotor_stands_for_its_model(verb):
    model = machine()
    system = prepare(model)
    assert prepare(system) is system
    for direct, prepared in zip(
        *map(jax.tree.leaves, map(VERBS[verb], (model, system))), strict=True
    ):
        assert_alike(direct, prepared)


def test_modal_damping_is_prepared_once():
    model = machine(ModalDamping([0.01, 0.02]))
    a, b = (respond(m, LOADS, SPEEDS).displacement for m in (model, prepare(model)))
    np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-10 * np.abs(a).max())


def test_derivatives_go_through_the_preparation(responses):
    direct, prepared = (slope for slope, _ in responses)
    np.testing.assert_allclose(direct, prepared, rtol=1e-8, atol=1e-10 * np.abs(direct).max())


def test_a_prepared_rotor_leaves_less_to_trace():
    """The beam elements, a fifth of the program, are not in that of a prepared rotor."""
    model = machine()

    def size(m):
        array, rest = eqx.partition(m, eqx.is_array)
        run = lambda a: respond(eqx.combine(a, rest), LOADS, SPEEDS).displacement  # noqa: E731
        return len(jax.jit(run).lower(array).as_text().splitlines())

    assert size(prepare(model)) < 0.9 * size(model)


@pytest.mark.parametrize(
    ("transform", "most"),
    [pytest.param(lambda f: f, 8_425, marks=pytest.mark.slow), (jax.value_and_grad, 9_925)],
)
def test_programs_of_a_response_stay_small(transform, most):
    """The first response and gradient of a user wait for the compiler, by the size of its input.

    The response of `hermetic-68cc` and its gradient to 40 diameters: half of the value's lines are the
    solutions of Reynolds' equation for its films.
    """
    machine = load("hermetic-68cc").assembly
    # shapes are enough: the loads of its films are not computed
    shapes = eqx.filter_eval_shape(lambda speeds: loaded_rotor(machine, speeds), jnp.array([314.0]))
    is_array = lambda leaf: isinstance(leaf, (jax.ShapeDtypeStruct, jax.Array))  # noqa: E731
    arrays, static_part = eqx.partition(shapes, is_array)
    place = lambda m: m.shafts[0].outer_diameter  # noqa: E731

    def run(diameter, arrays):
        model = eqx.combine(arrays, static_part)

        def amplitude(diameter):
            rotor = eqx.tree_at(place, model, diameter)
            x = respond(rotor, machine.loads.loads, SPEEDS, (1, 2)).displacement
            return jnp.sum(jnp.abs(x) ** 2)

        return transform(amplitude)(diameter)

    program = jax.jit(run).lower(place(shapes), arrays).as_text()
    assert len(program.splitlines()) < most
