"""Joints of several cylinders whose friction follows laws of different kinds."""

from typing import ClassVar

import equinox as eqx

from .._each import AbstractEach
from ..film import AbstractJournal
from ._laws import AbstractSlide


class EachSlide(AbstractEach, AbstractSlide):
    """A law of another kind for the slides of some of several cylinders.

    Args:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractSlide, ...]
    of_cylinder: tuple[int, ...] = eqx.field(static=True, default=())

    def force(self, load, speed):
        return self.each(lambda law, load, speed: law.force(load, speed), load, speed)


class EachJournal(AbstractEach, AbstractJournal):
    """A law of another kind for the journals of some of several cylinders, such as a film for one.

    A bearing whose journal moves in its film counts here as the same bearing under a steady load.

    Args:
        laws: the kinds, or names of bearings.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractJournal, ...]
    of_cylinder: tuple[int, ...] = eqx.field(static=True, default=())

    def moment(self, load, rate):
        return self.each(lambda law, load, rate: law.moment(load, rate), load, rate)
