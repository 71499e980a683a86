"""An induction motor near its synchronous speed."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import POSITIVE, quantity
from ._motor import AbstractMotor


class SlipLine(AbstractMotor):
    """An induction motor near its synchronous speed, M = slope (synchronous - speed).

    Args:
        losses: efficiency over torque, for the electric power.
        slope: [N m s] torque per rad/s of slip.
        synchronous_speed: [rad/s] at which the torque is zero.
    """

    kind: ClassVar[str] = "slip_line"

    slope: Float[Array, ""] = quantity("N m s", POSITIVE, doc="torque per rad/s of slip")
    synchronous_speed: Float[Array, ""] = quantity("rad/s", POSITIVE, usual=(6.0, 3200.0))

    def torque(self, speed):
        return self.slope * (self.synchronous_speed - speed)

    def torque_near(self, speed, change):
        return self.torque(speed) - self.slope * change

    @property
    def speed_guess(self):
        return self.synchronous_speed
