"""A motor that holds the speed at every instant."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import POSITIVE, quantity
from ._motor import AbstractMotor


class ConstantSpeed(AbstractMotor):
    """A motor that holds the speed at every instant, by whatever torque that takes.

    The crank does not fluctuate, as with an endless flywheel, and there is no equation of motion to
    solve: the leanest machine for joint forces and losses at a given speed.

    Args:
        losses: efficiency over torque, for the electric power.
        mean_speed: [rad/s] at every crank angle.
    """

    kind: ClassVar[str] = "constant_speed"
    closes = "speed"

    mean_speed: Float[Array, ""] = quantity(
        "rad/s", POSITIVE, doc="at every crank angle", usual=(6.0, 3200.0)
    )

    def torque(self, speed):
        raise BadInput(
            "motor", self.kind, "a torque law over speed: this one has no torque of its own"
        )

    @property
    def speed_guess(self):
        return self.mean_speed
