r"""A pass of the collocation solver: from a motion on Gauss panels to a better one.

The unknown is the kinetic energy $E = \tfrac12 J\omega^2$ at the nodes. It obeys

$$dE/d\theta = M_D + M_{gas} - M_{loss}(\theta, \omega, \alpha), \qquad
  \alpha = (dE/d\theta - \tfrac12 J'\omega^2)/J .$$

One pass evaluates the torques at all nodes from the last $E$ and $\alpha$, integrates them along the
panels and closes the turn: with a given mean speed by the level of the motor torque and by the
energy at the first edge, with a torque curve by a Newton step in which the slope of the torques over
$E$ is carried along (an implicit step on every panel). Friction depends weakly on the motion, so a
pass gains two to three digits.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._implicit import FixedPointReport, fixed_point
from ..compressor import Compressor, conservative_torque, gas_force, loads_at
from ..mechanism import CrankState
from ..motor import MeanSpeed
from ._panels import Panels, panels

# Kinetic energy over its mean below which the crank counts as stalled.
ENERGY_FLOOR = 1e-6


class Motion(eqx.Module):
    """Solution on the panels, in units of the mean speed and the mean kinetic energy.

    Attributes:
        energy: [-] kinetic energy at the nodes over `energy_scale`.
        acceleration: [-] crank acceleration at the nodes over the square of the speed scale.
        first_energy: [-] kinetic energy at the first edge.
    """

    energy: Float[Array, "p s"]
    acceleration: Float[Array, "p s"]
    first_energy: Float[Array, ""]


class Turn(eqx.Module):
    """All that is known of one turn before anything moves.

    Attributes:
        grid: the panels.
        inertia, inertia_1: [kg m^2] J and J' at the nodes.
        gas_force: [N] at the nodes.
        conservative: [N m] torque of gas and weights at the nodes.
        speed_scale, energy_scale: [rad/s], [J].
    """

    grid: Panels
    inertia: Float[Array, "p s"]
    inertia_1: Float[Array, "p s"]
    gas_force: Float[Array, "p s"]
    conservative: Float[Array, "p s"]
    speed_scale: Float[Array, ""]
    energy_scale: Float[Array, ""]


class Torques(eqx.Module):
    """Everything that a motion implies at the nodes."""

    state: CrankState
    motor: Float[Array, "p s"]  # [N m], at unit level for a given mean speed
    loss: Float[Array, "p s"]  # [N m]


def turn_edges(kinks: Float[Array, " k"]) -> Float[Array, " k_plus_1"]:
    """Close the turn: the first edge once more, a turn later."""
    return jnp.append(kinks, kinks[0] + 2 * jnp.pi)


def lay_turn(compressor: Compressor, edges: Float[Array, " k"], nodes: int) -> Turn:
    """Panels between the edges, with inertia and conservative torques at their nodes."""
    grid = panels(edges, nodes)
    inertia, inertia_1 = compressor.mechanism.inertia(grid.angle)
    force = gas_force(compressor, grid.angle)
    speed = lax.stop_gradient(compressor.motor.speed_guess)
    mean = lax.stop_gradient(grid.total(inertia)) / (2 * jnp.pi)
    return Turn(
        grid,
        inertia,
        inertia_1,
        force,
        conservative_torque(compressor, grid.angle, force),
        speed,
        0.5 * mean * speed**2,
    )


def initial_motion(turn: Turn) -> Motion:
    """Constant speed."""
    energy = 0.5 * turn.inertia * turn.speed_scale**2 / turn.energy_scale
    return Motion(energy, jnp.zeros_like(energy), energy[0, 0])


def torques(compressor: Compressor, turn: Turn, motion: Motion) -> Torques:
    """Motor and loss torques of a motion at the nodes."""
    # A motion that comes to a halt is reported; the floor keeps its numbers finite.
    energy = jnp.maximum(motion.energy, ENERGY_FLOOR) * turn.energy_scale
    speed = jnp.sqrt(2 * energy / turn.inertia)
    state = CrankState(turn.grid.angle, speed, motion.acceleration * turn.speed_scale**2)
    if compressor.friction is None:
        loss = jnp.zeros_like(speed)
    else:
        loads = loads_at(compressor, state, turn.gas_force, evidence=False)
        loss = loads.total_loss_torque
    return Torques(state, compressor.motor.torque(speed), loss)


def motor_level(turn: Turn, now: Torques) -> Float[Array, ""]:
    """Level of the motor torque that makes the net work of a turn vanish."""
    net = turn.grid.total(now.loss - turn.conservative)
    return net / turn.grid.total(now.motor)


def iterate(
    compressor: Compressor, turn: Turn, start: Motion, tolerance: float, max_passes: int
) -> tuple[Motion, FixedPointReport]:
    """Repeat passes on fixed panels until the motion stands still."""
    return fixed_point(lambda m: better_motion(compressor, turn, m), start, tolerance, max_passes)


def better_motion(compressor: Compressor, turn: Turn, motion: Motion) -> Motion:
    """One pass."""
    if isinstance(compressor.motor, MeanSpeed):
        return _pass_at_mean_speed(compressor, compressor.motor, turn, motion)
    return _pass_on_torque_curve(compressor, turn, motion)


def _pass_at_mean_speed(
    compressor: Compressor, motor: MeanSpeed, turn: Turn, motion: Motion
) -> Motion:
    now = torques(compressor, turn, motion)
    slope = motor_level(turn, now) * now.motor + turn.conservative - now.loss
    gained, _ = turn.grid.cumulative(slope)
    first = _energy_for_period(
        turn,
        gained / turn.energy_scale,
        motion.first_energy,
        2 * jnp.pi / motor.mean_speed,
    )
    return _motion(turn, gained / turn.energy_scale + first, slope, first)


def _energy_for_period(turn: Turn, gained, first, period):
    """Kinetic energy at the first edge for which the turn takes the period.

    Newton's method on period^-2, which is nearly linear in the energy.
    """
    root = jnp.sqrt(turn.inertia / (2 * turn.energy_scale)) * turn.grid.weight
    lowest = lax.stop_gradient(jnp.min(gained))
    first = jnp.maximum(first, 1e-3 * jnp.abs(lowest) - lowest)
    for _ in range(2):
        level = jnp.maximum(gained + first, 1e-6)
        time = jnp.sum(root / jnp.sqrt(level))
        slope = -0.5 * jnp.sum(root / level**1.5)  # d time / d first
        first = first + (time - time**3 / period**2) / (2 * slope)
        first = jnp.maximum(first, 1e-3 * jnp.abs(lowest) - lowest)
    return first


def resolved_turn(
    compressor: Compressor, turn: Turn, motion: Motion
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Duration of the turn [s] and lowest kinetic energy [-], with twice the nodes on every panel.

    The polynomials of the energy are smooth where the crank all but halts; the duration, which goes
    with one over its root, is not, and the nodes may step over the halt.
    """
    nodes = 2 * turn.grid.rule.nodes.size
    fine = panels(turn.grid.edges, nodes)
    inertia, _ = compressor.mechanism.inertia(fine.angle)
    energy = turn.grid.finer(motion.energy, nodes)
    level = jnp.maximum(energy, ENERGY_FLOOR) * turn.energy_scale
    return fine.total(jnp.sqrt(inertia / (2 * level))), jnp.min(energy)


