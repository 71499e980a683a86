"""Cylinders of one machine whose gas follows laws of different kinds."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._each import AbstractEach
from ._base import AbstractGas, Stroke


class EachGas(AbstractEach, AbstractGas):
    """A gas of another kind for some of several cylinders, such as one with a measured curve.

    Args:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, a law of the whole machine (stages, valves),
            or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractGas, ...]
    of_cylinder: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def behind_piston(self):
        return self.each(lambda law: law.behind_piston)

    def pressure(self, stroke):
        return self.each(lambda law, stroke: law.pressure(stroke), _alike(stroke))

    def on_piston(self, stroke, area):
        area = jnp.broadcast_to(area, stroke.angle.shape)
        return self.each(
            lambda law, stroke, area: law.on_piston(stroke, area), _alike(stroke), area
        )

    def valve_events(self, swept):
        """Events of each cylinder; where one has fewer than another, at its top dead centre."""
        count = len(self.of_cylinder)
        swept = jnp.broadcast_to(swept, (count,))
        found: dict[bool, list] = {True: [], False: []}
        for number in range(count):
            events = self.one(number + 1).valve_events(swept[number])
            for inward, rows in found.items():
                rows.append([displaced for displaced, way in events if way == inward])
        return tuple(
            (jnp.stack([row[place] if place < len(row) else jnp.zeros(()) for row in rows]), inward)
            for inward, rows in found.items()
            for place in range(max(map(len, rows)))
        )

    def event_angles(self):
        rows = [self.one(number + 1).event_angles() for number in range(len(self.of_cylinder))]
        return tuple(
            jnp.stack([row[place] if place < len(row) else jnp.zeros(()) for row in rows])
            for place in range(max(map(len, rows)))
        )


def _alike(stroke: Stroke) -> Stroke:
    return Stroke(*(jnp.broadcast_to(value, stroke.angle.shape) for value in stroke))
