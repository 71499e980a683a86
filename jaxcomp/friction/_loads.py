"""What the joints carry and lose at given instants, whatever the mechanism."""

from functools import singledispatch

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..mechanism import AbstractMechanism, CrankState


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
        pinches: [SI] quantities whose sign changes bring a load close to zero, where its magnitude turns
            within a very short angle, shape (m, n).
    """

    forces: dict[str, Float[Array, "2 *n"]]
    loss_torque: dict[str, Float[Array, "*n"]]
    residual: Float[Array, "*n"] | None
    margin: Float[Array, "*n"] | None
    kinks: Float[Array, "k *n"]
    pinches: Float[Array, "m *n"]

    @property
    def total_loss_torque(self) -> Float[Array, "*n"]:
        """[N m]"""
        # of the torques where there are any: loads mapped over instants have (n, 2) for their forces
        like = next(iter(self.loss_torque.values()), next(iter(self.forces.values()))[0])
        return sum(self.loss_torque.values(), start=jnp.zeros_like(like))

    def agrees(self, loss_torque: Float[Array, "*n"]) -> Bool[Array, ""]:
        """Whether a total loss torque [N m] that was found without evidence is that of these loads.

        Close to self-locking the steps that an iteration makes on the joint loop are too few.
        """
        exact = self.total_loss_torque
        gap = jnp.max(jnp.abs(loss_torque - exact))
        return gap <= _LOOP_ERROR * jnp.max(jnp.abs(exact))


# [-] Of the largest loss torque. It moves the efficiency by less, since it is met at few angles only.
_LOOP_ERROR = 1e-5


@singledispatch
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
        mechanism: the mechanism, which decides the method.
        friction: its friction laws, or `None` for frictionless joints.
        state: angle, speed and acceleration of the crank, shape (n,) or ().
        gas_force: [N] (p - p_back) A, positive towards the crank.
        gravity: [m/s^2] field in x and y; `None` leaves weights out.
        evidence: also evaluate residual and margin, which an iteration does without.
    """
    raise TypeError(f"No joint loop is known for a mechanism of type {type(mechanism).__name__}.")
