"""Small linear systems that a program solves without LAPACK."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxcomp._core.elimination import solve_small, solve_triangles


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_systems_are_solved_as_lapack_does(seed):
    random = np.random.default_rng(seed)
    matrix, right = random.normal(size=(3, 8, 8)), random.normal(size=(3, 8, 2))
    matrix[0, 0, 0] = 0.0  # which is no pivot
    found = jax.jit(solve_small)(matrix, right)
    left = np.abs(matrix @ found - right).max((1, 2))
    # pivots by column keep what is left over near rounding, relative to matrix times solution
    size = np.abs(matrix).sum(-1).max(-1) * np.abs(found).max((1, 2))
    assert np.all(left < 1e-13 * size)


@pytest.mark.parametrize("rows", [40, 128])
def test_substitution_in_the_program_is_that_of_lapack(rows):
    random = np.random.default_rng(rows)
    matrix = jnp.asarray(random.normal(size=(2, 3, rows, rows)))
    right = jnp.asarray(random.normal(size=(2, 3, rows, 18)))

    def solve(matrix, right):
        factors, _, order = jax.lax.linalg.lu(matrix)
        return solve_triangles(factors, jnp.take_along_axis(right, order[..., None], axis=-2))

    found = jax.jit(jax.vmap(solve))(matrix, right)
    left = jnp.max(jnp.abs(matrix @ found - right), axis=(2, 3))
    # rounding of sums of so many terms
    size = jnp.max(jnp.sum(jnp.abs(matrix), -1), -1) * jnp.max(jnp.abs(found), axis=(2, 3))
    assert np.all(left < 1e-14 * rows * size)


def test_large_systems_are_not_shared_out_among_threads():
    """BLAS on several threads takes ten times as long for a batch of these as on one."""

    def custom_calls(rows):
        shapes = (
            jax.ShapeDtypeStruct((3, rows, rows), float),
            jax.ShapeDtypeStruct((3, rows, 5), float),
        )
        return jax.jit(solve_triangles).lower(*shapes).as_text().count("trsm")

    assert custom_calls(128) == 0
    assert custom_calls(40) > 0


def test_derivatives_are_those_of_lapack():
    random = np.random.default_rng(0)
    matrix, right = jnp.asarray(random.normal(size=(5, 5))), jnp.asarray(random.normal(size=(5, 1)))
    slopes = (jax.grad(lambda a, s=s: jnp.sum(jnp.sin(s(a, right))))(matrix)
              for s in (solve_small, jnp.linalg.solve))  # fmt: skip
    # the condition of the matrix, 20, squared times rounding
    np.testing.assert_allclose(*slopes, rtol=1e-12)


def test_no_call_of_lapack_is_left():
    text = jax.jit(solve_small).lower(jnp.eye(4)[None], jnp.ones((1, 4, 1))).as_text()
    assert "custom_call" not in text


def test_a_singular_matrix_gives_no_number():
    found = solve_small(jnp.ones((2, 2)), jnp.arange(2.0)[:, None])
    assert not np.isfinite(found).any()
