"""What every crank mechanism offers to the rest of the package."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import Part


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


class Vector(NamedTuple):
    """Components along x and y of a plane vector at n instants."""

    x: Float[Array, "*n"]
    y: Float[Array, "*n"]

    def stacked(self) -> Float[Array, "2 *n"]:
        """The three components as one array."""
        return jnp.stack(self)


def turned_with(along, ahead, second: Vector) -> Vector:
    """A vector fixed to the crank times an acceleration, such as an unbalance [kg m] for its force [N].

    Args:
        along, ahead: of the vector towards the pin, and 90 degrees ahead of it; `None` for none there.
        second: [1/s^2] second time derivative of the unit vector towards the pin.
    """
    if ahead is None:
        return Vector(along * second.x, along * second.y)
    # The product of the two as complex numbers, because the vector turns with the crank.
    return Vector(along * second.x - ahead * second.y, along * second.y + ahead * second.x)


@jax.jit
def crank_direction(angle: Float[Array, "*n"]) -> Vector:
    """Unit vector along the crank: cosine and sine of the crank angle [rad].

    They are written into an array: XLA computes what it can fuse once in each of the loops that use it,
    and a dozen loops of an orbit use these.
    """
    vector = jnp.zeros((2, *angle.shape))
    origin = (0,) * angle.ndim
    for row, values in enumerate((jnp.cos(angle), jnp.sin(angle))):
        vector = lax.dynamic_update_slice(vector, values[None], (row, *origin))
    return Vector(*vector)


class AbstractKinematics(eqx.Module):
    """Position of the links at crank angles, with derivatives to crank angle.

    Attributes:
        cosine, sine: [-] of the crank angle.
        position: [m] x_p of the piston, from the crank centre towards the head.
        position_1: [m/rad] x_p'.
        position_2: [m/rad^2] x_p''.
    """

    cosine: Float[Array, "*n"]
    sine: Float[Array, "*n"]
    position: Float[Array, "*n"]
    position_1: Float[Array, "*n"]
    position_2: Float[Array, "*n"]

    def crank_acceleration(
        self, state: CrankState
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """Second time derivative [1/s^2] of the unit vector along the crank, in x and y."""
        square = state.speed * state.speed
        rise = state.acceleration
        along = -self.cosine * square - self.sine * rise
        return along, self.cosine * rise - self.sine * square


class AbstractMechanism(Part):
    """The linkage of one cylinder: one degree of freedom that drives one piston from one crank.

    What belongs to the crankshaft, its inertia and unbalance too, stands in `Crankshaft`.

    The frame has its origin at the crank centre, x along the cylinder towards the head, y across,
    and the crank turns from +x towards +y. A prime is a derivative with respect to crank angle.
    """

    # How often a contact or pin load may reverse in the mid-stroke of an ordinary revolution.
    load_reversals: ClassVar[int] = 4

    piston_mass: eqx.AbstractVar[Float[Array, ""]]

    @abstractmethod
    def kinematics(self, angle: Float[Array, "*n"]) -> AbstractKinematics:
        """Position of all links at crank angles [rad], with derivatives to crank angle."""

    @abstractmethod
    def reduced_inertia(
        self, kinematics: AbstractKinematics
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """Inertia of the linkage reduced to the crank J [kg m^2] and J' [kg m^2/rad]."""

    @abstractmethod
    def weight_torque(
        self, kinematics: AbstractKinematics, gravity: Float[Array, "2"]
    ) -> Float[Array, "*n"]:
        """Torque [N m] of the linkage's weights on the crank, in a gravity [m/s^2] in x, y."""

    @property
    def half_balance(self) -> Float[Array, ""]:
        """[kg m] What a counterweight balances: all that rotates and half of what reciprocates.

        Raises:
            BadInput: a mechanism that does not say.
        """
        bound = f"absent: {type(self).__name__} has no half_balance"
        raise BadInput("crankshaft.balanced", True, bound)

    def piston(
        self, angle: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
        """Piston position x [m], x' [m/rad] and x'' [m/rad^2] at crank angles [rad]."""
        kinematics = self.kinematics(angle)
        return kinematics.position, kinematics.position_1, kinematics.position_2

    def inertia(self, angle: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """Inertia of the linkage, J [kg m^2] and J' [kg m^2/rad], at crank angles [rad]."""
        return self.reduced_inertia(self.kinematics(angle))

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


def swing_at(cosine: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[rad] arccos, and its value at the nearer end beyond -1 or 1."""
    # double where: arccos has an infinite slope at its ends, where the piston turns
    inside = jnp.abs(cosine) < 1
    swing = jnp.arccos(jnp.where(inside, cosine, 0.0))
    return jnp.where(inside, swing, jnp.where(cosine > 0, 0.0, jnp.pi))


def cross(a: Float[Array, "2 *n"], b: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
    """The z-component of a x b."""
    return a[0] * b[1] - a[1] * b[0]


def rotating(angle, speed, acceleration) -> tuple[Float[Array, "2 *n"], Float[Array, "2 *n"]]:
    """Unit vector at `angle` and its second time derivative.

    Args:
        angle: [rad] (*n) from the x axis.
        speed: [rad/s] (*n)
        acceleration: [rad/s2] (*n)
    """
    c = jnp.cos(angle)
    s = jnp.sin(angle)
    unit = jnp.stack([c, s])
    second = jnp.stack([-c * speed**2 - s * acceleration, -s * speed**2 + c * acceleration])
    return unit, second
