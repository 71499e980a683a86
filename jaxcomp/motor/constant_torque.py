"""The same torque at every speed."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import ANY, POSITIVE, quantity
from ._motor import AbstractMotor


class ConstantTorque(AbstractMotor):
    """A motor of the same torque at every speed. The running speed is found where losses balance it.

    Args:
        losses: efficiency over torque, for the electric power.
        level: [N m] positive if it drives.
        expected_speed: [rad/s] where to start looking for the running speed.
    """

    kind: ClassVar[str] = "constant_torque"

    level: Float[Array, ""] = quantity("N m", ANY)
    expected_speed: Float[Array, ""] = quantity(
        "rad/s", POSITIVE, default=100.0, doc="where to start looking for the running speed"
    )

    def torque(self, speed):
        return jnp.full_like(speed, self.level)

    @property
    def speed_guess(self):
        return self.expected_speed
