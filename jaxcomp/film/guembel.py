"""The half-Sommerfeld film of finite length."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._film import AbstractSolvedFilm, Scalar, as_float
from ._half_sommerfeld import steady_series, velocity_series
from ._tabulated import continuation

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
        self.modes = modes
        self.terms = terms
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
        value = at_edge[0][index]
        slope = at_edge[1][index]
        outer = continuation(s, EDGE, value, slope, limit, limit_slope)
        # Double where: beyond its edge the series has too few terms, and its slopes may be anything.
        return jnp.where(beyond, outer, inside(jnp.where(beyond, EDGE, s))[index])

    def _steady(self, s: Scalar) -> Float[Array, " 2"]:
        """ln(load gain/q^2) and the attitude angle."""
        forces = steady_series(1 - s**2, self.length_ratio, self.modes, self.terms)
        # Phi_p/x = (|F|/eps) (1 - eps), and the series gives F/eps, which is finite at eps = 0.
        gain = jnp.sqrt(forces @ forces) * s**2
        return jnp.stack([jnp.log(gain / self.length_ratio**2), jnp.arctan2(forces[1], -forces[0])])

    def _damping(self, s: Scalar) -> Float[Array, " 2"]:
        """ln(C_rr s^3/q^2) and -C_tr s^2/q^2."""
        c_rr, c_tr = velocity_series(1 - s**2, self.length_ratio, self.modes, self.terms)
        q2 = self.length_ratio**2
        return jnp.stack([jnp.log(c_rr * s**3 / q2), -c_tr * s**2 / q2])
