"""A ring of tapered pads under the weight of the shaft."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ..film import AsperityContact
from ..film._parts import check_oil, oil_viscosity
from ._joint_laws import AbstractDrag
from ._pads import PadForces, Pads, slow


class MixedThrust(AbstractDrag):
    """A flat ring of tapered pads under the weight of the shaft, on its film and its asperities.

    Args:
        contact: of the rough surfaces.
        outer_radius: [m] of the ring.
        inner_radius: [m] of the ring.
        taper: [m] delta, of every pad.
        axial_clearance: [m] the most that the shaft floats off.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        oil: name of an oil of the machine, which gives the viscosity.
        pads: number of pads round the ring.

    Raises:
        BadInput: neither or both of `dynamic_viscosity` and `oil`, no pad, or no ring.
    """

    kind: ClassVar[str] = "mixed_thrust"

    contact: AsperityContact
    outer_radius: Float[Array, ""] = quantity("m", POSITIVE, usual=(2e-3, 0.5))
    inner_radius: Float[Array, ""] = quantity("m", NONNEGATIVE)
    taper: Float[Array, ""] = quantity("m", POSITIVE, doc="of every pad", usual=(1e-7, 1e-4))
    axial_clearance: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="the most that the shaft floats off", usual=(1e-6, 2e-3)
    )
    dynamic_viscosity: Float[Array, ""] | None = oil_viscosity()
    oil: str | None = eqx.field(static=True, default=None)
    pads: int = eqx.field(static=True, default=6)

    def __check_init__(self):
        check_oil(self)
        if self.pads < 1:
            raise BadInput("pads", self.pads, ">= 1")

    def conditions(self):
        return {"a ring with inner_radius < outer_radius": self.inner_radius < self.outer_radius}

    @property
    def mean_radius(self) -> Float[Array, ""]:
        """[m] Where the pads slide."""
        return 0.5 * (self.outer_radius + self.inner_radius)

    def parts(self, weight, rate) -> PadForces:
        """Drag of film and contact, and the thickness, under a weight [N] at a rate [rad/s]."""
        radius = self.mean_radius
        width = self.outer_radius - self.inner_radius
        # The ring rolled out at its mean radius; its pads adjoin without grooves. Zero times the rate
        # gives the one weight the shape of the rates.
        return Pads(
            float(self.pads), 2 * jnp.pi * radius / self.pads, width, self.taper,
            self.axial_clearance, self.dynamic_viscosity, self.contact, slow(rate * radius),
        ).forces(weight + 0 * rate)  # fmt: skip

    def moment(self, rate, weight):
        parts = self.parts(weight, rate)
        speed = rate * self.mean_radius
        return self.mean_radius * (parts.film + parts.contact) * speed / slow(speed)
