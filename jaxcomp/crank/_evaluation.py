"""The orbit of a solved motion: its joint forces, its energy account and the errors of both."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import max_of, maximum, min_of
from .._core.roots import FixedPointReport, frozen
from .._core.status import Status
from ..compressor import Instants, instants, loop_of
from ..friction import JointLoads
from ._crank_motion import Course, closure_of
from ._iteration import (
    ENERGY_FLOOR,
    Motion,
    OrbitParameters,
    Resolution,
    floored_energy,
    joints_of,
    state_of,
    steepness,
)
from ._journals import by_joint, journal_drive, orbit_status, with_journals
from ._orbit import Energy, Orbit
from ._panels import Panels, farthest, highest, panels

# [-] Change of the duration of a revolution with twice the nodes beyond which it counts as not
# resolved. Ordinary ones stay below 1e-5 with 8 nodes on a panel, and below 1e-4 with 5.
_PERIOD_ERROR = 1e-3
# A quadrature over a kink may be off by several times what twice the nodes change.
_SAFETY = 5.0


def orbit_of_motion(
    parameters: OrbitParameters,
    resolution: Resolution,
    motion: Motion,
    report: FixedPointReport,
    solver: str,
    estimate: bool = True,
) -> Orbit:
    """Forces, accounts and evidence of a motion.

    Everything is evaluated at the nodes and, if `estimate`, without derivatives at twice as many on
    every panel, which tell the error.
    """
    compressor = parameters.compressor
    scales = parameters.scales
    closure = closure_of(compressor.motor)
    grid = resolution.panels_between(parameters.edges, motion.places)
    fine = None
    if estimate:
        fine = panels(lax.stop_gradient(grid.edges), 2 * resolution.nodes)
    grids = _Grids(grid, fine)

    # at all nodes: the state of the crank, and what its joints carry and lose
    at = instants(compressor, grids.angle)
    energy = grids.row(motion.energy)
    acceleration = grids.row(motion.acceleration)
    state, change = state_of(at, scales, energy, acceleration)
    if motion.journals is not None:
        compressor = with_journals(compressor, grids.row(motion.journals))
    loop = loop_of(compressor, state, at.gas_force, at.kinematics)
    unknown = None
    joints = loop.loops.start()
    if not compressor.frictionless:
        # the unknowns at the nodes; those at the places are not needed any more
        unknown = grids.row(grid.by_panels(motion.joints))
        joints = joints_of(loop, scales, unknown)
    loads = loop.loads(joints, True)
    law = closure.law(compressor.motor, scales.base, change)

    def course_on(grid, of_panels):
        return Course(
            grid=grid,
            speed_scale=scales.speed,
            energy_scale=scales.energy,
            base=scales.base,
            inertia=of_panels(at.inertia),
            inertia_1=of_panels(at.inertia_1),
            conservative=of_panels(at.conservative),
            motor=of_panels(law),
            loss=of_panels(loads.total_loss_torque),
            speed=of_panels(state.speed),
            energy=of_panels(energy),
            first_energy=motion.first_energy,
        )

    course = course_on(grid, grid.by_panels)
    finer_course = None
    if fine is not None:
        finer_course = course_on(fine, grids.finer)
    growth = None
    if closure.needs_steepness:
        rates = steepness(*frozen((compressor, at, scales, energy, acceleration, unknown)))
        growth = grid.total(grid.by_panels(rates))
    status = _status(parameters, at, energy, course, finer_course, growth, report)

    motor = closure.torque(course)
    totals = _by_loss(loads, lambda losses: grid.total(grid.by_panels(losses)))
    # not the negative, which would be -0 without gas
    account = Energy(grid.total(motor), 0.0 - grid.total(course.conservative), totals)
    error = dict.fromkeys(totals, jnp.full((), jnp.nan))
    gas_error = jnp.full((), jnp.nan)
    if finer_course is not None:
        gas_error = _quadrature_error(grids, at.conservative)
        # The error of the motion: the kinetic energy that the torques at the finer nodes add to it. All
        # losses grow with it as the inertia forces do; a small one may, where they nearly cancel the gas
        # force, change by as much as the large ones.
        moved = _energy_error(closure, finer_course, grids.finer(state.acceleration), growth)
        moved *= 2 * lax.stop_gradient(account.total_loss)
        error = _by_loss(loads, lambda losses: _quadrature_error(grids, losses) + moved)

    at, state, loads = jax.tree.map(grid.by_panels, (at, state, loads))
    if motion.journals is not None:
        drive = journal_drive(parameters.compressor, loads.forces, state)
        status = orbit_status(grid.rule, drive, motion.journals, status)
    return orbit_on_panels(
        grid=grid,
        at=at,
        state=state,
        motor_torque=motor,
        loads=loads,
        energy=account,
        loss_error=error,
        status=status,
        report=report,
        solver=solver,
        positions=by_joint(parameters.compressor, motion.journals),
        gas_work_error=gas_error,
    )


def _status(
    parameters: OrbitParameters,
    at: Instants,
    energy,
    course: Course,
    finer: Course | None,
    growth,
    report,
) -> Status:
    """Status of the motion: converged, resolved, as its motor says, and never at a halt."""
    period = course.grid.total(1 / course.speed)
    status = Status.where(report.settled, Status.converged, Status.not_converged)
    if finer is not None:
        resolved = jnp.abs(finer.grid.total(1 / finer.speed) - period) < _PERIOD_ERROR * period
        status = Status.where(report.settled & ~resolved, Status.unresolved, status)
    motor = parameters.compressor.motor
    scales = parameters.scales
    status = closure_of(motor).verdict(motor, period, growth, status)
    _, total_energy = floored_energy(at.inertia, scales, energy)
    floored = min_of(total_energy) <= 2 * ENERGY_FLOOR * scales.energy
    return Status.where(floored, Status.stalled, status)


class _Grids(NamedTuple):
    """The nodes of the panels, and twice as many, which tell the error: evaluated in one row."""

    grid: Panels
    fine: Panels | None  # without derivatives; `None` without an estimate

    @property
    def angle(self) -> Float[Array, " r"]:
        """[rad] In the row."""
        grids = [self.grid]
        if self.fine is not None:
            grids.append(self.fine)
        return jnp.concatenate([grid.angle.ravel() for grid in grids])

    def row(self, values: Float[Array, "*m p s"]) -> Float[Array, "*m r"]:
        """Values at the nodes and, by their polynomials, at the finer ones."""
        parts = [values]
        if self.fine is not None:
            through = self.grid.rule.through(self.fine.rule.nodes).T
            parts.append(lax.stop_gradient(values @ through))
        return jnp.concatenate([x.reshape(*x.shape[:-2], -1) for x in parts], axis=-1)

    def finer(self, row: Float[Array, "*m r"]) -> Float[Array, "*m p f"]:
        """Part of a row that belongs to the finer nodes, by panels and without derivatives."""
        assert self.fine is not None
        return lax.stop_gradient(self.fine.by_panels(row[..., self.grid.angle.size :]))


def _energy_error(closure, course: Course, acceleration, growth) -> Float[Array, ""]:
    """[-] Error of the kinetic energy over its mean, by the torques at twice the nodes."""
    slope = course.inertia * acceleration + 0.5 * course.inertia_1 * course.speed**2
    gained, at_edges = course.grid.cumulative(
        closure.torque(course) + course.conservative - course.loss - slope
    )
    # A constant shift is left out here: the level belongs to the closure, see below.
    mean = course.grid.total(gained) / (2 * jnp.pi)
    error = course.grid.total(jnp.abs(gained - mean)) / (2 * jnp.pi)
    # the level of the speed follows from the torques, if these know the speed
    if growth is not None:
        level = at_edges[-1] / jnp.where(growth == 0, 1.0, lax.stop_gradient(growth))
        error += jnp.abs(level)
    return error / jnp.mean(0.5 * course.inertia * course.speed**2)


def _quadrature_error(grids: _Grids, row: Float[Array, "*j r"]) -> Float[Array, "*j"]:
    """Estimated error of an integral over the revolution, from its integrand at both sets of nodes.

    Panel by panel the larger of two estimates, so that neither errors of opposite sign nor a kink for
    which both rules are wrong alike pass unseen: what twice the nodes change, and the last two Legendre
    coefficients at twice the nodes, behind which those begin that the quadrature mistakes for a mean.
    """
    grid = grids.grid
    fine = grids.fine
    assert fine is not None
    values = lax.stop_gradient(grid.by_panels(row))
    finer = grids.finer(row)
    change = jnp.abs(finer @ fine.rule.weights - values @ grid.rule.weights)
    highest_terms = jnp.sum(jnp.abs(finer @ fine.rule.to_legendre[-2:].T), axis=-1)
    return jnp.sum(grid.width * maximum(_SAFETY * change, 2 * highest_terms), axis=-1)


def _by_loss(loads: JointLoads, function) -> dict[str, Float[Array, ""]]:
    """Values of a function for the losses (j, r) of all joints at once, by joint."""
    # one array, so that the program does not grow with the number of joints
    losses = loads.loss_torque
    if not losses:
        return {}
    return dict(zip(losses, function(jnp.stack([*losses.values()])), strict=True))


def orbit_on_panels(
    grid: Panels,
    at: Instants,
    state,
    motor_torque,
    loads,
    energy: Energy,
    loss_error: dict[str, Float[Array, ""]],
    status,
    report: FixedPointReport,
    solver: str,
    positions: dict[str, Float[Array, "2 n"]] | None = None,
    gas_work_error: Float[Array, ""] | None = None,
) -> Orbit:
    """Flatten panels to one row of nodes and add time and the extremes of speed.

    Args:
        grid: panels of the revolution with their nodes.
        at: what the crank angle decides at the nodes, (panels, nodes) each.
        state: angle, speed and acceleration at the nodes.
        motor_torque: [N m] at the nodes.
        loads: joint loads at the nodes.
        energy: balance of the revolution.
        loss_error: [J] estimated error of the losses, by joint.
        status: how the solver ended.
        report: residual and iterations of the solver.
        solver: its name.
        positions: [-] of the journals that move.
        gas_work_error: [J] estimated, of the gas work.
    """
    elapsed, at_edges = grid.cumulative(1 / state.speed)
    # of the polynomials, since the nodes miss the extremes that lie at kinks, on the edges of panels
    find = jax.vmap(partial(highest, grid.rule, grid.width))
    extremes = find(jnp.stack([-state.speed, state.speed]))

    forces = jnp.stack(list(loads.forces.values()))
    peaks = jax.vmap(partial(farthest, grid.rule, grid.width))(forces)
    terms = jnp.abs(lax.stop_gradient(forces) @ grid.rule.to_legendre.T)
    error = max_of(jnp.hypot(*jnp.moveaxis(terms[..., -2] + terms[..., -1], 1, 0)), axis=-1)

    def flat(values):
        # sizes in full: a mechanism may have no near-zero loads, and -1 has no meaning then
        return values.reshape(*values.shape[:-2], values.shape[-2] * values.shape[-1])

    return Orbit(
        state=jax.tree.map(flat, state),
        weight=flat(grid.weight),
        time=flat(elapsed),
        pressure=None if at.pressure is None else flat(at.pressure),
        gas_torque=flat(at.conservative),
        motor_torque=flat(motor_torque),
        loads=jax.tree.map(flat, loads),
        energy=energy,
        loss_error=loss_error,
        peak_forces=dict(zip(loads.forces, peaks, strict=True)),
        peak_error=dict(zip(loads.forces, error, strict=True)),
        mean_speed=2 * jnp.pi / at_edges[-1],
        lowest_speed=-extremes[0],
        highest_speed=extremes[1],
        status=status,
        residual=report.change,
        resolution=_resolution(grid, lax.stop_gradient(state.speed)),
        iterations=report.steps,
        solver=solver,
        panel_nodes=grid.rule.nodes.size,
        positions=positions,
        gas_work_error=gas_work_error,
    )


def _resolution(grid: Panels, speed: Float[Array, "p s"]) -> Float[Array, ""]:
    terms = jnp.abs(speed @ grid.rule.to_legendre.T)
    swing = max_of(speed) - min_of(speed)
    # a swing below a millionth of the speed is of no interest, and ends in rounding
    return max_of(terms[:, -2] + terms[:, -1]) / (swing + 1e-6 * max_of(speed))
