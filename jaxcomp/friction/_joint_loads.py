"""What the joints carry and lose at given instants, whatever the mechanism."""

from abc import abstractmethod
from functools import singledispatch
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import clip, max_of, maximum
from .._core.fields import Part
from .._core.roots import AbstractRoot, root
from ..film._placed import PlacedJournal
from ..mechanism import AbstractKinematics, AbstractMechanism, CrankState, Vector


class AbstractFriction(Part):
    """Friction laws of the joints of one kind of mechanism, which has the same `kind`."""


class JointLoads(eqx.Module):
    """Forces and friction of all joints over n instants.

    Attributes:
        forces: [N] force vectors in x and y by joint, shape (2, n).
        loss_torque: [N m] by joint, the power lost over the crank speed (the generalised friction
            torque on the crank, positive when it resists positive rotation), shape (n,).
        residual: [-] what is left of the algebraic joint loop, relative to the loads in it.
        margin: [-] smallest slope of the joint loop, 1 without friction. Where it is not positive
            the joints lock or have several solutions, and the forces mean nothing. `None`, like
            the residual, where no evidence was asked for.
        kinks: [SI] quantities whose sign changes put kinks into the losses, shape (k, n).
        minima: [SI] quantities whose sign changes bring a load close to zero, where its magnitude turns
            within a very short angle, shape (m, n).
    """

    forces: dict[str, Float[Array, "2 *n"]]
    loss_torque: dict[str, Float[Array, "*n"]]
    residual: Float[Array, "*n"] | None
    margin: Float[Array, "*each"] | None
    kinks: Float[Array, "k *n"]
    minima: Float[Array, "m *n"]

    @property
    def total_loss_torque(self) -> Float[Array, "*n"]:
        """[N m]"""
        # of the torques where there are any: loads mapped over instants have (n, 2) for their forces
        like = next(iter(self.loss_torque.values()), next(iter(self.forces.values()))[0])
        return sum(self.loss_torque.values(), start=jnp.zeros_like(like))


# Newton steps on the joint loop from its start. The journals' share of about mu d/l is left there, and
# each step squares it: a residual of rounding after three on the machine of Tsuji et al., after five
# with friction raised until the margin is 0.15.
_NEWTON_STEPS = 6
# A slope of the loop below this belongs to locked joints, which the margin reports.
_LEAST_SLOPE = 1e-3


class Marks(NamedTuple):
    """Quantities that mark load reversals.

    Attributes:
        kinks: [N] whose sign changes put kinks into the losses.
        along_x, along_y: [N] components along x and y of loads that may come close to zero: the sign
            changes of the first mark the places, the second tell how close.
    """

    kinks: tuple[Float[Array, "*n"], ...]
    along_x: tuple[Float[Array, "*n"], ...]
    along_y: tuple[Float[Array, "*n"], ...]


class Balance(NamedTuple):
    """The joints of one cylinder for an assumed unknown.

    Attributes:
        excess: [N] what is left of the balance; its slope over the unknown is near 1.
        loss: [N m] loss torque of these joints.
        force: [N] of the crank on what it drives.
        marks: of load reversals.
    """

    excess: Float[Array, "*n"]
    loss: Float[Array, "*n"]
    force: Vector
    marks: Marks


class AbstractJointLoop(AbstractRoot):
    """The joints of one cylinder at given instants, up to one unknown that closes their balance.

    Everything else follows from the unknown, a force, explicitly; `joint_loads` solves for it.
    """

    # How many quantities of `Marks` are kinks.
    kinks: ClassVar[int] = 1
    # The joint whose force is that of the crank on what it drives.
    at_crank: ClassVar[str] = "crank_pin"
    # Whether loads of the shaft come close to zero at places of their own.
    marks_shaft: ClassVar[bool] = False

    @property
    @abstractmethod
    def coupled(self) -> bool:
        """Whether friction makes the start an approximation only."""

    @abstractmethod
    def start(self) -> Float[Array, "*n"]:
        """[N] The unknown without the friction of the pins."""

    @abstractmethod
    def size(self) -> Float[Array, "*n"]:
        """[N] Magnitude of the loads."""

    @abstractmethod
    def excess(self, unknown: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N] What is left of the balance; its slope over the unknown is near 1."""

    @abstractmethod
    def balance(self, unknown: Float[Array, "*n"]) -> Balance:
        """The excess with losses, force on the crank and marks of load reversals."""

    @abstractmethod
    def loads(self, unknown: Float[Array, "*n"], evidence: bool) -> JointLoads:
        """Forces and losses; with residual and margin if `evidence`."""

    def limit(self) -> Float[Array, "*n"]:
        """Beyond this there is no solution: the joints are locked, and numbers only stay finite."""
        # The added newton keeps the bound away from zero where nothing loads the joints. Without
        # derivatives, because the margin is evaluated there and must not depend on where that is.
        return lax.stop_gradient(1e3 * (self.size() + 1.0))

    def slope(self, unknown: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[-] of the excess over the unknown."""
        # instants do not mix, so that a tangent of ones gives the diagonal, which is the whole Jacobian
        return jax.jvp(self.excess, (unknown,), (jnp.ones_like(unknown),))[1]

    def solve(self):
        limit = self.limit()

        def improve(_, unknown):
            excess, slope = jax.jvp(self.excess, (unknown,), (jnp.ones_like(unknown),))
            return newton_step(unknown, excess, slope, limit)

        return lax.fori_loop(0, _NEWTON_STEPS, improve, self.start())

    def residual(self, unknowns):
        return self.excess(unknowns)

    def newton_correction(self, unknowns, residual):
        # Floored as in the iteration: derivatives of locked joints mean nothing, but stay finite.
        return -residual / maximum(self.slope(unknowns), _LEAST_SLOPE)


