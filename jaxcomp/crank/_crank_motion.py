r"""The equation of motion of the crank, closed for the acceleration.

$$J(\theta)\,\alpha + \tfrac12 J'(\theta)\,\omega^2 = M_D + M_{gas} - M_{loss}(\theta,\omega,\alpha)$$

(Tsuji et al. 2012, Eq. 1.) The losses depend on the joint forces and these on the acceleration, so
the equation is implicit. It is solved together with the joint loop, by Newton's method in the two.

Over the revolution of a periodic state the motor closes it. With a given mean speed the level of the
motor torque is an unknown; with a torque curve the speed is; with a given speed the torque follows
at every angle, and nothing is left to solve.
"""

from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.elimination import solve_small
from .._core.extremes import max_of, maximum, min_of
from .._core.roots import AbstractRoot, root
from .._core.status import Status
from ..compressor import Compressor, Instants, instants, loop_of
from ..friction import JointLoads
from ..friction._joint_loads import closed, newton_step
from ..mechanism import CrankState
from ..motor import AbstractMotor
from ._panels import Panels

# Newton steps from the frictionless acceleration. They end at rounding on the machine of Tsuji et al.
# after three, near self-locking after one or two more.
_NEWTON_STEPS = 5
# [-] Steepness times width of a panel about which Gauss's rule, which damps nothing that is stiffer,
# turns into Radau's: ordinary motors are far below, and keep an order more.
_STIFF = 30.0


class Instantaneous(NamedTuple):
    """The equation of motion at an instant, solved."""

    acceleration: Float[Array, ""]  # [rad/s^2] of the crank
    at: Instants  # what the crank angle decides
    loads: JointLoads  # forces and losses of the joints


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
    if compressor.frictionless:
        # no losses, so that the acceleration does not depend on the joint forces: nothing to iterate
        loop = equation.loop(value)
        return Instantaneous(value, at, loop.loads(loop.loops.start(), evidence))
    value, joint = root(equation)
    return Instantaneous(value, at, equation.loop(value).loads(joint, evidence))


def motion_at(
    compressor: Compressor,
    angle: Float[Array, "*n"],
    speed: Float[Array, "*n"],
    motor_torque: Float[Array, "*n"],
    evidence: bool = False,
) -> Instantaneous:
    """Motion as by `solve_motion`; where the motor holds its speed there is no equation, and no torque
    is asked.
    """
    if closure_of(compressor.motor).integrates:
        return solve_motion(compressor, angle, speed, motor_torque, evidence)
    at = instants(compressor, angle)
    steady = jnp.zeros_like(speed)
    loop = loop_of(compressor, CrankState(angle, speed, steady), at.gas_force, at.kinematics)
    return Instantaneous(steady, at, loop.loads(closed(loop.loops), evidence))


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
        first = self.loop(start).loops
        limit = first.limit()

        def improve(_, unknowns):
            change, moved = self.newton(*self.slopes(unknowns))
            return unknowns[0] + change, newton_step(
                unknowns[1], -moved, jnp.ones_like(moved), limit
            )

        return lax.fori_loop(0, _NEWTON_STEPS, improve, (start, first.start()))

    def residual(self, unknowns):
        """Torque [N m] and force [N] that are left over."""
        value, joint = unknowns
        loop = self.loop(value)
        excess, (carried, _) = loop.balance(joint)
        return self.at.inertia * value - self.drive + loop.total_loss(carried), excess

    def newton_correction(self, unknowns, residual):
        return self.newton(residual, self.slopes(unknowns)[1])

    def slopes(self, unknowns):
        """Slopes of both remainders along the acceleration and along the joints, with the remainders."""
        value, joint = unknowns
        # acceleration alone, then the joints of each cylinder alone with all others held
        each = self.loop(value).directions(joint)
        ones = jnp.ones_like(value)
        zeros = jnp.zeros_like(value)
        directions = (
            jnp.stack([ones, *[zeros] * len(each)]),
            jnp.concatenate([jnp.zeros_like(joint)[None], each]),
        )
        residual, linear = jax.linearize(self.residual, unknowns)
        return residual, jax.vmap(linear)(directions)

    def newton(self, residual, slopes):
        """Changes of acceleration and joints that remove the remainders.

        The loops of several cylinders do not know each other: each follows the acceleration by itself.
        """
        torque, force = residual
        by_torque, by_force = slopes
        # joints that lock have slopes that are not positive; those of the bare machine are safe
        stiff = maximum(jnp.sum(by_force[1:], axis=0), 1e-3)
        inertia = by_torque[0] - jnp.sum(by_torque[1:] * by_force[0] / stiff, axis=0)
        # near self-locking the effective inertia passes zero: a step of the wrong sign would not return
        inertia = maximum(inertia, 0.1 * self.at.inertia)
        change = -(torque - jnp.sum(by_torque[1:] * force / stiff, axis=0)) / inertia
        return change, -(force + by_force[0] * change) / stiff


