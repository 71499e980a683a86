r"""The equation of motion of the crank, closed for the acceleration.

$$J(\theta)\,\alpha + \tfrac12 J'(\theta)\,\omega^2 = M_D + M_{gas} - M_{loss}(\theta,\omega,\alpha)$$

(Tsuji et al. 2012, Eq. 1.) The losses depend on the joint forces and these on the acceleration, so
the equation is implicit; the friction's share of the inertia is small, and a secant slope with a few
chord steps solves it.
"""

import jax
from jax import lax
from jaxtyping import Array, Float

from ..compressor import Compressor, conservative_torque, gas_force, loads_at
from ..friction import JointLoads
from ..mechanism import CrankState

# Each chord step gains the ratio of (slope error)/(slope): about 4 digits on the machine of Tsuji et
# al., 2 with friction raised to half of self-locking.
_CHORD_STEPS = 5


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
    inertia, inertia_1 = compressor.mechanism.inertia(at)
    gas = gas_force(compressor, at, jax.numpy.sign(speed))
    conservative = conservative_torque(compressor, at, gas)
    drive = motor_torque + conservative - 0.5 * inertia_1 * speed**2
    start = drive / inertia
    if compressor.friction is None:
        return start, conservative, loads_at(compressor, CrankState(at, speed, start), gas)

    def excess(machine, value, inertia, drive, gas, at, speed):
        loads = loads_at(machine, CrankState(at, speed, value), gas)
        return inertia * value - drive + loads.total_loss_torque

    known = (inertia, drive, gas, at, speed)
    frozen, fixed = lax.stop_gradient((compressor, known))
    guess = lax.stop_gradient(start)
    width = 1e-3 * (abs(guess) + 1.0)
    first = excess(frozen, guess, *fixed)
    slope = (excess(frozen, guess + width, *fixed) - first) / width

    def chord(_, value):
        return value - excess(frozen, value, *fixed) / slope

    value = lax.fori_loop(0, _CHORD_STEPS, chord, guess - first / slope)
    # one differentiable step from the root: the implicit function theorem
    value = value - excess(compressor, value, *known) / slope
    return value, conservative, loads_at(compressor, CrankState(at, speed, value), gas)