def newton_step(unknown, excess, slope, limit):
    """The unknown of a joint loop after one step of Newton's method."""
    return clip(unknown - excess / maximum(slope, _LEAST_SLOPE), -limit, limit)


def relative(excess, size):
    """[-] What a balance leaves over the loads in it; where all of these vanish, rounding is none."""
    # A millionth of the largest load of all instants keeps rounding from counting as a residual where a
    # load passes through zero; 1e-300 is for a machine without any load.
    return excess / (size + 1e-6 * max_of(size) + 1e-300)


def closed(loop: AbstractJointLoop) -> Float[Array, "*n"]:
    """The unknown that closes a joint loop; derivatives of any order by the implicit function theorem."""
    if loop.coupled:
        return root(loop)
    return loop.start()


@singledispatch
def joint_loop(
    mechanism: AbstractMechanism,
    friction,
    state: CrankState,
    gas_force: Float[Array, "*n"],
    gravity: Float[Array, "2"] | None = None,
    kinematics: AbstractKinematics | None = None,
) -> AbstractJointLoop:
    """The joint loop of a mechanism at given instants.

    Args:
        mechanism: the mechanism, which decides the method.
        friction: its friction laws, or `None` for frictionless joints.
        state: angle, speed and acceleration of the crank, shape (n,) or ().
        gas_force: [N] (p - p_back) A, positive towards the crank.
        gravity: [m/s^2] field in x and y; `None` leaves weights out.
        kinematics: of the mechanism at the angles of the state, where the caller has them already.

    Raises:
        TypeError: for a mechanism whose joint loop is not known.
    """
    raise TypeError(f"No joint loop is known for a mechanism of type {type(mechanism).__name__}.")


def joint_loads(
    mechanism: AbstractMechanism,
    friction,
    state: CrankState,
    gas_force: Float[Array, "*n"],
    gravity: Float[Array, "2"] | None = None,
    evidence: bool = True,
) -> JointLoads:
    """Solve the joint loop of a mechanism at given instants.

    Args:
        mechanism, friction, state, gas_force, gravity: see `joint_loop`.
        evidence: also evaluate residual and margin, which an iteration does without.
    """
    loop = joint_loop(mechanism, friction, state, gas_force, gravity)
    return loop.loads(closed(loop), evidence)


def journal_moment(law, force: Vector, rate: Float[Array, "*n"]):
    """[N m] Friction of a journal under a force [N]; `None` without a law."""
    # of a journal that moves the direction counts as well: its load has a moment about the bush's
    # centre
    if isinstance(law, PlacedJournal):
        return law.bush_moment(force.stacked(), rate)
    if law is None:
        return None
    return law.moment(magnitude(*force), rate)


def journal_loss(law, moment, share, force: Vector, speed: Float[Array, "*n"]):
    """[N m] Loss torque of a journal whose rate is `share` of the crank's speed [rad/s].

    That of the moment [N m]; of a moving journal its dissipation, in which the work of the load in the
    clearance has a part.
    """
    if isinstance(law, PlacedJournal):
        return law.loss_torque(force.stacked(), share * speed, speed)
    return moment * share


def shaft_loss(law, force: Vector, speed: Float[Array, "*n"]) -> Any:
    """[N m] Loss torque of a journal of the shaft under a force [N]; `None` without a law."""
    if isinstance(law, PlacedJournal):
        return law.loss_torque(force.stacked(), speed, speed)
    return journal_moment(law, force, speed)


@jax.custom_jvp
def magnitude(x: Float[Array, "*n"], y: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Length of a plane vector, with finite derivatives where it vanishes."""
    return lax.sqrt(x * x + y * y)


@magnitude.defjvp
def _magnitude_jvp(primals, tangents):
    x, y = primals
    moved_x, moved_y = tangents
    # By `magnitude` itself, so that derivatives of higher order take this rule as well.
    size = magnitude(x, y)
    # at zero load the slope is zero, the middle of those along all directions
    return size, (x * moved_x + y * moved_y) / jnp.where(size > 0, size, 1.0)
