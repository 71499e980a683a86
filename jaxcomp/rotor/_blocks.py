"""Algebra of 2 x 2 blocks that are kept by components, see `_elimination`; factors of full matrices."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ._conventions import trailing


def lu_factor(a: Array) -> tuple[Array, Array]:
    """LU factors of matrices (..., n, n) and the permutation of their rows.

    That of `jax.scipy` keeps the exchanges, which every solution would turn into the permutation
    again.
    """
    lu, _, rows = jax.lax.linalg.lu(a)
    return lu, rows


def lu_solve(factor, b: Array, transpose: bool = False) -> Array:
    """Solve for right-hand sides (..., n, k), complex ones of a real matrix as well."""
    lu, rows = factor
    # A border may have no coordinates of a kind, and a load no columns: there is nothing to solve.
    if not b.size:
        return b
    if jnp.iscomplexobj(b) and not jnp.iscomplexobj(lu):
        k = b.shape[-1]
        # Side by side as real columns, which spares the factors a complex copy.
        parts = lu_solve(factor, jnp.concatenate([b.real, b.imag], -1), transpose)
        return parts[..., :k] + 1j * parts[..., k:]

    def by(b, **which) -> Array:
        options = {"left_side": True, "transpose_a": transpose, **which}
        return jnp.asarray(jax.lax.linalg.triangular_solve(lu, b, **options))

    if not transpose:
        b = jnp.take_along_axis(b, rows[..., None], -2, mode="promise_in_bounds")
        return by(by(b, lower=True, unit_diagonal=True), lower=False)
    # A[rows] = L U: the transpose meets U^T first, then L^T, and its rows are put back at the end.
    b = by(by(b, lower=False), lower=True, unit_diagonal=True)
    return jnp.take_along_axis(b, jnp.argsort(rows)[..., None], -2, mode="promise_in_bounds")


def real_times(a: Array, b: Array) -> Array:
    """The product of a matrix (..., m, n), which may be real, with any other one (..., n, k)."""
    if jnp.iscomplexobj(a) or not jnp.iscomplexobj(b):
        return a @ b
    k = b.shape[-1]
    # Side by side as real columns, since JAX would make the real matrix complex.
    parts = a @ jnp.concatenate([b.real, b.imag], -1)
    return jax.lax.complex(parts[..., :k], parts[..., k:])


def real_times_each(a: Array, b: Array) -> Array:
    """The product of a real matrix (m, n) with any array (n, ...)."""
    columns = math.prod(b.shape[1:])
    return real_times(a, b.reshape(len(b), columns)).reshape(len(a), *b.shape[1:])


def times_each(a: Array, x: Array) -> Array:
    """Products of matrices (s, i, j) or (s, i, j, ...), one at each speed, and vectors (s, j, ...)."""
    # Elementwise and no product of matrices, each of which is too small for a call of a library.
    return jnp.sum(trailing(a, x.ndim + 1 - a.ndim) * x[:, None], 2)


def in_parts(x: Array) -> Array:
    """Real and imaginary part along a first axis."""
    return jnp.stack([x.real, x.imag])


def from_parts(x: Array) -> Array:
    """The way back of `in_parts`."""
    return jax.lax.complex(x[0], x[1])


def inverse(s):
    """Inverse of a symmetric block, symmetric."""
    a, b, d = s
    # b b and not |b|^2: damped shafts make the blocks complex, but symmetric, not Hermitian.
    r = 1 / (a * d - b * b)
    return d * r, -b * r, a * r


def product(s, n):
    """S N with S symmetric."""
    a, b, d = s
    p, q, r, t = n
    return a * p + b * r, a * q + b * t, b * p + d * r, b * q + d * t


def product_t(m, n):
    """M^T N."""
    a, b, c, d = m
    p, q, r, t = n
    return a * p + c * r, a * q + c * t, b * p + d * r, b * q + d * t


def times(m, x):
    """M x."""
    a, b, c, d = m
    u, v = x
    return a * u + b * v, c * u + d * v


def times_t(m, x):
    """M^T x."""
    a, b, c, d = m
    u, v = x
    return a * u + c * v, b * u + d * v


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b, strict=True))
