"""Small linear systems solved within the program itself.

`jnp.linalg.solve` calls LAPACK. On a single processor jaxlib (0.9.2) leaves such a call in some programs
without the version of its interface, and the program does not compile: "No registered implementation for
untyped custom call to lapack_dgetrf_ffi".
"""

from functools import partial

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float


def solve_small(
    matrix: Float[Array, "*n s s"], right: Float[Array, "*n s k"]
) -> Float[Array, "*n s k"]:
    """Solutions of systems of a dozen rows, by Gauss's and Jordan's elimination with pivots by column.

    Args:
        matrix: one for each system; a singular one gives numbers that are not finite.
        right: right-hand sides.
    """
    size = matrix.shape[-1]
    rows = jnp.arange(size)

    def eliminate(carry, k):
        augmented, free = carry
        column = lax.dynamic_index_in_dim(augmented, k, -1, keepdims=False)
        # -1 keeps a row from being chosen twice, also where what is left of the column is zero.
        best = jnp.argmax(jnp.where(free, jnp.abs(column), -1.0), axis=-1)
        # by masks and sums: an index would be another one for each system of a batch
        is_pivot = rows == best[..., None]
        pivot = jnp.sum(jnp.where(is_pivot, column, 0.0), axis=-1, keepdims=True)
        row = jnp.sum(jnp.where(is_pivot[..., None], augmented, 0.0), axis=-2) / pivot
        reduced = augmented - column[..., None] * row[..., None, :]
        return (jnp.where(is_pivot[..., None], row[..., None, :], reduced), free & ~is_pivot), best

    free = jnp.ones(matrix.shape[:-1], bool)
    (augmented, _), order = lax.scan(eliminate, (jnp.concatenate([matrix, right], -1), free), rows)
    # the unknown k stands in the row that was its pivot
    return jnp.take_along_axis(
        augmented[..., size:], jnp.moveaxis(order, 0, -1)[..., None], axis=-2
    )


# Rows of a matrix from which substitution within the program is taken. BLAS shares such a solution out
# among threads, and these wait for each other for longer than they work: 160 systems of 128 rows and 18
# right-hand sides take 0.03 s on one thread, 0.07 to 0.3 s on two, and 0.06 s by substitution; 128
# systems of 48 rows 0.003 s and 0.006 s.
_ROWS_OF_SUBSTITUTION = 96


def solve_triangles(
    factors: Float[Array, "*n s s"], right: Float[Array, "*n s k"]
) -> Float[Array, "*n s k"]:
    """Solutions by the factors L and U of matrices, in one array, of right-hand sides in their order.

    Args:
        factors: as `lax.linalg.lu` gives them.
        right: right-hand sides, with rows in the order of the pivots.
    """
    rows = factors.shape[-1]
    if rows < _ROWS_OF_SUBSTITUTION or right.shape[-1] == 1:
        # the ones on the diagonal of L are not stored: that of U stands there
        options = {"left_side": True, "lower": True, "unit_diagonal": True}
        half = lax.linalg.triangular_solve(factors, right, **options)
        return lax.linalg.triangular_solve(factors, half, left_side=True, lower=False)
    places = jnp.arange(rows)

    def substitute(solution, row, above):
        """The solution with one more row, by the rows above it or below it."""
        coefficients = lax.dynamic_index_in_dim(factors, row, -2, keepdims=False)
        is_solved = places > row
        if above:
            is_solved = places < row
        by_solved = jnp.where(is_solved, coefficients, 0.0)
        value = lax.dynamic_index_in_dim(solution, row, -2, keepdims=False)
        value = value - jnp.sum(by_solved[..., None] * solution, axis=-2)
        if not above:
            value = value / lax.dynamic_index_in_dim(coefficients, row, -1)
        return lax.dynamic_update_index_in_dim(solution, value, row, right.ndim - 2), None

    half, _ = lax.scan(partial(substitute, above=True), right, places)
    return lax.scan(partial(substitute, above=False), half, places, reverse=True)[0]
