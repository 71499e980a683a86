"""The pressures of solved cycles on both sides of the pistons."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, quantity
from ..gas import AbstractGas, Stroke
from ._event_panels import SolvedPressure


class SolvedEnds(AbstractGas):
    """The solved pressures of double-acting cylinders, by the crank angle of every cylinder.

    The crank end counts its own angle from half a revolution later.

    Args:
        head_end: pressures of c head ends.
        crank_end: those of the crank ends.
        rod_diameter: [m] (c,) of the piston rods.
        ambient_pressure: [Pa] (c,) on the other end of the rods.
    """

    in_files: ClassVar[bool] = False  # the solver makes it

    head_end: SolvedPressure
    crank_end: SolvedPressure
    rod_diameter: Float[Array, " c"] = quantity("m", NONNEGATIVE, shape=(...,))
    ambient_pressure: Float[Array, " c"] = quantity("Pa", NONNEGATIVE, shape=(...,))

    @property
    def behind_piston(self):
        return self.ambient_pressure[0]

    def pressure(self, stroke):
        """[Pa] In the head ends."""
        return self.head_end.pressure(stroke)

    def crank_end_pressure(self, stroke: Stroke) -> Float[Array, "c *n"]:
        """[Pa] In the crank ends."""
        return self.crank_end.pressure(stroke._replace(angle=stroke.angle + jnp.pi))

    def on_piston(self, stroke, area):
        head = self.pressure(stroke)
        crank = self.crank_end_pressure(stroke)

        def along(values):
            return values.reshape(-1, *(1,) * (head.ndim - 1))

        # as a pressure on the whole area of the head end: the gas behind acts on the ring around
        # the rod, and on the rod's other end its surroundings
        rod = jnp.pi / 4 * along(self.rod_diameter) ** 2 / area
        return head, head - (1 - rod) * crank - rod * along(self.ambient_pressure)

    def event_angles(self):
        # all by the angle of the cylinder, from which the crank end counts half a revolution later
        return jnp.concatenate([self.head_end.kinks, self.crank_end.kinks - jnp.pi], axis=1)


def ends_under(gas: SolvedPressure, pistons: Any) -> SolvedEnds:
    """The pressures of head and crank ends, which follow each other, on both sides of the pistons.

    Args:
        gas: the pressures of all ends.
        pistons: the `PistonEnd` of every end.
    """
    head, crank = (jax.tree.map(lambda x, n=n: x[n::2], gas) for n in (0, 1))
    return SolvedEnds(head, crank, pistons.rod_diameter[1::2], pistons.ambient_pressure[1::2])
