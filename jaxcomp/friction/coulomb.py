"""Coulomb's law, of slides and journals."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ..film import AbstractJournal
from ._joint_laws import AbstractSlide


class CoulombSlide(AbstractSlide):
    """mu |N|, against the motion. Nothing at rest: a stop ends the law's validity.

    Tsuji et al. (2012) Eq. (4).

    Args:
        coefficient: [-] mu, coefficient of friction.
    """

    kind: ClassVar[str] = "coulomb"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )

    def force(self, load, speed):
        # the jump stands where the motion reverses, at edges of the panels of the crank's solvers
        return self.coefficient * load * jnp.sign(speed)


class CoulombJournal(AbstractJournal):
    """mu F d/2, against the rotation.

    Args:
        coefficient: [-] mu, coefficient of friction.
        diameter: [m] d, of pin or journal.
    """

    kind: ClassVar[str] = "coulomb"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of pin or journal", usual=(2e-3, 1.0))

    def moment(self, load, rate):
        return self.coefficient * load * self.diameter / 2 * jnp.sign(rate)
