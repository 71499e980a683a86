"""Petroff's friction with a part that grows with the load."""

from typing import ClassVar

import jax.numpy as jnp

from ._film import AbstractFilm


class LoadedPetroff(AbstractFilm):
    """Petroff's friction and a part that grows with the load.

    Falz, with the length factor of Dagilis et al., Eq. (20) corrected: Phi_T = pi + 0.55 xi Phi_p,
    xi = (D/L)^1.5 for L < D and 1 for longer bearings (the source prints L/D, which would let short
    bearings rub less).

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
