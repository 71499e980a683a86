r"""The half-Sommerfeld (Guembel) film by a series.

In the half-Sommerfeld (Guembel) film of finite length the whole ring is solved and negative pressure
dropped, so that the film is exactly 0 < theta < pi. With p = sum_m a_m p_m(theta) cos(lam_m zeta),
lam_m = (m + 1/2) pi, a_m = 2 (-1)^m/lam_m, each p_m obeys

    h p_m'' + 3 h' p_m' - (lam_m/q)^2 h p_m = r(theta),

r = 6 h'/h^2 for the steady film and 12 cos(theta)/h^2 for a radial velocity. In a sine (steady) or
cosine (velocity) series the equation is tridiagonal, because h holds a single cosine. The modes
left out are short-bearing films, whose sum is known. (Our derivation; after the series solutions of
the finite bearing by Tao 1959 and Donaldson 1957.)
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._film import Scalar


@functools.partial(jax.jit, static_argnums=(2, 3))
def steady_series(eps: Scalar, q: Scalar, modes: int, terms: int) -> Float[Array, " 2"]:
    """F_r/eps and F_t/eps by the series, for eps < 1."""
    n = np.arange(1.0, terms + 1)
    root = jnp.sqrt(1 - eps**2)
    lam = _wave_numbers(modes)
    # Pressure over eps: r = d(-6/h)/d theta = (12/root) sum n (-b)^n sin(n theta).
    p = _tridiagonal(n, (lam / q) ** 2, eps, -12 / root * n * _harmonics(eps, terms))
    # Integral of sin(n theta) cos(theta) over 0 < theta < pi; its fellow with sin(theta) is pi/2
    # for n = 1 and zero for the others.
    radial = p @ (n * _half_wave(n))
    tangential = p[:, 0] * jnp.pi / 2
    short = [-2 * eps / root**4, jnp.pi / 2 / root**3]
    return _summed(lam, q, [radial, tangential], short)


@functools.partial(jax.jit, static_argnums=(2, 3))
def velocity_series(eps: Scalar, q: Scalar, modes: int, terms: int) -> Float[Array, " 2"]:
    """C_rr and C_tr by the series, for eps < 1."""
    n = np.arange(terms + 1.0)
    root = jnp.sqrt(1 - eps**2)
    lam = _wave_numbers(modes)
    # r = -12 d(1/h)/d eps, with db/d eps = b/(eps root).
    waves = 24 * _harmonics(eps, terms) * (n[1:] / root**2 + eps**2 / root**3)
    right = jnp.concatenate([-12 * eps[None] / root**3, waves])
    p = _tridiagonal(n, (lam / q) ** 2, eps, right)
    # Only cos(theta) itself has an integral with cos(theta) over 0 < theta < pi, pi/2.
    radial = -p[:, 1] * jnp.pi / 2
    cross = p @ _half_wave(n)
    short = [jnp.pi * (1 + 2 * eps**2) / root**5, -4 * eps / root**4]
    return _summed(lam, q, [radial, cross], short)


def _wave_numbers(modes: int) -> np.ndarray:
    return (np.arange(modes) + 0.5) * np.pi


def _harmonics(eps: Scalar, terms: int) -> Float[Array, " terms"]:
    """-(-b)^n/eps, n = 1, 2, ..., of 1/h = (1 + 2 sum (-b)^n cos(n theta))/sqrt(1 - eps^2)."""
    b_over_eps = 1 / (1 + jnp.sqrt(1 - eps**2))
    # products: the second derivative of a power of zero to an array of exponents is NaN
    return jnp.cumprod(jnp.full(terms, -eps * b_over_eps).at[0].set(b_over_eps))


def _half_wave(n: np.ndarray) -> np.ndarray:
    """2/(n^2 - 1) for even n, 0 for odd: minus the integral of cos(n theta) sin(theta) to pi."""
    even = n % 2 == 0
    return np.where(even, 2 / np.where(even, n**2 - 1, 1.0), 0.0)


def _summed(lam: np.ndarray, q: Scalar, modes: list, short: list) -> Float[Array, " 2"]:
    """Sum over the modes, and over those left out, which are short bearings (`short` over q^2)."""
    tail = 1 - 6 * np.sum(lam**-4.0)  # the sum of 1/lam^4 over all modes is 1/6
    # 1/lam^2 is half of a_m times the mean of cos(lam_m zeta) over the length.
    return jnp.stack(modes) @ lam**-2.0 + tail * q**2 * jnp.stack(short)


def _tridiagonal(
    n: Float[Array, " n"], stiff: Float[Array, " modes"], eps: Scalar, right: Float[Array, " n"]
) -> Float[Array, "modes n"]:
    """Harmonics of h p'' + 3 h' p' - stiff h p = right, for every mode.

    cos(theta) couples a harmonic to both neighbours with half its weight; the constant, if the
    series has one, to the first cosine with all of it.
    """
    stiff = stiff[:, None]
    # Each is listed by the harmonic that it comes from, and shifted to the row of the one above or
    # below, to which it goes.
    coupled_below = -eps / 2 * (n**2 + 3 * n + stiff) * jnp.where(n == 0, 2.0, 1.0)
    coupled_above = -eps / 2 * (n**2 - 3 * n + stiff)
    system = jnp.stack(
        [
            _shifted(coupled_below, 1),
            jnp.broadcast_to(-(n**2 + stiff), coupled_below.shape),
            _shifted(coupled_above, -1),
            jnp.broadcast_to(right, coupled_below.shape),
        ]
    )

    # Parallel cyclic reduction (Hockney and Jesshope 1981): every step couples harmonics twice as
    # far apart, until none is left. The matrix is diagonally dominant, so that nothing is pivoted;
    # whole rows are handled at once, where the usual elimination is a loop over harmonics. (LAPACK
    # behind `jax.lax.linalg.tridiagonal_solve` was faster, but has hung in batches under jax 0.10.)
    def reduce(system, step):
        below, diagonal, above, right = system
        lesser = _shifted(system, step)
        greater = _shifted(system, -step)
        # 1 in the place of the zero that is shifted in where a row has no such neighbour.
        low = below / jnp.where(n < n[0] + step, 1.0, lesser[1])
        high = above / jnp.where(n > n[-1] - step, 1.0, greater[1])
        reduced = [
            -low * lesser[0],
            diagonal - low * lesser[2] - high * greater[0],
            -high * greater[2],
            right - low * lesser[3] - high * greater[3],
        ]
        return jnp.stack(reduced), None

    steps = 2 ** np.arange(int(np.ceil(np.log2(n.shape[0]))))
    system, _ = jax.lax.scan(reduce, system, steps)
    # by now no harmonic is coupled to another
    return system[3] / system[1]


def _shifted(rows: Float[Array, "*rows n"], step: int | Int[Array, ""]) -> Float[Array, "*rows n"]:
    """Entry n - step in place of entry n, zero where there is none; `step` may be traced."""
    n = rows.shape[-1]
    wide = jnp.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(n, n)])
    return jax.lax.dynamic_slice_in_dim(wide, n - step, n, axis=-1)
