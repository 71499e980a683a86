"""Lists of speeds of any length share a few compiled programs, and fill in nothing that shows."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax._src import compiler

import jaxcomp._core.fields  # noqa: F401  (takes the place of the function of JAX)
from jaxcomp.rotor import (
    Link,
    Mount,
    RotorModel,
    ShaftElements,
    Unbalances,
    respond,
    transmitted_forces,
)
from jaxcomp.rotor._speed_lists import filled, filled_length
from jaxcomp.vibration._coupling import _filled_in_front

SPEEDS = jnp.linspace(100.0, 300.0, 16)
LOADS = (Unbalances((2,), 1e-4, 0.3),)


def machine(nodes=(1, 2, 3)):
    shaft = ShaftElements(nodes, 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    bearing = Mount([1e7, 2e7], [100.0, 100.0])
    return RotorModel((shaft,), links=(Link((1, None), bearing), Link((3, None), bearing)))


@pytest.fixture
def compiled(monkeypatch):
    """Names of the programs that were compiled."""
    names = []
    compile_program = compiler.compile_or_get_cached

    def counted(backend, module, *others, **options):
        names.append(module.operation.attributes["sym_name"].value)
        return compile_program(backend, module, *others, **options)

    monkeypatch.setattr(compiler, "compile_or_get_cached", counted)
    return names


def test_another_number_of_speeds_compiles_no_other_response(compiled):
    # of a structure that no other test compiles
    model = machine(nodes=(1, 2, 3, 4, 5, 6))
    five = respond(model, LOADS, SPEEDS[:5])
    seven = respond(model, LOADS, SPEEDS[:7])
    assert compiled.count("jit__respond") == 1
    for a, b in zip(jax.tree.leaves(five), jax.tree.leaves(seven), strict=True):
        # one program, in which a speed knows nothing of the others
        np.testing.assert_array_equal(a, b[:, :5])
    assert five.displacement.shape == (1, 5, 6, 4)


def test_another_number_of_speeds_compiles_no_other_transmitted_forces(compiled):
    model = machine()
    forces = []
    for count in (5, 7, 8):
        response = respond(model, LOADS, SPEEDS[:count])
        forces.append(transmitted_forces(model, response))
    assert compiled.count("jit__transmitted") <= 1
    for some in forces[:2]:
        np.testing.assert_array_equal(some, forces[2][:, : some.shape[1]])


def test_filled_lists_change_neither_response_nor_derivatives():
    model = machine()
    speeds = SPEEDS[:5]
    at = lambda m: m.shafts[0].outer_diameter  # noqa: E731

    def amplitude(diameter, speeds):
        changed = eqx.tree_at(at, model, diameter)
        displacement = respond(changed, LOADS, speeds).displacement
        return jnp.sum(jnp.abs(displacement) ** 2), displacement

    slope = jax.grad(amplitude, has_aux=True)
    # within `jit` nothing is filled, and one program gives both
    plain_slope, plain = jax.jit(slope)(at(model), speeds)
    by_itself = respond(model, LOADS, speeds).displacement
    # programs of other lengths round differently
    np.testing.assert_allclose(by_itself, plain, rtol=0, atol=1e-13 * np.abs(plain).max())
    # Derivatives without `jit` call the function of this package by itself as well.
    by_itself_slope, _ = slope(at(model), speeds)
    np.testing.assert_allclose(by_itself_slope, plain_slope, rtol=1e-9)


def test_lengths_are_few_and_waste_little():
    lengths = {filled_length(count, 64) for count in range(1, 65)}
    assert lengths == {1, 2, 4, 8, 16, 32, 64}
    for count in range(65, 3000):
        length = filled_length(count, 64)
        assert length % 64 == 0
        assert count <= length < 1.25 * count + 64
    assert len({filled_length(count, 64) for count in range(65, 4096)}) < 25
    # a batch may have any size, and bounds the list that is filled up to it
    assert filled_length(9, 12) == 12
    assert filled_length(13, 12) == 24
    np.testing.assert_array_equal(filled(np.array([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0, 3.0])


def test_tables_of_film_loads_keep_their_values_and_slopes():
    speeds = np.array([100.0, 150.0, 300.0])
    table, asked = _filled_in_front(speeds)
    assert table.shape == asked.shape == (4,)
    assert np.all(np.diff(table) > 0)
    at = jnp.array([20.0, 100.0, 120.0, 300.0, 400.0])
    for transform in (lambda f: f, jax.grad):
        plain, longer = (
            jax.vmap(transform(lambda x, t=t, v=v: jnp.interp(x, t, v**2)))(at)
            for t, v in ((speeds, speeds), (table, asked))
        )
        np.testing.assert_array_equal(plain, longer)
