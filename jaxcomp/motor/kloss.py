"""The induction motor of Kloss, from standstill to overrun."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.extremes import minimum
from .._core.fields import POSITIVE, quantity
from ._motor import AbstractMotor


class Kloss(AbstractMotor):
    r"""Induction motor over the whole range of speed, from standstill to overrun.

    Kloss' formula $M = 2 M_m s s_b/(s^2 + s_b^2)$ with the slip $s = 1 - \omega/\omega_s$.

    Args:
        losses: efficiency over torque, for the electric power.
        pull_out_torque: [N m] M_m, the largest.
        pull_out_slip: [-] s_b, where it is reached.
        synchronous_speed: [rad/s] omega_s.
    """

    kind: ClassVar[str] = "kloss"

    pull_out_torque: Float[Array, ""] = quantity("N m", POSITIVE, usual=(1e-3, 1e6))
    pull_out_slip: Float[Array, ""] = quantity("", POSITIVE, usual=(0.005, 1.0))
    synchronous_speed: Float[Array, ""] = quantity("rad/s", POSITIVE, usual=(6.0, 3200.0))

    def torque(self, speed):
        return self.torque_near(speed, 0.0)

    def torque_near(self, speed, change):
        # Subtracted in turn: speed + change would lose digits that a slip of 1e-6 needs.
        slip = (self.synchronous_speed - speed - change) / self.synchronous_speed
        return (
            2 * self.pull_out_torque * slip * self.pull_out_slip / (slip**2 + self.pull_out_slip**2)
        )

    @property
    def speed_guess(self):
        # On the stable side of the pull-out, where the torque is 55 % of its largest.
        return self.synchronous_speed * (1 - 0.3 * minimum(self.pull_out_slip, 1.0))
