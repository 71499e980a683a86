"""Annand's correlation of the heat transfer."""

from typing import ClassVar

from jaxtyping import Array, Float

from ..._core.fields import POSITIVE, quantity
from ._heat_transfer import AbstractHeat


class Annand(AbstractHeat):
    """Nu = a Re^b with bore and mean piston speed (Annand 1963).

    Args:
        viscosity: [Pa s] the fluid's own if absent.
        conductivity: [W/(m K)] the fluid's own if absent.
        factor: [-] a.
        exponent: [-] b.
    """

    kind: ClassVar[str] = "annand"

    factor: Float[Array, ""] = quantity("", POSITIVE, default=0.7)
    exponent: Float[Array, ""] = quantity("", POSITIVE, default=0.7)

    def coefficient(self, at):
        # the mean speed has no kink at the dead centres, where that of the instant is zero
        number = self.factor * at.reynolds(at.piston_speed) ** self.exponent
        return number * at.conductivity / at.bore
