r"""Friction of one joint: from the load it carries and the rate at which it slides.

A law for a straight slide answers with a force, a law for a journal with a moment; both have the
sign of the sliding rate and resist it. Coulomb's law is Tsuji et al. (2012) Eq. (4); the film
between piston and cylinder is Dagilis et al., *Slider-link driven compressor (I)*, Eq. (7).
"""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..film import AbstractJournal, check_oil


class AbstractSlide(Part):
    """Friction of a straight slide."""

    @abstractmethod
    def force(self, load: Float[Array, "*n"], speed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N] for a normal load [N] >= 0 and a sliding speed [m/s]."""


class CoulombSlide(AbstractSlide):
    """mu |N|, against the motion. Nothing at rest: a stop ends the law's validity.

    Args:
        coefficient: [-] mu, coefficient of friction.
    """

    kind: ClassVar[str] = "coulomb"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")

    def force(self, load, speed):
        return self.coefficient * load * jnp.sign(speed)


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

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")
    transition_speed: Float[Array, ""] = quantity("m/s", POSITIVE, doc="v0")

    def force(self, load, speed):
        return self.coefficient * load * jnp.tanh(speed / self.transition_speed)


class CoulombJournal(AbstractJournal):
    """mu F d/2, against the rotation.

    Args:
        coefficient: [-] mu, coefficient of friction.
        diameter: [m] d, of pin or journal.
    """

    kind: ClassVar[str] = "coulomb"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")
    diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of pin or journal")

    def moment(self, load, rate):
        return self.coefficient * load * self.diameter / 2 * jnp.sign(rate)


class RegularisedJournal(AbstractJournal):
    """mu F d/2 tanh(w d/(2 v0)): smooth through rest, for start, stop and creep.

    Args:
        coefficient: [-] mu, coefficient of friction.
        diameter: [m] d, of pin or journal.
        transition_speed: [m/s] v0, at the surface.
    """

    kind: ClassVar[str] = "regularised"
    for_each_cylinder: ClassVar[bool] = True

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")
    diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of pin or journal")
    transition_speed: Float[Array, ""] = quantity("m/s", POSITIVE, doc="v0, at the surface")

    def moment(self, load, rate):
        radius = self.diameter / 2
        surface_speed = rate * radius
        return self.coefficient * load * radius * jnp.tanh(surface_speed / self.transition_speed)


class Packing(Part):
    """Rings about a piston rod: a drag that depends on neither load nor speed.

    Args:
        drag: [N] against the motion.
    """

    kind: ClassVar[str] = "packing"
    for_each_cylinder: ClassVar[bool] = True

    drag: Float[Array, ""] = quantity("N", NONNEGATIVE, doc="against the motion")


class PistonFilm(Part):
    r"""Viscous drag of the oil between piston and cylinder, $\eta\pi D L v/c$.

    Dagilis et al. Eq. (7), Petroff's law unrolled. `length` is the wetted length of the piston; a
    mechanism that knows the engaged length at every angle passes it instead.

    Args:
        radial_clearance: [m] c, radius of the cylinder minus that of the piston.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        length: [m] L, wetted, where the mechanism does not give it.
        oil: name of an oil of the machine, which gives the viscosity.

    Raises:
        BadInput: neither or both of `dynamic_viscosity` and `oil`.
    """

    kind: ClassVar[str] = "viscous"
    for_each_cylinder: ClassVar[bool] = True

    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE)
    dynamic_viscosity: Float[Array, ""] | None = quantity(
        "Pa s", POSITIVE, default=None, doc="of the oil; absent where oil names it"
    )
    length: Float[Array, ""] | None = quantity(
        "m", POSITIVE, default=None, doc="wetted length, where the mechanism does not give it"
    )
    oil: str | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        check_oil(self)

    def force(
        self, bore: Float[Array, ""], length: Float[Array, "*n"], speed: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """[N] for a bore [m], a wetted length [m] and a piston speed [m/s]."""
        return self.dynamic_viscosity * jnp.pi * bore * length * speed / self.radial_clearance
