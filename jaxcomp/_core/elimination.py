"""Small linear systems solved within the program itself.

`jnp.linalg.solve` calls LAPACK. On a single processor jaxlib (0.9.2) leaves such a call in some programs
without the version of its interface, and the program does not compile: "No registered implementation for
untyped custom call to lapack_dgetrf_ffi".
"""

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
