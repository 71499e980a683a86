"""Oil between plate and seat."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import maximum
from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity


class OilFilm(Part):
    r"""Oil between plate and seat, which holds the plate when it lifts and cushions it when it seats.

    Squeeze film of a ring of width b and radius r at the lift x:
    $F = 2\pi r\mu b^3\,\dot x/(x + x_{oil})^3$ (Khalifa and Liu 1998). It fades with the cube of the
    lift, and is taken to hold all the while: nothing of it cavitates.

    Args:
        viscosity: [Pa s] dynamic, of the oil with the gas that is dissolved in it.
        seat_width: [m] of the ring.
        thickness: [m] of the film with the plate on its seat.
        seat_diameter: [m] of the ring; that of the port if absent.
    """

    kind: ClassVar[str] = "oil_film"

    viscosity: Float[Array, ""] = quantity(
        "Pa s", NONNEGATIVE, doc="dynamic, of the oil", usual=(1e-4, 2.0)
    )
    seat_width: Float[Array, ""] = quantity("m", POSITIVE, usual=(1e-5, 0.02))
    thickness: Float[Array, ""] = quantity("m", POSITIVE, doc="with the plate on its seat")
    seat_diameter: Float[Array, ""] | None = quantity(
        "m", POSITIVE, default=None, doc="that of the port if absent"
    )

    def resistance(self, lift: Float[Array, ""], port_diameter) -> Float[Array, ""]:
        """Force over the plate's velocity [N s/m] at a lift [m]."""
        diameter = port_diameter if self.seat_diameter is None else self.seat_diameter
        gap = maximum(lift, 0.0) + self.thickness
        return jnp.pi * diameter * self.viscosity * (self.seat_width / gap) ** 3
