r"""The laws of single joints: straight slides, journals, and the drag on the shaft.

From load and sliding rate a slide answers with a force, a journal with a moment; both have the sign of
the rate and resist it, as does a drag, which no joint force governs.

Sources: Tsuji et al. (2012) Eq. (4), Coulomb's law; Dagilis, Vaitkus, Kirejchick, *Slider-link driven
compressor (I). Mathematical model*, Eq. (7), the film between piston and cylinder, and Eq. (24), the
thrust bearing, with the sign of the rate added.
"""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import AbstractEach
from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..film import AbstractJournal
from ..film.interface import check_oil, oil_viscosity

# Standard acceleration of free fall [m/s^2], exact by definition (CGPM 1901).
STANDARD_GRAVITY = 9.80665


class AbstractSlide(Part):
    """Friction of a straight slide."""

    # whether the force is that of a unit load times the load
    proportional: ClassVar[bool] = True

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

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )

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

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    transition_speed: Float[Array, ""] = quantity("m/s", POSITIVE, doc="v0", usual=(1e-6, 1.0))

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

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of pin or journal", usual=(2e-3, 1.0))

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

    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE, usual=(1e-6, 1e-3))
    dynamic_viscosity: Float[Array, ""] | None = oil_viscosity()
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


class EachSlide(AbstractEach, AbstractSlide):
    """A law of another kind for the slides of single cylinders.

    Args:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractSlide, ...]

    def force(self, load, speed):
        return self.each(lambda law, load, speed: law.force(load, speed), load, speed)


class EachJournal(AbstractEach, AbstractJournal):
    """A law of another kind for the journals of single cylinders, such as a film for one.

    A bearing whose journal moves in its film counts here as the same bearing under a steady load.

    Args:
        laws: the kinds, or names of bearings.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractJournal, ...]

    def moment(self, load, rate):
        return self.each(lambda law, load, rate: law.moment(load, rate), load, rate)


class AbstractDrag(Part):
    """A moment on the shaft that no joint force governs."""

    @abstractmethod
    def moment(self, rate: Float[Array, "*n"], weight: Float[Array, ""]) -> Float[Array, "*n"]:
        """[N m] at a rate of rotation [rad/s], for a weight [N] of shaft and rotor."""


class ThrustBearing(AbstractDrag):
    r"""Flat ring under the weight of the shaft, uniform pressure (Dagilis et al., Eq. 24).

    $$M = \tfrac23\mu\, m_r g\, \frac{R_t^3 - r_t^3}{R_t^2 - r_t^2}$$

    Args:
        coefficient: [-] mu, coefficient of friction.
        outer_radius: [m] R_t.
        inner_radius: [m] r_t.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "thrust"

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    outer_radius: Float[Array, ""] = quantity("m", POSITIVE, doc="R_t", usual=(2e-3, 0.5))
    inner_radius: Float[Array, ""] = quantity("m", NONNEGATIVE, default=0.0, doc="r_t")
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def conditions(self):
        return {"a ring with inner_radius < outer_radius": self.inner_radius < self.outer_radius}

    @property
    def friction_radius(self) -> Float[Array, ""]:
        """[m] 2/3 (R^3 - r^3)/(R^2 - r^2), with the common factor R - r cancelled."""
        outer, inner = self.outer_radius, self.inner_radius
        return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)

    def moment(self, rate, weight):
        level = self.coefficient * weight * self.friction_radius
        return level * _direction(rate, self.transition_rate)


class OilPump(AbstractDrag):
    """A constant torque (M_p of Dagilis et al., Eq. 29), against the rotation.

    Args:
        torque: [N m] M_p.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "pump"

    torque: Float[Array, ""] = quantity("N m", NONNEGATIVE)
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def moment(self, rate, weight):
        del weight
        return self.torque * _direction(rate, self.transition_rate)


def _direction(rate, transition_rate):
    return jnp.sign(rate) if transition_rate is None else jnp.tanh(rate / transition_rate)
