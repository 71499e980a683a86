"""Closed formulas fitted to solutions of the Reynolds equation."""

from typing import ClassVar

import jax.numpy as jnp

from ._film import AbstractCarryingFilm


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
