r"""Drag on the shaft that no joint force governs: the thrust bearing and the oil pump.

All moments have the sign of the rate and resist it.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eq. (24), with the sign of the rate added.
"""

from abc import abstractmethod
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, POSITIVE, Part, quantity

# Standard acceleration of free fall [m/s^2], exact by definition (CGPM 1901).
STANDARD_GRAVITY = 9.80665


class AbstractDrag(Part):
    """A moment on the shaft that no joint force governs."""

    @abstractmethod
    def moment(self, rate: Float[Array, "*n"], weight: Float[Array, ""]) -> Float[Array, "*n"]:
        """[N m] at a rate of rotation [rad/s], for a weight [N] of shaft and rotor."""


class ThrustBearing(AbstractDrag):
    r"""Flat ring under the weight of the shaft, uniform pressure (Dagilis et al., Eq. 24).

    $$M = \tfrac23\mu\, m_r g\, \frac{R_t^3 - r_t^3}{R_t^2 - r_t^2}$$

    Args:
        coefficient: [-] mu, coefficient of friction.
        outer_radius: [m] R_t.
        inner_radius: [m] r_t.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "thrust"

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")
    outer_radius: Float[Array, ""] = quantity("m", POSITIVE, doc="R_t")
    inner_radius: Float[Array, ""] = quantity("m", NONNEGATIVE, default=0.0, doc="r_t")
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def conditions(self):
        return {"a ring with inner_radius < outer_radius": self.inner_radius < self.outer_radius}

    @property
    def friction_radius(self) -> Float[Array, ""]:
        """[m] 2/3 (R^3 - r^3)/(R^2 - r^2), with the common factor R - r cancelled."""
        outer, inner = self.outer_radius, self.inner_radius
        return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)

    def moment(self, rate, weight):
        level = self.coefficient * weight * self.friction_radius
        return level * _direction(rate, self.transition_rate)


class OilPump(AbstractDrag):
    """A constant torque (M_p of Dagilis et al., Eq. 29), against the rotation.

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
        return self.torque * _direction(rate, self.transition_rate)


def _direction(rate, transition_rate):
    return jnp.sign(rate) if transition_rate is None else jnp.tanh(rate / transition_rate)
