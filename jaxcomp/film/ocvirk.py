"""The short bearing of Ocvirk."""

from typing import ClassVar

import jax.numpy as jnp

from .._core.extremes import maximum
from ._film import AbstractSolvedFilm


class Ocvirk(AbstractSolvedFilm):
    r"""Film without the circumferential pressure gradient, negative pressures dropped.

    With s = 1 - eps^2 the film forces over eta omega L D/psi^2 are

        F_r = -2 q^2 eps^2/s^2     F_t = (pi/2) q^2 eps/s^(3/2)
        C_rr = pi q^2 (1 + 2 eps^2)/s^(5/2)

    (Ocvirk 1952; Dubois and Ocvirk, NACA Report 1157, 1953).

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
        eps = x / (1 + x)
        s = (1 + 2 * x) / (1 + x) ** 2
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
        lobe = maximum(jnp.sin(theta), 0.0) / (1 + eps * jnp.cos(theta)) ** 3
        return 3 * self.length_ratio**2 * eps * lobe * (1 - zeta**2)
