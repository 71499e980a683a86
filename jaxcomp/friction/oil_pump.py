"""The drag of an oil pump."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ._joint_laws import AbstractDrag, direction


class OilPump(AbstractDrag):
    """A constant torque (M_p of Dagilis et al., Eq. 29), against the rotation.

    Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*.

    Args:
        torque: [N m] M_p.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "pump"

    torque: Float[Array, ""] = quantity("N m", NONNEGATIVE)
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def moment(self, rate, weight):
        del weight
        return self.torque * direction(rate, self.transition_rate)
