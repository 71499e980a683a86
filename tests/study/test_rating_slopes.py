"""Slopes of a rating point, with and without a rise of the suction gas that its own law gives back."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.study.rating import with_slopes

AT = jnp.array([2.0])


@pytest.mark.parametrize("warmed", [False, True])
def test_values_and_slopes_of_a_law(warmed):
    def law(p, rise):
        more, new = (rise, 10 * p[0] + 0.1 * rise) if warmed else (0.0, None)
        return jnp.stack([p[0] ** 2 + more, 3 * p[0]]), new, jnp.asarray(True)

    values, slopes, ok = with_slopes(law, AT, warmed)
    assert ok
    # the rise is 10 p/0.9, linear, so that Newton's method ends at rounding
    rise = 10 / 0.9 if warmed else 0.0
    np.testing.assert_allclose(values, [4 + 2 * rise, 6], rtol=1e-12)
    np.testing.assert_allclose(slopes, [[4 + rise], [3]], rtol=1e-12)


@pytest.mark.parametrize("warmed", [False, True])
def test_a_point_without_a_number_cannot_be_relied_on(warmed):
    def law(p, rise):
        return jnp.stack([p[0], jnp.nan * p[0]]), rise, jnp.asarray(True)

    assert not with_slopes(law, AT, warmed)[2]
