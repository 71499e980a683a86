"""Anderson's mixing: where a step by itself does not contract."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp._core.roots import mix, settle


def rotated(eigenvalues):
    """A symmetric matrix of these eigenvalues, in random directions."""
    directions = np.linalg.qr(np.random.default_rng(0).normal(size=(len(eigenvalues),) * 2))[0]
    return jnp.asarray(directions @ np.diag(eigenvalues) @ directions.T)


def test_a_linear_step_that_moves_away_in_two_directions_is_mixed_to_its_fixed_point():
    matrix = rotated([3.0, -2.0, 0.1, 0.05, 0.01, 0.0])
    offset = jnp.arange(1.0, 7.0)

    def step(value, _):
        return matrix @ value + offset, None

    value, _, report = mix(step, jnp.zeros(6), None, 1e-11, 30)
    assert bool(report.settled)
    assert int(report.steps) <= 20
    wanted = np.linalg.solve(np.eye(6) - matrix, offset)
    # the change at the end is 1e-11, and the smallest eigenvalue of the system one
    np.testing.assert_allclose(value, wanted, atol=1e-10)
    assert not bool(settle(step, jnp.zeros(6), None, 1e-11, 30)[2].settled)


def test_data_are_those_of_the_step_whose_value_is_given_back():
    def step(value, _):
        new = {"x": jnp.cos(value["x"])}
        return new, value["x"]

    value, before, report = mix(step, {"x": jnp.ones(2)}, jnp.zeros(2), 1e-13, 40)
    assert bool(report.settled)
    # alone it would take 75 steps
    assert int(report.steps) < 12
    np.testing.assert_array_equal(value["x"], jnp.cos(before))
    np.testing.assert_allclose(value["x"], 0.7390851332151607, rtol=1e-13)


def test_a_step_with_noise_ends_where_changes_are_noise():
    """As where a bounce of a valve comes and goes from one step to the next."""

    def step(value, count):
        noise = 1e-4 * jnp.sin(7.0 * count) * jnp.arange(1.0, 4.0)
        return 0.1 * value + 1 + noise, count + 1

    first = jnp.zeros(3), jnp.zeros(())
    assert not bool(mix(step, *first, 1e-8, 40)[2].settled)
    value, _, report = mix(step, *first, 1e-8, 40, noise=1e-2)
    assert bool(report.settled)
    assert int(report.steps) < 25
    # three times the noise of the last value, and what is left of it in those before
    np.testing.assert_allclose(value, 1 / 0.9, atol=1e-3)


@pytest.mark.parametrize("factor", [jnp.nan, 1e9])
def test_a_step_that_is_lost_is_not_taken(factor):
    value, _, report = mix(lambda x, _: (factor * (x + 1), None), jnp.ones(3), None, 1e-10, 20)
    np.testing.assert_array_equal(value, jnp.ones(3))
    assert not bool(report.settled)


def test_lanes_of_a_batch_end_each_for_itself():
    def solved(slope):
        value, _, report = mix(lambda x, _: (slope * x + 1, None), jnp.zeros(1), None, 1e-12, 30)
        return value[0], report.settled

    slopes = jnp.array([0.0, 0.5, -3.0])
    values, settled = jax.vmap(solved)(slopes)
    assert bool(settled.all())
    np.testing.assert_allclose(values, 1 / (1 - slopes), rtol=1e-11)
