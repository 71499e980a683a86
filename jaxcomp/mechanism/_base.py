"""What every crank mechanism offers to the rest of the house."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import Part


class CrankState(NamedTuple):
    """Where the crank is and how it moves.

    Attributes:
        angle: [rad] crank angle, zero at the outer end of the crank circle on the cylinder side.
        speed: [rad/s] its rate.
        acceleration: [rad/s^2] its second rate.
    """

    angle: Float[Array, "*n"]
    speed: Float[Array, "*n"]
    acceleration: Float[Array, "*n"]


class AbstractMechanism(Part):
    """A mechanism of one degree of freedom that drives one piston from one crank.

    The frame has its origin at the crank centre, x along the cylinder towards the head, y across,
    and the crank turns from +x towards +y. A prime is a derivative with respect to crank angle.
    """

    # How often a contact or pin load may change its side in the mid-stroke of an ordinary turn.
    side_changes: ClassVar[int] = 4

    piston_mass: eqx.AbstractVar[Float[Array, ""]]
    crank_inertia: eqx.AbstractVar[Float[Array, ""]]

    @abstractmethod
    def piston(
        self, angle: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
        """Piston position x [m], x' [m/rad] and x'' [m/rad^2]."""

    @abstractmethod
    def inertia(self, angle: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """Inertia reduced to the crank J [kg m^2] and J' [kg m^2/rad]."""

    @abstractmethod
    def dead_centres(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Crank angles [rad] of the top and, within the next turn, the bottom dead centre."""

    @abstractmethod
    def piston_extremes(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Piston position [m] at the top and at the bottom dead centre."""

    @abstractmethod
    def angle_at(self, position: Float[Array, "*n"], inward: bool) -> Float[Array, "*n"]:
        """Crank angle [rad] at a piston position [m], towards the head if `inward`, or away."""

    @abstractmethod
    def reversals(self) -> tuple[Float[Array, ""], ...]:
        """Crank angles [rad], besides the dead centres, where a sliding direction reverses."""

    @abstractmethod
    def gravity_torque(
        self, angle: Float[Array, "*n"], gravity: Float[Array, "2"]
    ) -> Float[Array, "*n"]:
        """Torque [N m] of all weights on the crank at an angle [rad], in a gravity [m/s^2] in x, y."""

    @property
    @abstractmethod
    def piston_area(self) -> Float[Array, ""]:
        """[m^2]"""

    @property
    def stroke(self) -> Float[Array, ""]:
        """[m] Distance between the true dead centres."""
        top, bottom = self.piston_extremes()
        return top - bottom

    @property
    def swept_volume(self) -> Float[Array, ""]:
        """[m^3]"""
        return self.piston_area * self.stroke


def cross(a: Float[Array, "2 *n"], b: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
    """The z-component of a x b."""
    return a[0] * b[1] - a[1] * b[0]


def rotating(angle, speed, acceleration) -> tuple[Float[Array, "2 *n"], Float[Array, "2 *n"]]:
    """Unit vector at `angle` and its second time derivative."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    unit = jnp.stack([c, s])
    second = jnp.stack([-c * speed**2 - s * acceleration, -s * speed**2 + c * acceleration])
    return unit, second
