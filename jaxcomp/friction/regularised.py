"""Coulomb's law made smooth through rest, of slides and journals."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ..film import AbstractJournal
from ._joint_laws import AbstractSlide


class RegularisedSlide(AbstractSlide):
    """mu |N| tanh(v/v0): smooth through zero speed, for start, stop and creep.

    Below the transition speed it is viscous, so a loaded slide creeps instead of sticking; the creep
    is of the order of v0 times the fraction of the friction that the load uses.

    Args:
        coefficient: [-] mu, coefficient of friction.
        transition_speed: [m/s] v0.
    """

    kind: ClassVar[str] = "regularised"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    transition_speed: Float[Array, ""] = quantity("m/s", POSITIVE, doc="v0", usual=(1e-6, 1.0))

    def force(self, load, speed):
        return self.coefficient * load * jnp.tanh(speed / self.transition_speed)


class RegularisedJournal(AbstractJournal):
    """mu F d/2 tanh(w d/(2 v0)): smooth through rest, for start, stop and creep.

    Args:
        coefficient: [-] mu, coefficient of friction.
        diameter: [m] d, of pin or journal.
        transition_speed: [m/s] v0, at the surface.
    """

    kind: ClassVar[str] = "regularised"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of pin or journal", usual=(2e-3, 1.0))
    transition_speed: Float[Array, ""] = quantity(
        "m/s", POSITIVE, doc="v0, at the surface", usual=(1e-6, 1.0)
    )

    def moment(self, load, rate):
        radius = self.diameter / 2
        surface_speed = rate * radius
        return self.coefficient * load * radius * jnp.tanh(surface_speed / self.transition_speed)