class Course(NamedTuple):
    """The course of a motion over the revolution as closures read it, on panels with s nodes."""

    grid: Panels
    speed_scale: Float[Array, ""]  # [rad/s]
    energy_scale: Float[Array, ""]  # [J]
    base: Float[Array, ""]  # [rad/s] speed from whose kinetic energy that of the motion is counted
    inertia: Float[Array, "p s"]  # [kg m^2] J
    inertia_1: Float[Array, "p s"]  # [kg m^2/rad] J'
    conservative: Float[Array, "p s"]  # [N m] of gas and weights
    # [N m] by the motor's law at the last speed; at unit level for a given mean speed
    motor: Float[Array, "p s"]
    loss: Float[Array, "p s"]  # [N m] of all joints
    speed: Float[Array, "p s"]  # [rad/s]
    energy: Float[Array, "p s"]  # [-] kinetic energy of the last motion, from that of the base
    first_energy: Float[Array, ""]  # [-] at the first edge

    @property
    def closed_inertia_1(self) -> Float[Array, "p s"]:
        """[kg m^2/rad] J' whose sum over the revolution vanishes as its integral does.

        Else the inertia would take work at constant speed, as much as the quadrature is off.
        """
        return self.inertia_1 - self.grid.total(self.inertia_1) / (2 * jnp.pi)


