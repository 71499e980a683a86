"""Petroff's concentric journal."""

from typing import ClassVar

import jax.numpy as jnp

from ._film import AbstractFilm


class Petroff(AbstractFilm):
    """Concentric journal: the friction of no load, whatever the load.

    Phi_T = pi (Petroff 1883).

    Args:
        length_ratio: [-] q = L/D, which makes no difference.
    """

    limits: ClassVar[str] = (
        "Concentric, right at no load: at L/D = 1 the friction is 4 % too low at Phi_p = 0.3 and "
        "45 % at Phi_p = 3, at L/D = 1/4 15 % at Phi_p = 0.1. No position, no coefficients."
    )

    def friction_number(self, load_number):
        # with the shape of the load, and a derivative of zero along it
        return jnp.pi + 0 * load_number
