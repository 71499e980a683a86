"""A slide on the film of its taper and on its asperities."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, quantity
from ..film import AsperityContact
from ..film._parts import check_oil, oil_viscosity
from ._joint_laws import AbstractSlide
from ._pads import PadForces, Pads, slow


class MixedSlide(AbstractSlide):
    """A slide on a film that its taper builds, and on its asperities: a piston or crosshead.

    Its face is one flat pad; a piston in its bore bears on about its diameter. Squeeze is left out, so
    that the film is that of a steady load at every instant; oil is everywhere.

    Args:
        contact: of the rough surfaces.
        length: [m] B along the motion.
        width: [m] L across it.
        taper: [m] delta, by which the leading edge stands off further than the trailing one: the
            crowning of a skirt, in both directions of motion.
        radial_clearance: [m] the most that the slide floats off.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        oil: name of an oil of the machine, which gives the viscosity.

    Raises:
        BadInput: neither or both of `dynamic_viscosity` and `oil`.
    """

    kind: ClassVar[str] = "mixed"
    proportional: ClassVar[bool] = False

    contact: AsperityContact
    length: Float[Array, ""] = quantity("m", POSITIVE, doc="along the motion", usual=(1e-3, 0.5))
    width: Float[Array, ""] = quantity("m", POSITIVE, doc="across the motion", usual=(1e-3, 0.5))
    taper: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="by which the leading edge stands off further", usual=(1e-7, 1e-4)
    )
    radial_clearance: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="the most that the slide floats off", usual=(1e-6, 1e-3)
    )
    dynamic_viscosity: Float[Array, ""] | None = oil_viscosity()
    oil: str | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        check_oil(self)

    def parts(self, load, speed) -> PadForces:
        """Drag of film and contact, and the thickness, at a load [N] and a sliding speed [m/s]."""
        return Pads(
            1.0, self.length, self.width, self.taper, self.radial_clearance,
            self.dynamic_viscosity, self.contact, slow(speed),
        ).forces(load)  # fmt: skip

    def force(self, load, speed):
        parts = self.parts(load, speed)
        # the sign of the speed, smooth: at rest the asperities still carry, and their friction would
        # jump
        return (parts.film + parts.contact) * speed / slow(speed)
