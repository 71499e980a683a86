"""Samples of a batch one after the other."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcomp._core.one_by_one import one_by_one


def test_every_sample_takes_its_own_steps():
    steps = []

    def halvings(start, label):
        assert label == "of a sample"

        def halve(carry):
            jax.debug.callback(steps.append, carry[1])
            return carry[0] / 2, carry[1] + 1

        return lax.while_loop(lambda carry: carry[0] > 1, halve, (start, jnp.zeros((), int)))[1]

    starts = jnp.array([2.0, 0.5, 1024.0])
    counts = jax.jit(jax.vmap(lambda start: one_by_one(halvings, start, "of a sample")))(starts)
    jax.effects_barrier()
    np.testing.assert_array_equal(counts, [1, 0, 10])
    # with one loop for all of them it would be ten times three
    assert len(steps) == 11
