"""What every motor offers: its torque over the speed, and its efficiency over the torque."""

from abc import abstractmethod
from dataclasses import KW_ONLY
from typing import ClassVar, Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, Bound, Part, quantity


class MotorEfficiency(Part):
    """Shaft power over electric power, by straight lines over the mean torque, constant beyond.

    Args:
        efficiency: [-] (n,) at these torques; a single one holds at every torque.
        torque: [N m] (n,) rising; may be left out for a single efficiency.
        fixed_power: [W] electric power that does not follow the load: of a converter, controls, a fan,
            or iron losses, beside what the efficiency says.

    Raises:
        ValueError: lists of different lengths.
    """

    kind: ClassVar[str] = "motor_efficiency"

    efficiency: Float[Array, " n"] = quantity(
        "", Bound(0.0, 1.0, low_open=True), shape=(None,), doc="shaft power over electric power"
    )
    torque: Float[Array, " n"] | None = quantity(
        "N m", NONNEGATIVE, shape=(None,), default=None, doc="mean torque at which it holds, rising"
    )
    fixed_power: Float[Array, ""] = quantity(
        "W", NONNEGATIVE, default=0.0, doc="electric power that does not follow the load"
    )

    def conditions(self):
        if self.torque is None:
            return {}
        return {"torques that rise": (self.torque[1:] > self.torque[:-1]).all()}

    def __check_init__(self):
        count = 1 if self.torque is None else self.torque.size
        if self.efficiency.size != count:
            raise ValueError("`efficiency` and `torque` must have the same number of entries.")

    def at(self, torque: Float[Array, ""]) -> Float[Array, ""]:
        """Efficiency at a mean torque [N m]."""
        if self.torque is None:
            return self.efficiency[0]
        return jnp.interp(torque, self.torque, self.efficiency)


class AbstractMotor(Part):
    """A torque law. `speed_guess` is where a solver may start looking for the running speed.

    Args:
        losses: its efficiency over torque; without it nothing is said of its electric power.

    `closes` says what closes a revolution of the periodic state: the torque that the law gives at
    every speed, a level of torque that holds the mean speed, or a speed that is given throughout.
    """

    closes: ClassVar[Literal["torque", "mean_speed", "speed"]] = "torque"

    _: KW_ONLY
    losses: MotorEfficiency | None = None

    @abstractmethod
    def torque(self, speed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] on the crank at a speed [rad/s]."""

    def torque_near(
        self, speed: Float[Array, ""], change: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """[N m] at a speed [rad/s] and a change of it [rad/s].

        A stiff law is told more exactly of a small change than by the sum.
        """
        return self.torque(speed + change)

    @property
    @abstractmethod
    def speed_guess(self) -> Float[Array, ""]:
        """[rad/s]"""