def steepness(compressor: Compressor, turn: Turn, motion: Motion) -> Float[Array, "p s"]:
    """[1/rad] Slope of the net torque over the kinetic energy at the nodes.

    Its integral over the turn is the logarithm of the factor by which a disturbance of the orbit
    grows in a turn.
    """

    def net(energy, acceleration):
        now = torques(compressor, turn, Motion(energy, acceleration, motion.first_energy))
        return now.motor - now.loss

    now = (motion.energy, motion.acceleration)
    along = (
        jnp.ones_like(motion.energy),
        -turn.inertia_1 / turn.inertia**2 * turn.energy_scale / turn.speed_scale**2,
    )
    return jax.jvp(net, now, along)[1] / turn.energy_scale


def _pass_on_torque_curve(compressor: Compressor, turn: Turn, motion: Motion) -> Motion:
    scale = turn.energy_scale
    grid = turn.grid
    # The steepness only steers the iteration, so it needs no derivative.
    steep = lax.stop_gradient(steepness(*lax.stop_gradient((compressor, turn, motion))))
    now = torques(compressor, turn, motion)
    slope = now.motor + turn.conservative - now.loss
    # dE/dtheta = slope + steep (E - E_last), all over `scale`, panel by panel
    rest = slope / scale - steep * motion.energy
    count = grid.rule.nodes.size
    width = grid.width[:, None, None]
    matrix = jnp.eye(count) - width * grid.rule.integral * steep[:, None, :]
    right = jnp.stack(
        [jnp.ones_like(rest), grid.width[:, None] * (rest @ grid.rule.integral.T)], axis=-1
    )
    answer = jnp.linalg.solve(matrix, right)  # E at the nodes = answer[0] E_left + answer[1]
    weight = grid.weight
    factor = 1 + jnp.sum(weight * steep * answer[..., 0], axis=1)
    shift = jnp.sum(weight * (rest + steep * answer[..., 1]), axis=1)

    def over_panel(left, map_):
        return map_[0] * left + map_[1], left

    total_factor = jnp.prod(factor)
    end_from_zero, _ = lax.scan(over_panel, jnp.zeros(()), (factor, shift))
    first = end_from_zero / (1 - total_factor)
    _, lefts = lax.scan(over_panel, first, (factor, shift))
    energy = answer[..., 0] * lefts[:, None] + answer[..., 1]
    new_slope = (rest + steep * energy) * scale
    return _motion(turn, energy, new_slope, first)


def _motion(turn: Turn, energy, slope, first) -> Motion:
    floored = jnp.maximum(energy, ENERGY_FLOOR) * turn.energy_scale
    acceleration = (slope - turn.inertia_1 * floored / turn.inertia) / turn.inertia
    return Motion(energy, acceleration / turn.speed_scale**2, first)


def transfer(turn: Turn, motion: Motion, to: Turn) -> Motion:
    """A motion, interpolated to other panels of the same turn."""
    angle = jnp.clip(to.grid.angle, turn.grid.edges[0], turn.grid.edges[-1])
    rescale = turn.energy_scale / to.energy_scale
    energy, acceleration = turn.grid.interpolate((motion.energy, motion.acceleration), angle)
    return Motion(energy * rescale, acceleration, motion.first_energy * rescale)
