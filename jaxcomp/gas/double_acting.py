"""Polytropic cycles on both sides of a piston."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ._gas_law import AbstractGas, Stroke
from .polytropic import PolytropicCycle


class DoubleActing(AbstractGas):
    """Compression on both sides of a piston whose rod passes through the crank end.

    The crank end sees the stroke from the other side, on the piston's area less that of its rod; the rod
    passes to where the ambient pressure $p_0$ is, so that the piston carries

    $$F = p_{HE} A - p_{CE} (A - A_{rod}) - p_0 A_{rod} .$$

    Args:
        head_end: cycle between piston and head; its back pressure does not act.
        crank_end: cycle on the rod's side.
        rod_diameter: [m] of the piston rod.
        ambient_pressure: [Pa] on the rod's other end, as in the crosshead guide.
    """

    kind: ClassVar[str] = "double_acting"
    for_each_cylinder: ClassVar[bool] = True

    head_end: PolytropicCycle
    crank_end: PolytropicCycle
    rod_diameter: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="of the piston rod", usual=(5e-3, 0.3)
    )
    ambient_pressure: Float[Array, ""] = quantity(
        "Pa", NONNEGATIVE, default=101325.0, doc="on the rod's other end"
    )

    @property
    def behind_piston(self):
        return self.ambient_pressure

    def pressure(self, stroke):
        """[Pa] In the head end."""
        return self.head_end.pressure(stroke)

    def crank_end_pressure(self, stroke: Stroke) -> Float[Array, "*n"]:
        """[Pa] In the crank end; ratios of volumes decide, which the rod does not change."""
        return self.crank_end.pressure(
            Stroke(stroke.angle, stroke.swept - stroke.displaced, stroke.swept, -stroke.inward)
        )

    def on_piston(self, stroke, area):
        head = self.pressure(stroke)
        crank = self.crank_end_pressure(stroke)
        rod = jnp.pi / 4 * self.rod_diameter**2 / area
        return head, head - (1 - rod) * crank - rod * self.ambient_pressure

    def valve_events(self, swept):
        crank = self.crank_end.valve_events(swept)
        events = [*self.head_end.valve_events(swept)]
        # the crank end counts from its own dead centre, and its strokes run the other way
        for displaced, inward in crank:
            events.append((swept - displaced, not inward))
        return tuple(events)
