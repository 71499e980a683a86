"""A pressure that is given over the displaced volume."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.fields import NONNEGATIVE, Bound, quantity
from ._diagram import AbstractDiagram, check_same_length, curve, with_knots


class VolumeTable(AbstractDiagram):
    """Pressure over displaced volume, one curve for either direction of the stroke.

    `volume` counts the displaced volume as a fraction of the swept volume, from 0 at the top to 1 at
    the bottom dead centre.

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        volume: [-] (n,) displaced over swept volume, rising from 0 to 1.
        inward_pressure: [Pa] (n,) absolute, while the piston moves towards the head.
        outward_pressure: [Pa] (n,) the same while it moves away.
    """

    kind: ClassVar[str] = "volume_table"

    volume: Float[Array, " n"] = quantity(
        "", Bound(0.0, 1.0), shape=(None,), doc="displaced over swept volume, rising from 0 to 1"
    )
    inward_pressure: Float[Array, " n"] = quantity(
        "Pa", NONNEGATIVE, shape=(None,), doc="while the piston moves towards the head"
    )
    outward_pressure: Float[Array, " n"] = quantity("Pa", NONNEGATIVE, shape=(None,))
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        rising = (self.volume[1:] > self.volume[:-1]).all()
        spans_stroke = (self.volume[0] == 0) & (self.volume[-1] == 1)
        return {
            "a table with volumes that rise from 0 to 1": rising & spans_stroke,
            "a table of at least three points": jnp.asarray(self.volume.size > 2),
        }

    def repaired(self):
        return with_knots(self, "volume", jnp.linspace(0, 1, self.volume.size))

    def __check_init__(self):
        check_same_length(self, "volume", "inward_pressure")
        check_same_length(self, "volume", "outward_pressure")

    def event_shares(self):
        """Every point between the dead centres: the curves bend there."""
        return self.volume[1:-1]

    def pressure(self, stroke):
        fraction = stroke.displaced / stroke.swept
        return jnp.where(
            stroke.inward > 0,
            curve(fraction, self.volume, self.inward_pressure),
            curve(fraction, self.volume, self.outward_pressure),
        )
