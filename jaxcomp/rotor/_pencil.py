r"""Symmetric eigenproblems, with derivatives that stay finite where eigenvalues are repeated."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import max_of

# Eigenvalues closer than this, relative to the largest, count as one. It lies well above the
# rounding of `eigh` (some n eps) and far below any split that a table of frequencies would show.
CLUSTER = 1e-11


@jax.custom_jvp
def eigh(a: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    r"""Eigenvalues (ascending) and orthonormal eigenvectors of a symmetric matrix.

    Derivatives: d lambda_i = v_i^T dA v_i, and dv_i = sum_j v_j (v_j^T dA v_i)/(lambda_i -
    lambda_j) over the j outside the cluster of i. That is exact for everything that does not depend
    on the choice of a basis inside a cluster: sums over it, its subspace, and each of its
    eigenvalues as long as they stay equal. For the split of a pair along one direction use
    `mode_derivatives`.
    """
    return tuple(jnp.linalg.eigh(a, symmetrize_input=False))


@eigh.defjvp
def _eigh_jvp(primals, tangents):
    (a,) = primals
    (da,) = tangents
    values, vectors = eigh(a)
    gap = values[None, :] - values[:, None]
    same = jnp.abs(gap) <= CLUSTER * max_of(jnp.abs(values))
    inner = vectors.conj().T @ da @ vectors
    # Double where: the quotient of a vanishing gap must not reach the tangent.
    turn = jnp.select([~same], [inner / jnp.where(same, 1.0, gap)])
    return (values, vectors), (jnp.diagonal(inner).real, vectors @ turn)


def definite_pencil(
    k: Float[Array, "n n"], m: Float[Array, "n n"]
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Solve M x = mu K x with M and K Hermitian and K positive definite.

    Returns:
        mu in ascending order, and vectors (columns) with x^H K x = 1; NaN if K is not definite.
    """
    matrix, weight = _scaled(k)
    lower = jnp.linalg.cholesky(matrix).astype(m.dtype)
    # A = L^{-1} M L^{-H} with K = L L^H and x = L^{-H} v: K is factorised, as M may be singular.
    half = jax.scipy.linalg.solve_triangular(lower, weight[:, None] * m * weight, lower=True)
    a = jax.scipy.linalg.solve_triangular(lower, half.conj().T, lower=True)
    mu, v = eigh((a + a.conj().T) / 2)
    return mu, weight[:, None] * jax.scipy.linalg.solve_triangular(lower, v, lower=True, trans=2)


def pencil(
    k: Float[Array, "n n"], m: Float[Array, "n n"]
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    r"""Solve K x = lambda M x with M and K symmetric, both allowed to be singular.

    With a shift s that makes K + s M positive definite, mu = 1/(lambda + s) are the eigenvalues of
    L^{-1} M L^{-T}. Massless coordinates give mu = 0, rigid motions mu = 1/s. The low modes come
    out with all digits, which a factorisation of M would spend on the highest ones.

    Returns:
        mu in descending order, and vectors (columns) with x^T M x = mu; both may be NaN if no shift
        was found (K has a negative part without inertia).
    """
    inertia = jnp.diagonal(m)
    d = jnp.select([inertia > 0], [inertia], jnp.nan)
    # So far below the elastic modes that lambda = 1/mu - s keeps their digits; by the median,
    # because of single stiff springs.
    s = 1e-8 * jnp.nanmedian(jnp.abs(jnp.diagonal(k)) / d)
    # lambda does not depend on the shift, so that this choice has no derivative.
    s = jax.lax.stop_gradient(jnp.where(s > 0, s, 1.0))
    kf, mf = jax.lax.stop_gradient((k, m))

    def fails(state):
        shift, tries = state
        return (tries < 12) & ~jnp.all(
            jnp.isfinite(jnp.linalg.cholesky(_scaled(kf + shift * mf)[0]))
        )

    # A negative stiffness (magnetic pull beyond its limit) needs a larger shift.
    s, _ = jax.lax.while_loop(fails, lambda state: (state[0] * 30, state[1] + 1), (s, 0))
    mu, x = definite_pencil(k + s * m, m)
    return mu[::-1], x[:, ::-1]


def _scaled(k):
    # Unit diagonal: displacements and rotations of stiff and soft parts come to one size.
    d = jax.lax.stop_gradient(jnp.diagonal(k).real)
    weight = 1 / jnp.sqrt(jnp.where(d > 0, d, 1.0))
    return weight[:, None] * k * weight, weight
