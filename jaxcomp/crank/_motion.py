r"""The equation of motion of the crank, closed for the acceleration.

$$J(\theta)\,\alpha + \tfrac12 J'(\theta)\,\omega^2 = M_D + M_{gas} - M_{loss}(\theta,\omega,\alpha)$$

(Tsuji et al. 2012, Eq. 1.) The losses depend on the joint forces and these on the acceleration, so
the equation is implicit. It is solved together with the joint loop, by Newton's method in the two.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._implicit import AbstractRoot, root
from ..compressor import Compressor, Instants, instants, loop_of
from ..friction import JointLoads, newton_step
from ..mechanism import CrankState

# Newton steps from the frictionless acceleration. They end at rounding on the machine of Tsuji et al.
# after three, near self-locking after one or two more.
_NEWTON_STEPS = 5


class Instantaneous(NamedTuple):
    """The equation of motion at an instant, solved.

    Attributes:
        acceleration: [rad/s^2] of the crank.
        at: what the crank angle decides.
        loads: forces and losses of the joints.
    """

    acceleration: Float[Array, ""]
    at: Instants
    loads: JointLoads


def acceleration(
    compressor: Compressor,
    angle: Float[Array, ""],
    speed: Float[Array, ""],
    motor_torque: Float[Array, ""],
    branch_angle: Float[Array, ""] | None = None,
) -> tuple[Float[Array, ""], Float[Array, ""], JointLoads]:
    """Crank acceleration [rad/s^2] with the conservative torque [N m] and the joint loads there.

    Args:
        compressor: the machine; its motor is not asked.
        angle: [rad] crank angle.
        speed: [rad/s] crank speed.
        motor_torque: [N m] on the crank.
        branch_angle: [rad] where to look up directions and phases, if not at `angle` itself. An
            integrator that steps onto a kink passes an angle just inside the panel it is in.
    """
    at = angle if branch_angle is None else branch_angle
    solved = solve_motion(compressor, at, speed, motor_torque)
    return solved.acceleration, solved.at.conservative, solved.loads


def solve_motion(
    compressor: Compressor,
    angle: Float[Array, "*n"],
    speed: Float[Array, "*n"],
    motor_torque: Float[Array, "*n"],
    evidence: bool = False,
) -> Instantaneous:
    """Solve the equation of motion at crank angles [rad], speeds [rad/s] and motor torques [N m].

    With `evidence` the loads have residual and margin of the joint loop.
    """
    # at rest the next motion is taken to be forward
    at = instants(compressor, angle, jnp.where(speed < 0, -1.0, 1.0))
    drive = motor_torque + at.conservative - 0.5 * at.inertia_1 * speed**2
    equation = _Equation(compressor, at, speed, drive)
    value = drive / at.inertia
    if compressor.friction is None:
        loop = equation.loop(value)
        return Instantaneous(value, at, loop.loads(loop.start(), evidence))
    value, joint = root(equation)
    return Instantaneous(value, at, equation.loop(value).loads(joint, evidence))


class _Equation(AbstractRoot):
    """Balance of torques and of joint forces at instants, for acceleration and unknown of the joints."""

    compressor: Compressor
    at: Instants
    speed: Float[Array, "*n"]
    drive: Float[Array, "*n"]

    def loop(self, value):
        at = self.at
        state = CrankState(at.angle, self.speed, value)
        return loop_of(self.compressor, state, at.gas_force, at.kinematics)

    def solve(self):
        start = self.drive / self.at.inertia
        first = self.loop(start)
        limit = first.limit()

        def improve(_, unknowns):
            change, moved = self.newton(*self.slopes(unknowns))
            return unknowns[0] + change, newton_step(
                unknowns[1], -moved, jnp.ones_like(moved), limit
            )

        return lax.fori_loop(0, _NEWTON_STEPS, improve, (start, first.start()))

    def rest(self, unknowns):
        """Torque [N m] and force [N] that are left over."""
        value, joint = unknowns
        loop = self.loop(value)
        excess, loss, _ = loop.balance(joint)
        return self.at.inertia * value - self.drive + loop.total_loss(loss), excess

    def removed(self, unknowns, rest):
        return self.newton(rest, self.slopes(unknowns)[1])

    def slopes(self, unknowns):
        """Slopes of both remainders along the acceleration and along the joints, with the remainders."""
        value, joint = unknowns
        each = self.loop(value).directions(joint)
        one, none = jnp.ones_like(value), jnp.zeros_like(value)
        ways = (
            jnp.stack([one, *[none] * len(each)]),
            jnp.concatenate([jnp.zeros_like(joint)[None], each]),
        )
        rest, linear = jax.linearize(self.rest, unknowns)
        return rest, jax.vmap(linear)(ways)

    def newton(self, rest, slopes):
        """Changes of acceleration and joints that remove the remainders.

        The loops of several cylinders do not know each other: each follows the acceleration by itself.
        """
        (torque, force), (by_torque, by_force) = rest, slopes
        # joints that lock have slopes that are not positive; those of the bare machine are safe
        stiff = jnp.maximum(jnp.sum(by_force[1:], axis=0), 1e-3)
        inertia = by_torque[0] - jnp.sum(by_torque[1:] * by_force[0] / stiff, axis=0)
        inertia = jnp.maximum(inertia, 0.1 * self.at.inertia)
        change = -(torque - jnp.sum(by_torque[1:] * force / stiff, axis=0)) / inertia
        return change, -(force + by_force[0] * change) / stiff
