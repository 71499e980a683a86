"""A motor that holds a mean speed, by a level of torque that is an unknown of the orbit."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, quantity
from ._motor import AbstractMotor


class MeanSpeed(AbstractMotor):
    """A motor that holds a given mean speed; the level of its torque is an unknown of the orbit.

    `shape` is that of the torque over speed at unit level: constant, or proportional to speed
    ("in proportion to the rotational speed", Tsuji et al. 2012, who give no constant).

    Args:
        losses: efficiency over torque, for the electric power.
        mean_speed: [rad/s] one revolution over its duration.

    Raises:
        ValueError: another shape.
    """

    kind: ClassVar[str] = "mean_speed"
    closes = "mean_speed"

    mean_speed: Float[Array, ""] = quantity(
        "rad/s", POSITIVE, doc="one revolution over its duration", usual=(6.0, 3200.0)
    )
    shape: Literal["constant", "proportional"] = eqx.field(static=True, default="constant")

    def __check_init__(self):
        if self.shape not in ("constant", "proportional"):
            raise ValueError(
                f"`shape` must be 'constant' or 'proportional', but is {self.shape!r}."
            )

    def torque(self, speed):
        if self.shape == "proportional":
            return speed / self.mean_speed
        return jnp.ones_like(speed)

    @property
    def speed_guess(self):
        return self.mean_speed
