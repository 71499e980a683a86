"""Larger and smaller of numbers: values of JAX, derivatives that no rounding decides."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcomp
from jaxcomp._core.extremes import clip, max_of, maximum, min_of, minimum

TABLE = jnp.array([[3.0, -1.0, 2.0], [0.5, 4.0, -2.0]])
BOUND = jnp.array([2.5, -1.0, 0.0])


@pytest.mark.parametrize(
    ("function", "of_jax"),
    [
        (lambda x: maximum(x, BOUND), lambda x: jnp.maximum(x, BOUND)),
        (lambda x: minimum(BOUND, x), lambda x: jnp.minimum(BOUND, x)),
        (lambda x: clip(x, BOUND, 3), lambda x: jnp.clip(x, BOUND, 3)),
        (lambda x: clip(x, 3.0, BOUND), lambda x: jnp.clip(x, 3.0, BOUND)),
        (max_of, jnp.max),
        (min_of, jnp.min),
        (lambda x: max_of(x, 0), lambda x: jnp.max(x, 0)),
        (lambda x: min_of(x, -1), lambda x: jnp.min(x, -1)),
    ],
)
def test_values_and_derivatives_are_those_of_jax(function, of_jax):

    def results(function, x):
        apart = x + 1e-3
        swept = jax.vmap(jax.grad(lambda v: jnp.sum(function(v) ** 2)))
        slopes = jax.jacfwd(function)(apart), jax.jacrev(function)(apart)
        return function(x), slopes, swept(jnp.stack([apart, 2 * apart]))

    # one program: outside of one every operation is compiled by itself
    both = jax.jit(lambda x: (results(function, x), results(of_jax, x)))
    # no number of it stands on a bound but one, which is no way there
    (value, slopes, swept), (value_of_jax, slopes_of_jax, swept_of_jax) = both(
        TABLE.at[1, 1].add(0.25)
    )
    np.testing.assert_array_equal(value, value_of_jax)
    for slope, slope_of_jax in zip(slopes, slopes_of_jax, strict=True):
        np.testing.assert_array_equal(slope, slope_of_jax)
    np.testing.assert_allclose(swept, swept_of_jax, rtol=1e-15)


@pytest.mark.parametrize("function", [maximum, minimum, lambda x, y: clip(x, y, 2 * y)])
def test_a_derivative_asks_for_no_equality(function):
    """A result that is computed a second time may differ in its last bit from the first."""
    program = str(jax.make_jaxpr(jax.grad(lambda x: function(x * x, 1.0)))(0.3))
    assert not re.search(r"= eq\b", program)


@pytest.mark.parametrize("function", [max_of, min_of])
def test_a_derivative_of_many_numbers_asks_for_their_place(function):
    program = str(jax.make_jaxpr(jax.grad(lambda x: function(x * x)))(jnp.ones(3)))
    assert not re.search(r"= eq\b", program)
    assert "argm" in program


def test_a_number_that_is_none_stays_none():
    for value in (maximum(jnp.nan, 1.0), minimum(1.0, jnp.nan), clip(jnp.nan, 0.0, 1.0)):
        assert np.isnan(value)
    assert np.isnan(max_of(jnp.array([1.0, jnp.nan])))


def test_whole_numbers_are_compared_beside_derivatives():
    def scaled(x):
        return x * maximum(jnp.array([1, 5]), 3).sum() + 0.0 * max_of(jnp.array([1, 2]))

    assert jax.grad(scaled)(2.0) == 8


def test_no_other_module_takes_those_of_jax():
    package = Path(jaxcomp.__file__).parent
    taken = re.compile(r"\bjnp\.(maximum|minimum|clip|max|min)\(")
    for path in sorted(package.rglob("*.py")):
        inside = path.relative_to(package)
        if inside.parts[0] == "plot" or inside.name == "extremes.py":
            continue
        assert not taken.search(path.read_text()), inside
