r"""An iteration of the collocation solver: from a motion on Gauss panels to a better one.

The unknown is the kinetic energy $E = \tfrac12 J\omega^2$ at the nodes. It obeys

$$dE/d\theta = M_D + M_{gas} - M_{loss}(\theta, \omega, \alpha), \qquad
  \alpha = (dE/d\theta - \tfrac12 J'\omega^2)/J .$$

One iteration evaluates the torques at all nodes from the last $E$ and $\alpha$, makes one step of
Newton's method on the joint loop of every node, integrates the torques along the panels and closes
the revolution as the motor says (`_crank_motion`). The places of the load reversals, at which panels end,
are unknowns as well: the loads are evaluated there together with those at the nodes, and a step along
the slope of the quantity that changes its sign moves the place. Friction depends weakly on the motion,
so an iteration gains two to three digits.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import clip, max_of, maximum, min_of
from .._core.roots import frozen
from ..compressor import Compressor, Instants, instants, loop_of
from ..crankshaft._loops import MachineLoops
from ..friction._joint_loads import newton_step
from ..mechanism import CrankState
from ._crank_motion import Course, closure_of
from ._journals import (
    improved_positions,
    journal_drive,
    journal_torque,
    orbiting_journals,
    with_journals,
)
from ._panels import NO_WIDTH, Panels, panels

# Kinetic energy over its mean below which the crank counts as stalled.
ENERGY_FLOOR = 1e-6
# [-] What rounding leaves of the kinetic energy over its mean: a slip that is a millionth of the pull-out
# slip of 1e-6 left changes of 9e-8 in the acceleration at a slope of 1.4e9 over it. With room for laws
# that know no small change of the speed.
_ENERGY_NOISE = 1e-14
# [rad] Of the places of load reversals in the unknowns. What a place is off by counts squared in the
# losses and their derivatives, since they are continuous there: it need not be known as closely as the
# motion.
PLACE_UNIT = 1e4


class Resolution(eqx.Module):
    """Fineness with which a revolution is cut."""

    nodes: int = eqx.field(static=True)  # Gauss nodes on every panel
    # how many kinks, and how many near-zero loads, may become panel edges
    reversals: int = eqx.field(static=True)
    # how often the panels beside a near-zero load are cut again, towards it
    grading: int = eqx.field(static=True)

    def panels_between(self, edges: Float[Array, " e"], places: Float[Array, " k"]) -> Panels:
        """Panels between the edges of the revolution and the places of the load reversals."""
        if places.size:
            kinks, minima = jnp.split(places, 2)
            # the panels beside the load minima are cut in geometric progression
            distance = 0.1 * 0.15 ** jnp.arange(self.grading)
            around = jnp.concatenate([-distance, distance, jnp.zeros(1)])
            inner = jnp.concatenate([kinks, (minima[:, None] + around).ravel()])
            # places outside of the revolution make panels of no width at its ends
            edges = jnp.sort(jnp.concatenate([edges, clip(inner, edges[0], edges[-1])]))
        return panels(edges, self.nodes)


class UnknownScales(NamedTuple):
    """Units of the unknowns, without derivatives: [rad/s], [J], [N]."""

    speed: Float[Array, ""]
    energy: Float[Array, ""]
    force: Float[Array, ""]
    # [rad/s] The unknown is the kinetic energy less that at this speed. Of a motor with a torque curve it
    # is the guess: no digits of a small slip are lost, and no polynomial follows the inertia's swing.
    base: Float[Array, ""]


class OrbitParameters(eqx.Module):
    """Quantities that a solution depends on."""

    compressor: Compressor
    # [rad] its kinks that are known beforehand, and the first once more a revolution later
    edges: Float[Array, " e"]
    scales: UnknownScales  # of the unknowns


class Motion(eqx.Module):
    """The unknowns, of order one."""

    # [-] kinetic energy at the nodes, less that at the base speed, over its scale
    energy: Float[Array, "p s"]
    # [-] crank acceleration at the nodes over the square of the speed scale
    acceleration: Float[Array, "p s"]
    first_energy: Float[Array, ""]  # [-] kinetic energy at the first edge
    # [-] unknowns of the joint loops at all nodes and then at the places, from their start, over the
    # scale of forces; of no entries without friction
    joints: Float[Array, "cylinders m"]
    reversals: Float[Array, " k"]  # their places over `PLACE_UNIT`
    # [-] positions of the journals that move, over their clearances; `None` without any
    journals: Float[Array, "2 j p s"] | None = None

    @property
    def places(self) -> Float[Array, " k"]:
        """[rad] Load reversals."""
        return PLACE_UNIT * self.reversals


class Reversals(eqx.Module):
    """Load reversals: kinks, then as many near-zero loads."""

    row: Int[Array, " k"]  # which quantity changes its sign; -1 for a place that is not used
    slope: Float[Array, " k"]  # of that quantity over crank angle
    # [rad] the kinks known beforehand on both sides of a place, which it does not cross
    low: Float[Array, " k"]
    high: Float[Array, " k"]
    moving: Bool[Array, ""]  # whether the places follow the motion, or wait for a first solution


def prepare(compressor: Compressor, edges: Float[Array, " e"]) -> OrbitParameters:
    """Quantities that the solution of a compressor depends on."""
    at = lax.stop_gradient(instants(compressor, edges))
    speed = lax.stop_gradient(compressor.motor.speed_guess)
    energy = 0.5 * jnp.mean(at.inertia) * speed**2
    force = max_of(jnp.abs(at.gas_force))
    stroke = lax.stop_gradient(compressor.mechanism.stroke / 2)
    # The gas force and one of inertia, E over the crank radius: the sum is a scale without gas as well.
    force += energy / min_of(stroke)
    base = speed
    if not closure_of(compressor.motor).needs_steepness:
        base = jnp.zeros_like(speed)
    return OrbitParameters(compressor, edges, UnknownScales(speed, energy, force, base))


def revolution_edges(kinks: Float[Array, " k"]) -> Float[Array, " k_plus_1"]:
    """Close the revolution: the first edge once more, a revolution later."""
    return jnp.append(kinks, kinks[0] + 2 * jnp.pi)


def initial_motion(parameters: OrbitParameters, resolution: Resolution) -> Motion:
    """Constant energy, or constant speed if the motor holds it; and no place in use."""
    places = jnp.full(2 * resolution.reversals, parameters.edges[0])
    grid = resolution.panels_between(parameters.edges, places)
    friction = not parameters.compressor.frictionless
    # where the base is the guess itself, that is no energy above it
    energy = jnp.where(parameters.scales.base > 0, 0.0, jnp.ones_like(grid.angle))
    count = parameters.compressor.crankshaft.count
    joints = jnp.zeros((count, 0))
    if friction:
        joints = jnp.zeros((count, energy.size + places.size))
    journals = len(orbiting_journals(parameters.compressor))
    centred = None
    if journals:
        centred = jnp.zeros((2, journals, *energy.shape))
    zeros = jnp.zeros_like(energy)
    return Motion(energy, zeros, jnp.ones(()), joints, places / PLACE_UNIT, centred)


def floored_energy(inertia, scales: UnknownScales, energy):
    """[J] Kinetic energy less that at the base speed, and in all: at least a floor.

    A motion that comes to a halt is reported; the floor keeps its numbers finite.
    """
    base = 0.5 * inertia * scales.base**2
    # the difference is floored and the base added, not the reverse: a small slip keeps its digits
    counted = maximum(energy * scales.energy, ENERGY_FLOOR * scales.energy - base)
    return counted, counted + base


def state_of(at: Instants, scales: UnknownScales, energy, acceleration) -> tuple[CrankState, Array]:
    """Crank angle, speed and acceleration of the unknowns, and the change of the base speed [rad/s]."""
    counted, total = floored_energy(at.inertia, scales, energy)
    speed = jnp.sqrt(2 * total / at.inertia)
    # omega^2 - omega_0^2 = (omega - omega_0)(omega + omega_0): no difference of two speeds is formed
    change = 2 * counted / (at.inertia * (speed + scales.base))
    return CrankState(at.angle, speed, acceleration * scales.speed**2), change


def joints_of(loop: MachineLoops, scales: UnknownScales, unknown) -> Float[Array, "cylinders m"]:
    """[N] The unknown of the joint loops, from its value in units of the solver."""
    return lax.stop_gradient(loop.loops.start()) + scales.force * unknown


def _improved_joints(loop: MachineLoops, scales: UnknownScales, unknown):
    """Unknown, loss torque [N m] and marks of load reversals after one step of Newton's method.

    Its slopes are constants to derivatives: at the solution, where the step vanishes, derivatives of
    all orders are exact whatever the slopes.
    """
    force = joints_of(loop, scales, unknown)
    (excess, carried_and_marks), slopes = jax.jvp(loop.balance, (force,), (jnp.ones_like(force),))
    slope, rises = lax.stop_gradient(slopes)
    step = newton_step(force, excess, slope, loop.loops.limit()) - force
    carried, marks = jax.tree.map(lambda value, rise: value + rise * step, carried_and_marks, rises)
    return unknown + step / scales.force, *loop.finished(carried, marks)


def steepness(
    compressor: Compressor, at: Instants, scales: UnknownScales, energy, acceleration, unknown
) -> Float[Array, " m"]:
    """[1/rad] Slope of the net torque over the kinetic energy; derivatives are not wanted of it.

    Its integral over the revolution is the logarithm of the factor by which a disturbance of the
    orbit grows in a revolution.
    """

    def torques(energy, acceleration, force):
        state, change = state_of(at, scales, energy, acceleration)
        motor = compressor.motor.torque_near(scales.base, change)
        if compressor.frictionless:
            return motor, jnp.zeros_like(motor)
        loop = loop_of(compressor, state, at.gas_force, at.kinematics)
        excess, (carried, _) = loop.balance(force)
        return motor - loop.total_loss(carried), excess

    force = jnp.zeros_like(energy)
    each = jnp.ones_like(energy)[None]
    if not compressor.frictionless:
        state, _ = state_of(at, scales, energy, acceleration)
        loop = loop_of(compressor, state, at.gas_force, at.kinematics)
        force = joints_of(loop, scales, unknown)
        each = loop.directions(force)
    falling = -at.inertia_1 / at.inertia**2 * scales.energy / scales.speed**2
    zeros = jnp.zeros_like(energy)
    ones = jnp.ones_like(energy)
    # The acceleration of a constant torque falls as the inertia grows along the angle:
    # alpha = (dE/dtheta - J' E/J)/J has the slope -J'/J^2 over E.
    # along the kinetic energy, and along the unknowns of the joints, which follow it
    joints_held = [zeros] * len(each)
    directions = jnp.stack([ones, *joints_held]), jnp.stack([falling, *joints_held])
    directions = (*directions, jnp.concatenate([jnp.zeros_like(force)[None], each]))
    net, excess = jax.vmap(
        lambda *direction: jax.jvp(torques, (energy, acceleration, force), direction)[1]
    )(*directions)
    # the loops of several cylinders do not know each other; the floor is that of `_Equation.newton`
    follows = -excess[0] / maximum(jnp.sum(excess[1:], axis=0), 1e-3)
    return (net[0] + jnp.sum(follows * net[1:], axis=0)) / scales.energy


def motor_steepness(parameters: OrbitParameters) -> Float[Array, ""]:
    """[1/rad] Slope of a torque curve over the kinetic energy, without derivatives, at the guess."""
    motor = frozen(parameters.compressor.motor)
    speed = parameters.scales.speed
    if not closure_of(motor).needs_steepness:
        return jnp.zeros(())
    _, slope = jax.jvp(motor.torque, (speed,), (jnp.ones_like(speed),))
    return jnp.abs(slope) * speed / (2 * parameters.scales.energy)


def rounding_of(parameters: OrbitParameters) -> Float[Array, ""]:
    """[-] What the rounding of the energy leaves of the acceleration, by the slope of a torque curve."""
    return _ENERGY_NOISE * motor_steepness(parameters)


def revolution(
    parameters: OrbitParameters, resolution: Resolution, places: Float[Array, " k"]
) -> tuple[Panels, Instants]:
    """Panels cut at load reversals [rad], and what the angle decides at their nodes and the places."""
    grid = resolution.panels_between(parameters.edges, places)
    angle = grid.angle.ravel()
    # one row with the nodes, so that all laws are traced and called once
    if places.size:
        angle = jnp.concatenate([angle, places])
    return grid, instants(parameters.compressor, angle)


class _Points(NamedTuple):
    """The nodes of the panels in one row, and then the places, each the left edge of a panel."""

    grid: Panels
    places: Float[Array, " k"]  # [rad]

    def row(self, values: Float[Array, "*m p s"]) -> Float[Array, "*m r"]:
        """Values at the nodes in a row, with those that their polynomials have at the places."""
        at_nodes = values.reshape(*values.shape[:-2], -1)
        if not self.places.size:
            return at_nodes
        at_left_edges = values @ self.grid.rule.through(np.zeros(1))[0]
        at_places = at_left_edges[..., self.grid.panel_of(lax.stop_gradient(self.places))]
        return jnp.concatenate([at_nodes, at_places], axis=-1)

    def beyond(self, row: Float[Array, "*m r"]) -> Float[Array, "*m k"]:
        """Part of a row that belongs to the places."""
        return row[..., self.grid.angle.size :]


def improve(
    parameters: OrbitParameters,
    resolution: Resolution,
    reversals: Reversals,
    motion: Motion,
    cut: tuple[Panels, Instants] | None = None,
) -> tuple[Motion, Float[Array, "q p s"], Float[Array, " k"]]:
    """One iteration: better unknowns, with the quantities that mark reversals at nodes and places.

    `cut` is the `revolution` at the places of the motion, where these stay.
    """
    compressor = parameters.compressor
    scales = parameters.scales
    places = motion.places
    if cut is None:
        grid, at = revolution(parameters, resolution, places)
    else:
        grid, at = cut
    points = _Points(grid, places)
    energy = points.row(motion.energy)
    acceleration = points.row(motion.acceleration)
    state, change = state_of(at, scales, energy, acceleration)
    if motion.journals is not None:
        compressor = with_journals(compressor, points.row(motion.journals), lossless=True)
    joints, journals, loss, rows = _improved_contacts(
        parameters, compressor, points, at, state, motion
    )

    closure = closure_of(compressor.motor)
    slope_of_torque = None
    if closure.needs_steepness:
        arguments = (compressor, at, scales, energy, acceleration, motion.joints)
        slope_of_torque = lax.stop_gradient(points.grid.by_panels(steepness(*frozen(arguments))))
    course = Course(
        grid=grid,
        speed_scale=scales.speed,
        energy_scale=scales.energy,
        base=scales.base,
        inertia=points.grid.by_panels(at.inertia),
        inertia_1=points.grid.by_panels(at.inertia_1),
        conservative=points.grid.by_panels(at.conservative),
        motor=points.grid.by_panels(closure.law(compressor.motor, scales.base, change)),
        loss=loss,
        speed=points.grid.by_panels(state.speed),
        energy=motion.energy,
        first_energy=motion.first_energy,
    )
    energy, slope, first = closure.improve(compressor.motor, course, slope_of_torque)
    # the equation of motion with the new energy, over the unit of accelerations
    counted, _ = floored_energy(course.inertia, scales, energy)
    acceleration = (slope - course.inertia_1 * counted / course.inertia) / course.inertia
    acceleration = acceleration / scales.speed**2
    better = Motion(energy, acceleration, first, joints, motion.reversals, journals)

    marks = jnp.zeros((0, *energy.shape))
    if rows:
        marks = jnp.stack([points.grid.by_panels(row) for row in rows])
    value = jnp.zeros_like(places)
    if places.size:
        at_places = jnp.stack([points.beyond(row) for row in rows])
        value = jnp.take_along_axis(at_places, maximum(reversals.row, 0)[None], axis=0)[0]
        if cut is None:
            # along the slope of the quantity to where it vanishes; unused ones wait at the first edge
            unused = jnp.where(reversals.moving, parameters.edges[0], places)
            used = reversals.moving & (reversals.row >= 0)
            # Not across a kink that is known: behind it the quantity has another slope, or has jumped,
            # and the place would hop to and fro. Beside it an edge is as good as at the reversal.
            followed = clip(places - value / reversals.slope, reversals.low, reversals.high)
            moved = jnp.where(used, followed, unused)
            better = _carried(parameters, resolution, grid, (places, moved), better)
    return better, marks, value


def _improved_contacts(
    parameters: OrbitParameters,
    compressor: Compressor,
    points: _Points,
    at: Instants,
    state,
    motion: Motion,
):
    """Better joints and positions of journals, losses [N m] at the nodes, and marks of reversals.

    Args:
        parameters: what the solution depends on.
        compressor: its compressor, with journals that move at their positions.
        points: where the motion is known.
        at: what the angle decides there.
        state: angle, speed and acceleration there.
        motion: of the last iteration.
    """
    if compressor.frictionless:
        return motion.joints, motion.journals, jnp.zeros_like(motion.energy), ()
    loop = loop_of(compressor, state, at.gas_force, at.kinematics)
    joints, loss, rows = _improved_joints(loop, parameters.scales, motion.joints)
    loss = points.grid.by_panels(loss)
    journals = motion.journals
    if journals is not None:
        forces = loop.loads(joints_of(loop, parameters.scales, motion.joints), False).forces
        drive = journal_drive(parameters.compressor, forces, state).mapped(points.grid.by_panels)
        journals, power = improved_positions(points.grid, drive, motion.journals)
        at_nodes = jax.tree.map(points.grid.by_panels, state)
        loss += journal_torque(parameters.compressor, at_nodes, motion.journals, power)
    return joints, journals, loss, rows


def _carried(
    parameters: OrbitParameters, resolution: Resolution, grid: Panels, places, motion: Motion
) -> Motion:
    """A motion carried along its panel polynomials to where the places, before and after, move the nodes.

    To first order, which keeps the quantities that mark the reversals up with the places: these then
    converge as fast as the motion does.
    """
    before, after = places

    def angles(places):
        return resolution.panels_between(parameters.edges, places).angle

    _, shift = jax.jvp(angles, (before,), (after - before,))
    width = grid.width[:, None]
    wide = width > NO_WIDTH
    share = jnp.where(wide, shift / jnp.where(wide, width, 1.0), 0.0)
    values = jnp.stack([motion.energy, motion.acceleration])
    if motion.journals is not None:
        values = jnp.concatenate([values, motion.journals.reshape(-1, *shift.shape)])
    energy, acceleration, *components = values + share * (values @ grid.rule.derivative.T)
    journals = motion.journals
    if journals is not None:
        journals = jnp.stack(components).reshape(journals.shape)
    return Motion(
        energy, acceleration, motion.first_energy, motion.joints, after / PLACE_UNIT, journals
    )
