"""How a motor closes the revolution of the periodic state.

With a given mean speed the level of the motor torque is an unknown; with a torque curve the speed
is; with a given speed the torque follows at every angle, and nothing is left to solve.
"""

from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._status import Status
from ..motor import AbstractMotor
from ._panels import Panels


class Instant(NamedTuple):
    """What a closure is told of the last motion, on panels with s nodes.

    Attributes:
        grid: the panels.
        speed_scale, energy_scale: [rad/s], [J].
        inertia, inertia_1: [kg m^2] J and J'.
        conservative: [N m] of gas and weights.
        motor: [N m] by the motor's law at the last speed; at unit level for a given mean speed.
        loss: [N m] of all joints.
        speed: [rad/s].
        energy: [-] kinetic energy of the last motion.
        first_energy: [-] at the first edge.
    """

    grid: Panels
    speed_scale: Float[Array, ""]
    energy_scale: Float[Array, ""]
    inertia: Float[Array, "p s"]
    inertia_1: Float[Array, "p s"]
    conservative: Float[Array, "p s"]
    motor: Float[Array, "p s"]
    loss: Float[Array, "p s"]
    speed: Float[Array, "p s"]
    energy: Float[Array, "p s"]
    first_energy: Float[Array, ""]


class AbstractClosure(eqx.Module):
    """What is unknown besides the course of the speed over a revolution."""

    # Whether `improve` wants the slope of the net torque over the kinetic energy.
    needs_steepness: ClassVar[bool] = False
    # Whether there is an equation of motion to integrate.
    integrates: ClassVar[bool] = True
    # Whether shooting has the level of the motor torque as its second unknown.
    level_is_unknown: ClassVar[bool] = False

    def law(self, motor: AbstractMotor, speed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] by the motor's law at a speed [rad/s]."""
        return motor.torque(speed)

    @abstractmethod
    def improve(
        self, motor: Any, now: Instant, steepness: Float[Array, "p s"] | None
    ) -> tuple[Float[Array, "p s"], Float[Array, "p s"], Float[Array, ""]]:
        """Better kinetic energy [-] at the nodes, its slope [N m], and the energy at the first edge."""

    @abstractmethod
    def torque(self, now: Instant) -> Float[Array, "p s"]:
        """[N m] of the motor in a motion that solves the equation."""

    def verdict(
        self,
        motor: Any,
        period: Float[Array, ""],
        growth: Float[Array, ""] | None,
        status: Status,
    ) -> Status:
        """The status with what the closure can find wrong: a period [s], growth of a disturbance [-]."""
        del motor, period, growth
        return status


class _MeanSpeed(AbstractClosure):
    level_is_unknown: ClassVar[bool] = True

    def _level(self, now):
        """Level of the motor torque that makes the net work of a revolution vanish."""
        return now.grid.total(now.loss - now.conservative) / now.grid.total(now.motor)

    def torque(self, now):
        return self._level(now) * now.motor

    def improve(self, motor, now, steepness):
        del steepness
        slope = self.torque(now) + now.conservative - now.loss
        gained, _ = now.grid.cumulative(slope)
        gained = gained / now.energy_scale
        first = _energy_for_period(now, gained, 2 * jnp.pi / motor.mean_speed)
        return gained + first, slope, first

    def verdict(self, motor, period, growth, status):
        del growth
        # No level of torque turns a crank slower than it needs to get over the compression.
        slow = ~(period * motor.mean_speed > 0.999 * 2 * jnp.pi)
        return Status.where(slow, Status.stalled, status)


def _energy_for_period(now: Instant, gained, period):
    """Kinetic energy at the first edge for which the revolution takes the period.

    Newton's method on period^-2, which is nearly linear in the energy.
    """
    root = jnp.sqrt(now.inertia / (2 * now.energy_scale)) * now.grid.weight
    lowest = lax.stop_gradient(jnp.min(gained))
    least = 1e-3 * jnp.abs(lowest) - lowest
    first = jnp.maximum(now.first_energy, least)
    for _ in range(2):
        level = jnp.maximum(gained + first, 1e-6)
        passing = root / jnp.sqrt(level)
        time = jnp.sum(passing)
        slope = -jnp.sum(passing / level)  # 2 d time / d first
        first = jnp.maximum(first + (time - time**3 / period**2) / slope, least)
    return first


class _TorqueCurve(AbstractClosure):
    needs_steepness: ClassVar[bool] = True

    def torque(self, now):
        return now.motor

    def improve(self, motor, now, steepness):
        """A Newton step with the slope of the torques over E, an implicit step on every panel."""
        del motor
        assert steepness is not None
        grid, scale = now.grid, now.energy_scale
        slope = now.motor + now.conservative - now.loss
        # dE/dtheta = slope + steep (E - E_last), all over `scale`, panel by panel
        rest = slope / scale - steepness * now.energy
        count = grid.rule.nodes.size
        matrix = (
            jnp.eye(count)
            - grid.width[:, None, None] * grid.rule.integral * (steepness[:, None, :])
        )
        right = jnp.stack(
            [jnp.ones_like(rest), grid.width[:, None] * (rest @ grid.rule.integral.T)], axis=-1
        )
        answer = jnp.linalg.solve(matrix, right)  # E at the nodes = answer[0] E_left + answer[1]
        factor = 1 + jnp.sum(grid.weight * steepness * answer[..., 0], axis=1)
        shift = jnp.sum(grid.weight * (rest + steepness * answer[..., 1]), axis=1)

        def join(one, next_):
            return one[0] * next_[0], next_[0] * one[1] + next_[1]

        # over the first panels: E at their end = through[0] E at the first edge + through[1]
        through = lax.associative_scan(join, (factor, shift))
        first = through[1][-1] / (1 - through[0][-1])
        lefts = jnp.concatenate([first[None], (through[0] * first + through[1])[:-1]])
        energy = answer[..., 0] * lefts[:, None] + answer[..., 1]
        return energy, (rest + steepness * energy) * scale, first

    def verdict(self, motor, period, growth, status):
        del motor, period
        assert growth is not None
        return Status.where(growth < 0, status, Status.no_periodic_state)


class _GivenSpeed(AbstractClosure):
    integrates: ClassVar[bool] = False

    def law(self, motor, speed):
        del motor
        return jnp.zeros_like(speed)

    def torque(self, now):
        r"""$M_D = \tfrac12 J'(\theta)\,\omega^2 - M_{gas} + M_{loss}(\theta,\omega,0)$."""
        return 0.5 * now.inertia_1 * now.speed**2 - now.conservative + now.loss

    def improve(self, motor, now, steepness):
        del steepness
        square = motor.mean_speed**2
        energy = 0.5 * now.inertia * square / now.energy_scale
        return energy, 0.5 * now.inertia_1 * square, now.first_energy


_CLOSURES = {"mean_speed": _MeanSpeed(), "torque": _TorqueCurve(), "speed": _GivenSpeed()}


def closure_of(motor: AbstractMotor) -> AbstractClosure:
    """How a motor closes the revolution: it says so itself."""
    return _CLOSURES[motor.closes]
