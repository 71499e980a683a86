"""A flat ring under the weight of the shaft."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ._joint_laws import AbstractDrag, direction


class ThrustBearing(AbstractDrag):
    r"""Flat ring under the weight of the shaft, uniform pressure (Dagilis et al., Eq. 24).

    $$M = \tfrac23\mu\, m_r g\, \frac{R_t^3 - r_t^3}{R_t^2 - r_t^2}$$

    Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*, with the sign
    of the rate added.

    Args:
        coefficient: [-] mu, coefficient of friction.
        outer_radius: [m] R_t.
        inner_radius: [m] r_t.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "thrust"

    coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, doc="coefficient of friction", usual=(5e-4, 0.5)
    )
    outer_radius: Float[Array, ""] = quantity("m", POSITIVE, doc="R_t", usual=(2e-3, 0.5))
    inner_radius: Float[Array, ""] = quantity("m", NONNEGATIVE, default=0.0, doc="r_t")
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def conditions(self):
        return {"a ring with inner_radius < outer_radius": self.inner_radius < self.outer_radius}

    @property
    def friction_radius(self) -> Float[Array, ""]:
        """[m] 2/3 (R^3 - r^3)/(R^2 - r^2), with the common factor R - r cancelled."""
        # of a narrow ring both differences are rounding, and their ratio would lose its digits
        outer = self.outer_radius
        inner = self.inner_radius
        return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)

    def moment(self, rate, weight):
        level = self.coefficient * weight * self.friction_radius
        return level * direction(rate, self.transition_rate)
