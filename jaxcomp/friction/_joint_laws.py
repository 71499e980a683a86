"""What friction laws share: straight slides, journals, and the drag on the shaft.

From load and sliding rate a slide answers with a force, a journal with a moment; both have the sign of
the rate and resist it, as does a drag, which no joint force governs.
"""

from abc import abstractmethod
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import AbstractEach
from .._core.fields import Part
from ..film import AbstractJournal

# Standard acceleration of free fall [m/s^2], exact by definition (CGPM 1901).
STANDARD_GRAVITY = 9.80665


class AbstractSlide(Part):
    """Friction of a straight slide."""

    # whether the force is that of a unit load times the load
    proportional: ClassVar[bool] = True

    @abstractmethod
    def force(self, load: Float[Array, "*n"], speed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N] for a normal load [N] >= 0 and a sliding speed [m/s]."""


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


def direction(rate, transition_rate):
    # a running shaft never changes the sign; through rest the jump would make it chatter about zero
    # instead of coming to a halt
    if transition_rate is None:
        return jnp.sign(rate)
    return jnp.tanh(rate / transition_rate)
