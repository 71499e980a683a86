r"""Film models without a table: closed forms, and the half-Sommerfeld film by a series.

Petroff (1883): Phi_T = pi. Falz, with the length factor of Dagilis et al., Eq. (20) corrected:
Phi_T = pi + 0.55 xi Phi_p, xi = (D/L)^1.5 for L < D and 1 for longer bearings (the source prints
L/D, which would let short bearings rub less). Short bearing: Ocvirk 1952; Dubois and Ocvirk, NACA
Report 1157, 1953.

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
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._film import (
    AbstractCarryingFilm,
    AbstractFilm,
    AbstractSolvedFilm,
    Scalar,
    as_float,
)
from ._reynolds import continuation


class Petroff(AbstractFilm):
    """Concentric journal: the friction of no load, whatever the load.

    Args:
        length_ratio: [-] q = L/D, which makes no difference.
    """

    limits: ClassVar[str] = (
        "Concentric, right at no load: at L/D = 1 the friction is 4 % too low at Phi_p = 0.3 and "
        "45 % at Phi_p = 3, at L/D = 1/4 15 % at Phi_p = 0.1. No position, no coefficients."
    )

    def friction_number(self, load_number):
        return jnp.pi + 0 * load_number


class LoadedPetroff(AbstractFilm):
    """Petroff's friction and a part that grows with the load.

    Args:
        length_ratio: [-] q = L/D.
    """

    limits: ClassVar[str] = (
        "Friction within 6 % at L/D = 1 up to Phi_p = 1 (eps 0.5), 16 % too low at 3, twice too high "
        "at 100, where it should grow like the root of the load; 24 % too high at L/D = 1/4 and "
        "Phi_p = 1. No position, no coefficients."
    )

    def friction_number(self, load_number):
        # below L = D only; the power of a clipped base keeps the slope finite
        slenderness = jnp.where(self.length_ratio < 1, self.length_ratio, 1.0) ** -1.5
        return jnp.pi + 0.55 * slenderness * load_number


class Ocvirk(AbstractSolvedFilm):
    r"""Film without the circumferential pressure gradient, negative pressures dropped.

    With s = 1 - eps^2 the film forces over eta omega L D/psi^2 are

        F_r = -2 q^2 eps^2/s^2     F_t = (pi/2) q^2 eps/s^(3/2)
        C_rr = pi q^2 (1 + 2 eps^2)/s^(5/2)

    Right for L/D -> 0. Against the Reynolds film the load is 2, 6 and 39 % too high at L/D = 1/4
    and eps = 0, 0.5 and 0.9, and 1.3, 1.7 and 5.7 times too high at L/D = 1.

    Args:
        length_ratio: [-] q = L/D.
    """

    limits: ClassVar[str] = (
        "Short bearing, right for L/D -> 0: the load is 2 % too high at L/D = 1/4 and eps -> 0, 39 % "
        "at eps = 0.9, and 1.3 to 5.7 times too high at L/D = 1."
    )

    def load_gain(self, film_ratio):
        # q^2 eps/(2 s^2) sqrt(pi^2 s + 16 eps^2) over x, with s = (1 + 2 x)/(1 + x)^2
        x = film_ratio
        root = jnp.sqrt(jnp.pi**2 * (1 + 2 * x) + 16 * x**2)
        return self.length_ratio**2 / 2 * (1 + x) ** 2 / (1 + 2 * x) ** 2 * root

    def attitude_angle(self, film_ratio):
        # tan(phi) = pi sqrt(1 - eps^2)/(4 eps)
        return jnp.arctan2(jnp.pi * jnp.sqrt(1 + 2 * film_ratio), 4 * film_ratio)

    def damping(self, film_ratio):
        x, q = film_ratio, self.length_ratio
        eps, s = x / (1 + x), (1 + 2 * x) / (1 + x) ** 2
        # The second is C_tr = C_rt = 2 F_r/eps.
        return jnp.pi * q**2 * (1 + 2 * eps**2) / s**2.5, -4 * q**2 * eps / s**2

    def pressure(self, film_ratio, theta, zeta):
        """[-] Pressure over eta omega/psi^2.

        Args:
            film_ratio: [-] eps/(1 - eps).
            theta: [rad] from the widest gap, with the rotation.
            zeta: [-] from 0 in the mid-plane to 1 at the edge.
        """
        eps = film_ratio / (1 + film_ratio)
        lobe = jnp.maximum(jnp.sin(theta), 0.0) / (1 + eps * jnp.cos(theta)) ** 3
        return 3 * self.length_ratio**2 * eps * lobe * (1 - zeta**2)


class ExplicitFit(AbstractCarryingFilm):
    r"""Friction and eccentricity by closed formulas; no attitude angle, stiffness or damping.

    Our own fits to 176 finite-difference solutions (film start free, 0.4 <= q <= 2,
    0.02 <= eps <= 0.97): Phi_T within 1.7 % for 0.5 <= q <= 1.5 and 2.8 % for 0.4 <= q <= 2, Phi_p of
    eps within 2.5 % for 0.4 <= q <= 2. Not for shorter bearings: 7 % off at q = 1/4.

    Args:
        length_ratio: [-] q = L/D, 0.4 to 2.
    """

    length_ratio_range: ClassVar[tuple[float, float]] = (0.4, 2.0)
    limits: ClassVar[str] = (
        "Closed fit: friction within 1.7 % for L/D 0.5 to 1.5 and 2.8 % for 0.4 to 2, load within "
        "2.5 % for eps to 0.97. No attitude angle, no coefficients."
    )

    def load_gain(self, film_ratio):
        # A power mean of the short (Ocvirk) and the long bearing (half-Sommerfeld), both over x;
        # 1 - eps^2 = (1 + 2 x)/(1 + x)^2.
        x = film_ratio
        eps = x / (1 + x)
        root = jnp.sqrt(16 * x**2 + jnp.pi**2 * (1 + 2 * x))
        short = self.length_ratio**2 / 2 * (1 + x) ** 2 / (1 + 2 * x) ** 2 * root
        root = jnp.sqrt(4 * x**2 + jnp.pi**2 * (1 + 2 * x))
        long = 3 * root / ((2 + eps**2) * (1 + 2 * x))
        m = 0.7650 - 0.1209 * eps - 0.0517 * eps**2 - 0.0988 * jnp.log(self.length_ratio)
        return ((0.9784 * short) ** -m + ((2.8220 - 1.5063 * eps) * long) ** -m) ** (-1 / m)

    def friction_number(self, load_number):
        # Phi_T = pi + a Phi^2/(1 + (a/c)^m Phi^((2 - k) m))^(1/m): Petroff at no load, like
        # c Phi^k at high load.
        ln_q = jnp.log(self.length_ratio)
        a = jnp.exp(0.4309 - 2.388 * ln_q + 1.111 * ln_q**2)
        c = jnp.exp(0.5845 - 0.0594 * ln_q + 0.1351 * ln_q**2)
        k, m = 0.5893 + 0.0186 * ln_q, 0.8969
        # A single power: its derivative at no load is zero, that of (Phi^2)^... would be 0/0.
        turn = (a / c) ** m * load_number ** ((2 - k) * m)
        return jnp.pi + a * load_number**2 / (1 + turn) ** (1 / m)


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

    steady_edge: tuple[Array, Array]
    damping_edge: tuple[Array, Array]
    limits: ClassVar[str] = (
        "Half-Sommerfeld film: carries 2 to 17 % less than the Reynolds film at equal eccentricity; "
        "at equal load its stiffness is 5 to 10 % and its damping 20 % off at high load. Series to "
        "eps 0.9775, limits of a closing film beyond."
    )
    modes: int = eqx.field(static=True)
    terms: int = eqx.field(static=True)

    def __init__(self, length_ratio, modes: int = 6, terms: int = 64):
        self.length_ratio = as_float(length_ratio)
        self.modes, self.terms = modes, terms
        edge = jnp.asarray(EDGE, self.length_ratio.dtype)
        # Value and slope where the continuation takes over.
        self.steady_edge = jax.jvp(self._steady, (edge,), (jnp.ones_like(edge),))
        self.damping_edge = jax.jvp(self._damping, (edge,), (jnp.ones_like(edge),))

    def load_gain(self, film_ratio):
        # The gain Phi_p/x is Phi_p (1 - eps)/eps, which has the limit of Phi_p (1 - eps).
        limit = jnp.log(LOAD_LIMIT) - 2 * jnp.log(self.length_ratio)
        log_gain = self._continued(film_ratio, self._steady, self.steady_edge, 0, limit)
        return self.length_ratio**2 * jnp.exp(log_gain)

    def attitude_angle(self, film_ratio):
        return self._continued(film_ratio, self._steady, self.steady_edge, 1, 0.0, ATTITUDE_LIMIT)

    def damping(self, film_ratio):
        x, q2 = film_ratio, self.length_ratio**2
        limit = jnp.log(DAMPING_LIMIT) - jnp.log(q2)
        radial = self._continued(x, self._damping, self.damping_edge, 0, limit)
        cross = self._continued(x, self._damping, self.damping_edge, 1, CROSS_LIMIT / q2)
        return q2 * jnp.exp(radial) * (1 + x) ** 1.5, -q2 * cross * (1 + x)

    def _continued(self, film_ratio, inside, at_edge, index, limit, limit_slope=None) -> Scalar:
        s = 1 / jnp.sqrt(1 + film_ratio)
        beyond = s < EDGE
        value, slope = at_edge[0][index], at_edge[1][index]
        outer = continuation(s, EDGE, value, slope, limit, limit_slope)
        # Double where: beyond its edge the series has too few terms, and its slopes may be anything.
        return jnp.where(beyond, outer, inside(jnp.where(beyond, EDGE, s))[index])

    def _steady(self, s: Scalar) -> Float[Array, " 2"]:
        """ln(load gain/q^2) and the attitude angle."""
        forces = _steady_series(1 - s**2, self.length_ratio, self.modes, self.terms)
        gain = jnp.sqrt(forces @ forces) * s**2
        return jnp.stack([jnp.log(gain / self.length_ratio**2), jnp.arctan2(forces[1], -forces[0])])

    def _damping(self, s: Scalar) -> Float[Array, " 2"]:
        """ln(C_rr s^3/q^2) and -C_tr s^2/q^2."""
        c_rr, c_tr = _velocity_series(1 - s**2, self.length_ratio, self.modes, self.terms)
        q2 = self.length_ratio**2
        return jnp.stack([jnp.log(c_rr * s**3 / q2), -c_tr * s**2 / q2])


@functools.partial(jax.jit, static_argnums=(2, 3))
def _steady_series(eps: Scalar, q: Scalar, modes: int, terms: int) -> Float[Array, " 2"]:
    """F_r/eps and F_t/eps by the series, for eps < 1."""
    n = np.arange(1.0, terms + 1)
    root = jnp.sqrt(1 - eps**2)
    lam = _wave_numbers(modes)
    # Pressure over eps: r = d(-6/h)/d theta = (12/root) sum n (-b)^n sin(n theta).
    p = _tridiagonal(n, (lam / q) ** 2, eps, -12 / root * n * _harmonics(eps, terms))
    # Integral of sin(n theta) cos(theta) over 0 < theta < pi; its fellow with sin(theta) is pi/2
    # for n = 1 and zero for the others.
    radial, tangential = p @ (n * _half_wave(n)), p[:, 0] * jnp.pi / 2
    short = [-2 * eps / root**4, jnp.pi / 2 / root**3]
    return _summed(lam, q, [radial, tangential], short)


@functools.partial(jax.jit, static_argnums=(2, 3))
def _velocity_series(eps: Scalar, q: Scalar, modes: int, terms: int) -> Float[Array, " 2"]:
    """C_rr and C_tr by the series, for eps < 1."""
    n = np.arange(terms + 1.0)
    root = jnp.sqrt(1 - eps**2)
    lam = _wave_numbers(modes)
    # r = -12 d(1/h)/d eps, with db/d eps = b/(eps root).
    waves = 24 * _harmonics(eps, terms) * (n[1:] / root**2 + eps**2 / root**3)
    right = jnp.concatenate([-12 * eps[None] / root**3, waves])
    p = _tridiagonal(n, (lam / q) ** 2, eps, right)
    # Only cos(theta) itself has an integral with cos(theta) over 0 < theta < pi, pi/2.
    radial, cross = -p[:, 1] * jnp.pi / 2, p @ _half_wave(n)
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
        lesser, greater = _shifted(system, step), _shifted(system, -step)
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
    return system[3] / system[1]


def _shifted(rows: Float[Array, "*rows n"], step: int | Int[Array, ""]) -> Float[Array, "*rows n"]:
    """Entry n - step in place of entry n, zero where there is none; `step` may be traced."""
    n = rows.shape[-1]
    wide = jnp.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(n, n)])
    return jax.lax.dynamic_slice_in_dim(wide, n - step, n, axis=-1)
