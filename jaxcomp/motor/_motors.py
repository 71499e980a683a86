r"""Torque of the driving motor over crank speed.

Tsuji et al. (2012) give the mean speed and a torque "in proportion to the rotational speed" without
a constant; `MeanSpeed` finds the level that holds the mean. The induction motor is Kloss'
formula, $M = 2 M_m s s_b/(s^2 + s_b^2)$ with slip $s = 1 - \omega/\omega_s$.
"""

from abc import abstractmethod
from dataclasses import KW_ONLY
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, NONNEGATIVE, POSITIVE, Bound, Part, quantity


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


class MeanSpeed(AbstractMotor):
    """A motor that holds a given mean speed; the level of its torque is an unknown of the orbit.

    `shape` is that of the torque over speed at unit level: constant, or proportional to speed
    (the wording of Tsuji et al.).

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


class ConstantTorque(AbstractMotor):
    """The same torque at every speed. The running speed is found where losses balance it.

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


class Kloss(AbstractMotor):
    """Induction motor over the whole range of speed, from standstill to overrun.

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
        return self.synchronous_speed * (1 - 0.3 * jnp.minimum(self.pull_out_slip, 1.0))
