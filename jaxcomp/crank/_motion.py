r"""The equation of motion of the crank, closed for the acceleration.

$$J(\theta)\,\alpha + \tfrac12 J'(\theta)\,\omega^2 = M_D + M_{gas} - M_{loss}(\theta,\omega,\alpha)$$

(Tsuji et al. 2012, Eq. 1.) The losses depend on the joint forces and these on the acceleration, so
the equation is implicit; the friction's share of the inertia is small, and a few secant steps
solve it.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..compressor import Compressor, conservative_torque, gas_force, loads_at
from ..friction import JointLoads
from ..mechanism import CrankState

# Secant steps from the frictionless acceleration. The first has the slope J, which leaves the
# friction's share of the inertia (3e-3 on the machine of Tsuji et al.); from then on the error of a
# step is about the product of the last two.
_SECANT_STEPS = 5


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
    value, conservative, gas = solve_acceleration(compressor, at, speed, motor_torque)
    loads = loads_at(compressor, CrankState(at, speed, value), gas, evidence=False)
    return value, conservative, loads


def solve_acceleration(
    compressor: Compressor,
    at: Float[Array, ""],
    speed: Float[Array, ""],
    motor_torque: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Crank acceleration [rad/s^2], conservative torque [N m] and gas force [N]."""
    inertia, inertia_1 = compressor.mechanism.inertia(at)
    # at rest the next motion is taken to be forward
    gas = gas_force(compressor, at, jnp.where(speed < 0, -1.0, 1.0))
    conservative = conservative_torque(compressor, at, gas)
    drive = motor_torque + conservative - 0.5 * inertia_1 * speed**2
    start = drive / inertia
    if compressor.friction is None:
        return start, conservative, gas

    def excess(machine, value, inertia, drive, gas, at, speed):
        loads = loads_at(machine, CrankState(at, speed, value), gas, evidence=False)
        return inertia * value - drive + loads.total_loss_torque

    known = (inertia, drive, gas, at, speed)
    frozen, fixed = lax.stop_gradient((compressor, known))
    guess = lax.stop_gradient(start)

    def secant(_, carry):
        value, last, last_excess, slope = carry
        now = excess(frozen, value, *fixed)
        # a step down at rounding has no slope to tell
        far = jnp.abs(value - last) > 1e-6 * (jnp.abs(value) + 1.0)
        slope = jnp.where(far, (now - last_excess) / jnp.where(far, value - last, 1.0), slope)
        # far from the root, or with locked joints, the slope of the bare machine is the safe one
        slope = jnp.maximum(slope, 0.1 * fixed[0])
        return value - now / slope, value, now, slope

    begin = (guess, guess, jnp.zeros_like(guess), fixed[0])
    value, *_ = lax.fori_loop(0, _SECANT_STEPS, secant, begin)
    # one differentiable Newton step from the root: the implicit function theorem
    rest, slope = jax.jvp(
        lambda x: excess(compressor, x, *known), (value,), (jnp.ones_like(value),)
    )
    value = value - rest / lax.stop_gradient(slope)
    return value, conservative, gas