class AbstractClosure(eqx.Module):
    """Unknowns besides the course of the speed over a revolution."""

    # Whether `improve` wants the slope of the net torque over the kinetic energy.
    needs_steepness: ClassVar[bool] = False
    # Whether there is an equation of motion to integrate.
    integrates: ClassVar[bool] = True
    # Whether shooting has the level of the motor torque as its second unknown.
    level_is_unknown: ClassVar[bool] = False

    def law(
        self, motor: AbstractMotor, base: Float[Array, ""], change: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """[N m] by the motor's law at a base speed and a change of it [rad/s]."""
        return motor.torque_near(base, change)

    @abstractmethod
    def improve(
        self, motor: Any, course: Course, steepness: Float[Array, "p s"] | None
    ) -> tuple[Float[Array, "p s"], Float[Array, "p s"], Float[Array, ""]]:
        """Better kinetic energy [-] at the nodes, its slope [N m], and the energy at the first edge."""

    @abstractmethod
    def torque(self, course: Course) -> Float[Array, "p s"]:
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

    def _level(self, course):
        """Level of the motor torque that makes the net work of a revolution vanish."""
        return course.grid.total(course.loss - course.conservative) / course.grid.total(
            course.motor
        )

    def torque(self, course):
        return self._level(course) * course.motor

    def improve(self, motor, course, steepness):
        del steepness
        slope = self.torque(course) + course.conservative - course.loss
        gained, _ = course.grid.cumulative(slope)
        gained = gained / course.energy_scale
        first = _energy_for_period(course, gained, 2 * jnp.pi / motor.mean_speed)
        return gained + first, slope, first

    def verdict(self, motor, period, growth, status):
        del growth
        # No level of torque turns a crank slower than it needs to get over the compression.
        slow = ~(period * motor.mean_speed > 0.999 * 2 * jnp.pi)
        return Status.where(slow, Status.stalled, status)


def _energy_for_period(course: Course, gained, period):
    """Kinetic energy at the first edge for which the revolution takes the period.

    Newton's method on period^-2, which is nearly linear in the energy.
    """
    # dt = sqrt(J/2E) dtheta. Two steps, since the iteration of the orbit goes on from the last value.
    root = jnp.sqrt(course.inertia / (2 * course.energy_scale)) * course.grid.weight
    lowest = lax.stop_gradient(min_of(gained))
    # With it the lowest node keeps a thousandth of the dip; with less the crank would come to a halt.
    least = 1e-3 * jnp.abs(lowest) - lowest
    first = maximum(course.first_energy, least)
    for _ in range(2):
        level = maximum(gained + first, 1e-6)
        passing = root / jnp.sqrt(level)
        time = jnp.sum(passing)
        slope = -jnp.sum(passing / level)  # 2 d time / d first
        first = maximum(first + (time - time**3 / period**2) / slope, least)
    return first


class _TorqueCurve(AbstractClosure):
    needs_steepness: ClassVar[bool] = True

    def torque(self, course):
        return course.motor

    def improve(self, motor, course, steepness):
        """A Newton step with the slope of the torques over E, an implicit step on every panel."""
        del motor
        assert steepness is not None
        grid = course.grid
        scale = course.energy_scale
        slope = (
            course.motor
            + course.conservative
            - course.loss
            - 0.5 * course.closed_inertia_1 * course.base**2
        )
        # dE/dtheta = slope + steep (E - E_last), all over `scale`, panel by panel
        constant = slope / scale - steepness * course.energy
        count = grid.rule.nodes.size
        # by the largest of the panel, so that all nodes of it have the same rule
        stiff = (grid.width * max_of(jnp.abs(steepness), axis=1)) ** 2
        damped = (stiff / (stiff + _STIFF**2))[:, None, None] * grid.rule.damping
        integral = grid.width[:, None, None] * (grid.rule.integral + damped)
        # E = E_left + integral (constant + steepness E) at the nodes, linear in E: solved once for the E
        # that enters on the left and once for the torques within.
        matrix = jnp.eye(count) - integral * steepness[:, None, :]
        right = jnp.stack(
            [jnp.ones_like(constant), jnp.einsum("pij,pj->pi", integral, constant)], axis=-1
        )
        answer = solve_small(matrix, right)  # E at the nodes = answer[0] E_left + answer[1]
        factor = 1 + jnp.sum(grid.weight * steepness * answer[..., 0], axis=1)
        shift = jnp.sum(grid.weight * (constant + steepness * answer[..., 1]), axis=1)

        def join(before, after):
            return before[0] * after[0], after[0] * before[1] + after[1]

        # over the first panels: E at their end = through[0] E at the first edge + through[1]
        through = lax.associative_scan(join, (factor, shift))
        first = through[1][-1] / (1 - through[0][-1])
        lefts = jnp.concatenate([first[None], (through[0] * first + through[1])[:-1]])
        energy = answer[..., 0] * lefts[:, None] + answer[..., 1]
        return energy, (constant + steepness * energy) * scale, first

    def verdict(self, motor, period, growth, status):
        del motor, period
        assert growth is not None
        return Status.where(growth < 0, status, Status.no_periodic_state)


class _GivenSpeed(AbstractClosure):
    integrates: ClassVar[bool] = False

    def law(self, motor, base, change):
        del motor, base
        return jnp.zeros_like(change)

    def torque(self, course):
        r"""$M_D = \tfrac12 J'(\theta)\,\omega^2 - M_{gas} + M_{loss}(\theta,\omega,0)$."""
        return 0.5 * course.closed_inertia_1 * course.speed**2 - course.conservative + course.loss

    def improve(self, motor, course, steepness):
        del steepness
        square = motor.mean_speed**2
        # at constant speed E follows the inertia alone, and the motor's torque is read off it afterwards
        energy = 0.5 * course.inertia * square / course.energy_scale
        return energy, 0.5 * course.inertia_1 * square, course.first_energy


_CLOSURES = {"mean_speed": _MeanSpeed(), "torque": _TorqueCurve(), "speed": _GivenSpeed()}


def closure_of(motor: AbstractMotor) -> AbstractClosure:
    """Closure of the revolution by a motor, which says so itself."""
    return _CLOSURES[motor.closes]
