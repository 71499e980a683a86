r"""Half-Sommerfeld (Guembel) film of finite length, by a series; no table.

The whole ring is solved and negative pressure dropped, so that the film is exactly 0 < theta < pi.
With p = sum_m a_m p_m(theta) cos(lam_m zeta), lam_m = (m + 1/2) pi, a_m = 2 (-1)^m/lam_m, each
p_m obeys

    h p_m'' + 3 h' p_m' - (lam_m/q)^2 h p_m = r(theta),

r = 6 h'/h^2 for the steady film and 12 cos(theta)/h^2 for a radial velocity. In a sine (steady) or
cosine (velocity) series the equation is tridiagonal, because h holds a single cosine. The modes
left out are short-bearing films, whose sum is known. (Our derivation; after the series solutions of
the finite bearing by Tao 1959 and Donaldson 1957.)
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._chebyshev import continuation
from ._film import AbstractSolvedFilm, Scalar, film_ratio, friction_at

# Beyond this s = sqrt(1 - eps), eps = 0.9775, the series would need more terms; the functions go
# over to their limits for eps -> 1 (infinitely long thin zone, 0 < theta < pi; our derivation).
EDGE = 0.15
LOAD_LIMIT = 1.0  # Phi_p (1 - eps)
ATTITUDE_LIMIT = np.pi / np.sqrt(2)  # phi/sqrt(1 - eps)
DAMPING_LIMIT = 0.75 * np.pi * np.sqrt(2)  # C_rr (1 - eps)^1.5
CROSS_LIMIT = 3.0  # -C_tr (1 - eps)


class Guembel(AbstractSolvedFilm):
    """Half-Sommerfeld film of finite length.

    At equal eccentricity it carries less than the Reynolds film, by 2 to 17 %. The response to a
    velocity is found on the whole ring and integrated over the steady film, so that C_tr is a
    function of its own and C is not symmetric.

    Args:
        length_ratio: [-] q = L/D.
        modes: number of cosines along the bearing.
        terms: number of harmonics round it.
    """

    length_ratio: Scalar
    edge_values: Float[Array, " 4"]
    edge_slopes: Float[Array, " 4"]
    modes: int = eqx.field(static=True)
    terms: int = eqx.field(static=True)

    def __init__(self, length_ratio, modes: int = 6, terms: int = 64):
        self.length_ratio = jnp.asarray(length_ratio, dtype=jnp.result_type(float))
        self.modes, self.terms = modes, terms
        edge = jnp.asarray(EDGE, self.length_ratio.dtype)
        self.edge_values, self.edge_slopes = jax.jvp(self._inside, (edge,), (jnp.ones_like(edge),))

    def load_gain(self, film_ratio):
        return self.length_ratio**2 * jnp.exp(self._smooth(film_ratio)[0])

    def attitude_angle(self, film_ratio):
        return self._smooth(film_ratio)[1]

    def damping(self, film_ratio):
        x, smooth, scale = film_ratio, self._smooth(film_ratio), self.length_ratio**2
        return scale * jnp.exp(smooth[2]) * (1 + x) ** 1.5, -scale * smooth[3] * (1 + x)

    def friction_number(self, load_number):
        return friction_at(self, film_ratio(self, load_number))

    def _smooth(self, film_ratio: Scalar) -> Float[Array, " 4"]:
        """ln(load gain/q^2), attitude angle, ln(C_rr s^3/q^2) and -C_tr s^2/q^2."""
        s = 1 / jnp.sqrt(1 + film_ratio)
        beyond = s < EDGE
        inner = self._inside(jnp.where(beyond, EDGE, s))
        values, slopes = self.edge_values, self.edge_slopes
        ln_q2 = 2 * jnp.log(self.length_ratio)
        limits = [jnp.log(LOAD_LIMIT) - ln_q2, 0.0, jnp.log(DAMPING_LIMIT) - ln_q2]
        limits = jnp.stack([*limits, CROSS_LIMIT / self.length_ratio**2])
        outer = continuation(s, EDGE, values, slopes, limits)
        angle = continuation(s, EDGE, values[1], slopes[1], 0.0, ATTITUDE_LIMIT)
        return jnp.where(beyond, outer.at[1].set(angle), inner)

    def _inside(self, s: Scalar) -> Float[Array, " 4"]:
        radial, tangential, c_rr, c_tr = _series(
            1 - s**2, self.length_ratio, self.modes, self.terms
        )
        q2 = self.length_ratio**2
        gain = jnp.sqrt(radial**2 + tangential**2) * s**2
        return jnp.stack(
            [
                jnp.log(gain / q2),
                jnp.arctan2(tangential, -radial),
                jnp.log(c_rr * s**3 / q2),
                -c_tr * s**2 / q2,
            ]
        )


def _series(eps: Scalar, q: Scalar, modes: int, terms: int) -> tuple[Scalar, ...]:
    """F_r/eps, F_t/eps, C_rr and C_tr by the series, for eps < 1."""
    n = jnp.arange(terms + 1.0)
    k = n[1:]
    lam = (jnp.arange(modes) + 0.5) * jnp.pi
    stiff = (lam / q) ** 2
    root = jnp.sqrt(1 - eps**2)
    # 1/h = (1 + 2 sum (-b)^n cos(n theta))/root with b = (1 - root)/eps = eps b1.
    b1 = 1 / (1 + root)
    power = (-eps * b1) ** n[:-1]  # (-b)^(n-1) for n = 1, 2, ...

    # Steady pressure over eps: r = d(-6/h)/d theta = (12/root) sum n (-b)^n sin(n theta).
    p = _tridiagonal(k, stiff, eps, -12 / root * b1 * k * power)
    # Radial velocity: r = -12 d(1/h)/d eps, with db/d eps = b/(eps root).
    right = 24 * b1 * power * (k / root**2 + eps**2 / root**3)
    v = _tridiagonal(n, stiff, eps, jnp.concatenate([-12 * eps[None] / root**3, right]))

    # Integrals over 0 < theta < pi of sin(n theta) cos(theta) and of cos(n theta) sin(theta): only
    # even n meet the other kind.
    even = np.arange(terms + 1) % 2 == 0
    shape = np.where(even, 2 / np.where(even, np.arange(terms + 1.0) ** 2 - 1, 1.0), 0.0)
    sums = jnp.stack(
        [p @ (shape * n)[1:], p[:, 0] * jnp.pi / 2, -v[:, 1] * jnp.pi / 2, v @ shape], axis=1
    )
    # The modes left out are short bearings; the sum of 1/lam^4 over all modes is 1/6.
    tail = 1 - 6 * jnp.sum(1 / lam**4)
    short = [
        -2 * eps / root**4,
        jnp.pi / 2 / root**3,
        jnp.pi * (1 + 2 * eps**2) / root**5,
        -4 * eps / root**4,
    ]
    return tuple((1 / lam**2) @ sums + tail * q**2 * jnp.stack(short))


def _tridiagonal(
    n: Float[Array, " n"], stiff: Float[Array, " modes"], eps: Scalar, right: Float[Array, " n"]
) -> Float[Array, "modes n"]:
    """Harmonics of h p'' + 3 h' p' - stiff h p = right, for every mode.

    cos(theta) couples a harmonic to both neighbours with half its weight; the constant, if the
    series has one, to the first cosine with all of it.
    """
    stiff = stiff[:, None]
    from_below = -eps / 2 * (n**2 + 3 * n + stiff) * jnp.where(n == 0, 2.0, 1.0)
    from_above = -eps / 2 * (n**2 - 3 * n + stiff)
    none = jnp.zeros_like(stiff)
    return jax.lax.linalg.tridiagonal_solve(
        jnp.hstack([none, from_below[:, :-1]]),
        -(n**2 + stiff),
        jnp.hstack([from_above[:, 1:], none]),
        jnp.broadcast_to(right, (stiff.shape[0], n.shape[0]))[..., None],
    )[..., 0]
