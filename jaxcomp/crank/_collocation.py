"""Periodic orbit by collocation on Gauss panels: the whole revolution at once.

The panels end at the kinks of the torques, so the error falls exponentially with the number of
nodes, apart from the places in mid-stroke where a load reverses: those are located on a first solution
and become panel edges as well, which move with the solution.
"""

from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.roots import FixedPointReport, fixed_point, frozen
from .._core.status import Status
from ..compressor import Compressor, Instants, instants, kink_angles, loop_of
from ..cylinder import CycleOptions, Cylinder
from ..friction import JointLoads
from ..friction.interface import magnitude
from ..mechanism import CrankState
from ._iteration import (
    ENERGY_FLOOR,
    Known,
    Motion,
    Resolution,
    floored_energy,
    joints_of,
    motor_steepness,
    prepare,
    revolution_edges,
    state_of,
    steepness,
)
from ._journals import FEWEST_PANELS, journal_drive, moving, orbit_status, with_journals
from ._motion import Instant, closure_of
from ._orbit import Energy, Orbit
from ._panels import Panels, highest, panels
from ._reversals import OrbitProblem

# [-] Change of the duration of a revolution with twice the nodes beyond which it counts as not
# resolved. Ordinary ones stay below 1e-5 with 8 nodes on a panel, and below 1e-4 with 5.
_PERIOD_ERROR = 1e-3
# Nodes on every panel and grading by default, by the number of cylinders up to those of all larger ones.
_OF_SEVERAL = {2: (8, 1), 3: (7, 1), 4: (6, 1), 5: (6, 0), 6: (6, 0), 7: (5, 0)}
# Tolerance by default with several cylinders: a change of 1e-10 leaves an error of 1e-12.
_SEVERAL = 1e-10
# Panels of several cylinders whose load reversals are not located. Of 32 machines with all numbers
# scattered by 5 %, the errors in efficiency are 5e-7, 5e-7 and 1e-6 in the middle for 2, 4 and 8
# cylinders and 9e-6 at most; with 24 panels of 12 nodes, which cost as much, 4e-7, 2e-6 and 2e-6, with
# 24 of 8 nodes 1e-6, 5e-6 and 4e-6.
_PANELS = 36
# [-] Width over that of another panel below which two edges count as one.
_COINCIDING = 0.02
# A quadrature over a kink may be off by several times what twice the nodes change.
_SAFETY = 5.0


def default_cycle() -> CycleOptions:
    """How the cycle is solved together with the crank: its panels are those of the crank as well."""
    return CycleOptions(panels=40, nodes=8)


class Collocation(eqx.Module):
    """Options of the collocation solver.

    Attributes:
        nodes: Gauss nodes on every panel.
        reversals: how many load reversals in mid-stroke may become panel edges; 0 looks for none.
        grading: how often the panels beside a vanishing pin load are cut again, towards it.
        tolerance: [-] change of the relative kinetic energy at which the iteration stops. Given as an
            array, all tolerances share one compiled program.
        max_iterations: iterations after which the result is marked as not converged.
        panel_count: how many panels the kinks that are known beforehand make, so that the cost does not
            depend on their number. Of more kinks those closest behind another are no edges: of several
            cylinders many coincide, and the error of a kink within a panel goes with the square of its
            distance from the edge. Between fewer kinks the widest panels are halved. `None`: every
            kink is an edge, and there are no others but where journals move, whose thin films need 24.
        estimate: whether everything is evaluated at twice the nodes as well, which tells `loss_error`;
            without, that is NaN, and an orbit of several cylinders takes three quarters of the time.
        follow: whether the load reversals follow the motion in the last iterations; else they stay
            where a motion good to 1e-8 has them, and no panels are cut anew. Derivatives follow them
            in any case.
        cycle: how the cycle of a gas with valves is solved.
    """

    nodes: int = eqx.field(static=True, default=8)
    reversals: int = eqx.field(static=True, default=4)
    grading: int = eqx.field(static=True, default=3)
    tolerance: float | Float[Array, ""] = 1e-13
    max_iterations: int = eqx.field(static=True, default=120)
    panel_count: int | None = eqx.field(static=True, default=None)
    estimate: bool = eqx.field(static=True, default=True)
    follow: bool = eqx.field(static=True, default=True)
    cycle: CycleOptions = eqx.field(default_factory=default_cycle)

    name: ClassVar[str] = "collocation"

    def problem(self, compressor: Compressor) -> OrbitProblem:
        """The fixed-point problem of a compressor."""
        reversals = 0 if compressor.frictionless else self.reversals
        resolution = Resolution(self.nodes, reversals, self.grading)
        return OrbitProblem(
            resolution,
            loop_kinks(compressor),
            self.tolerance,
            self.max_iterations,
            self.follow,
        )

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        problem = self.problem(compressor)
        kinks = kink_angles(compressor)
        count = self.panel_count
        if count is None and kinks.size < FEWEST_PANELS and moving(compressor):
            count = FEWEST_PANELS
        if count is not None:
            kinks = _of_count(kinks, count)
        known = prepare(compressor, revolution_edges(kinks))
        if self.panel_count is None and closure_of(compressor.motor).needs_steepness:
            known = _with_layers(known)
        if compressor.frictionless and not closure_of(compressor.motor).integrates:
            return _explicit_orbit(known, problem.resolution, self.name)
        motion, (_, report) = fixed_point(problem, known)
        return orbit_of_motion(known, problem.resolution, motion, report, self.name, self.estimate)


def default_collocation(compressor: Compressor) -> Collocation:
    """What `solve_orbit` takes if it is given no solver.

    The load reversals in mid-stroke are located. Of several cylinders every one is an edge for all, so
    that more cylinders have narrower panels, which need fewer nodes and no grading; and places that
    follow the motion in every iteration would cut them all anew. Where journals move, or the gas has
    valves, whose events are edges, those of several cylinders are not located: that leaves an error of
    1e-6 in efficiency, rarely 1e-5, and of 1e-3 of the largest in its relative derivatives.
    """
    count = compressor.crankshaft.count
    if count == 1:
        return Collocation(reversals=compressor.load_reversals)
    if isinstance(compressor.gas, Cylinder):
        return Collocation(reversals=0)
    if moving(compressor) or compressor.frictionless:
        return Collocation(reversals=0, panel_count=_PANELS)
    nodes, grading = _OF_SEVERAL[min(count, max(_OF_SEVERAL))]
    reversals = compressor.load_reversals
    return Collocation(nodes, reversals, grading, tolerance=_SEVERAL, follow=False)


def _with_layers(known: Known) -> Known:
    """With an edge behind every kink: there the slip of a stiff motor follows a jump of the load.

    It does so within an angle of one over the steepness. With a panel twice as wide the fluctuation of
    the speed is known as well as without jumps, to 3e-5; without, to 4e-3. Behind the jumps of a soft
    motor the panel has no width: a cut would make estimates smaller, and errors at load reversals not.
    Of several cylinders the panels are many, and none is added.
    """
    if known.compressor.crankshaft.count > 1:
        return known
    kinks, width = known.edges[:-1], jnp.diff(known.edges)
    # in much narrower panels the rounding of their angles would count
    layer = jnp.maximum(2 / jnp.maximum(motor_steepness(known), 1e-3), 1e-4)
    # continuous in the stiffness: wider with the layer, then narrower again
    layer = jnp.clip(jnp.minimum(layer, 0.75 * width - layer), 0.0, None)
    layer = jnp.where(layer < 1e-4, 0.0, layer)
    kinks = jnp.sort(jnp.concatenate([kinks, kinks + layer]))
    return eqx.tree_at(lambda k: k.edges, known, revolution_edges(kinks))


def _of_count(kinks: Float[Array, " k"], count: int) -> Float[Array, " count"]:
    """As many edges of panels as wanted, from the sorted kinks; see `Collocation`."""
    if count < kinks.size:
        # the first of them, and those that lie farthest behind the one before
        _, place = lax.top_k(lax.stop_gradient(jnp.diff(kinks)), count - 1)
        kinks = jnp.concatenate([kinks[:1], kinks[1 + jnp.sort(place)]])
    while kinks.size < count:
        kinks = jnp.sort(jnp.append(kinks, _halves(kinks, min(count - kinks.size, kinks.size))[0]))
    # edges that all but coincide serve better between others
    gap, place = lax.top_k(-lax.stop_gradient(jnp.diff(kinks)), count // 2)
    middle, width = _halves(kinks, count // 2)
    kept = kinks[1 + place]
    return jnp.sort(kinks.at[1 + place].set(jnp.where(-gap < _COINCIDING * width, middle, kept)))


def _halves(kinks: Float[Array, " k"], count: int):
    """[rad] Middle and width of the widest panels."""
    edges = revolution_edges(kinks)
    width, place = lax.top_k(lax.stop_gradient(jnp.diff(edges)), count)
    return 0.5 * (edges[place] + edges[place + 1]), width


def _explicit_orbit(known: Known, resolution: Resolution, solver: str) -> Orbit:
    """At a given speed without friction nothing is left to solve."""
    compressor = known.compressor
    grid = panels(known.edges, resolution.nodes)
    at = instants(compressor, grid.angle)
    speed = jnp.full_like(grid.angle, compressor.motor.speed_guess)
    state = CrankState(grid.angle, speed, jnp.zeros_like(speed))
    loop = loop_of(compressor, state, at.gas_force, at.kinematics)
    loads = loop.loads(loop.loops.start(), True)
    torque = 0.5 * at.inertia_1 * speed**2 - at.conservative
    # over a revolution at constant speed the inertia takes no work
    work = -grid.total(at.conservative)
    energy = Energy(work, work, {})
    report = FixedPointReport(jnp.asarray(0), jnp.zeros(()), jnp.asarray(True))
    status = Status.converged
    return orbit_on_panels(grid, at, state, torque, loads, energy, {}, status, report, solver)


def _energy_error(closure, now: Instant, acceleration, growth) -> Float[Array, ""]:
    """[-] Error of the kinetic energy over its mean, by the torques at twice the nodes."""
    slope = now.inertia * acceleration + 0.5 * now.inertia_1 * now.speed**2
    gained, at_edges = now.grid.cumulative(
        closure.torque(now) + now.conservative - now.loss - slope
    )
    mean = now.grid.total(gained) / (2 * jnp.pi)
    error = now.grid.total(jnp.abs(gained - mean)) / (2 * jnp.pi)
    # the level of the speed follows from the torques, if these know the speed
    if growth is not None:
        level = at_edges[-1] / jnp.where(growth == 0, 1.0, lax.stop_gradient(growth))
        error += jnp.abs(level)
    return error / jnp.mean(0.5 * now.inertia * now.speed**2)


def loop_kinks(compressor: Compressor) -> int:
    """How many of the quantities that mark load reversals are kinks."""
    zero = jnp.zeros(())
    still = CrankState(zero, zero, zero)
    gas = jnp.zeros(compressor.crankshaft.count)
    return eqx.filter_eval_shape(lambda c: loop_of(c, still, gas), compressor).kinks


class _Grids(NamedTuple):
    """The nodes of the panels, and twice as many, which tell the error: evaluated in one row."""

    grid: Panels
    fine: Panels | None  # without derivatives; `None` without an estimate

    @property
    def angle(self) -> Float[Array, " r"]:
        """[rad] In the row."""
        grids = [self.grid] if self.fine is None else [self.grid, self.fine]
        return jnp.concatenate([one.angle.ravel() for one in grids])

    def row(self, values: Float[Array, "*m p s"]) -> Float[Array, "*m r"]:
        """Values at the nodes and, by their polynomials, at the finer ones."""
        both = [values]
        if self.fine is not None:
            through = self.grid.rule.through(self.fine.rule.nodes).T
            both.append(lax.stop_gradient(values @ through))
        return jnp.concatenate([x.reshape(*x.shape[:-2], -1) for x in both], axis=-1)

    def finer(self, row: Float[Array, "*m r"]) -> Float[Array, "*m p f"]:
        """What of a row belongs to the finer nodes, by panels and without derivatives."""
        assert self.fine is not None
        return lax.stop_gradient(self.fine.by_panels(row[..., self.grid.angle.size :]))


def _quadrature_error(grids: _Grids, row: Float[Array, "*j r"]) -> Float[Array, "*j"]:
    """Estimated error of an integral over the revolution, from its integrand at both sets of nodes.

    Panel by panel the larger of two estimates, so that neither errors of opposite sign nor a kink for
    which both rules are wrong alike pass unseen: what twice the nodes change, and the last two Legendre
    coefficients at twice the nodes, behind which those begin that the quadrature mistakes for a mean.
    """
    grid, fine = grids.grid, grids.fine
    assert fine is not None
    values, finer = lax.stop_gradient(grid.by_panels(row)), grids.finer(row)
    change = jnp.abs(finer @ fine.rule.weights - values @ grid.rule.weights)
    last = jnp.sum(jnp.abs(finer @ fine.rule.to_legendre[-2:].T), axis=-1)
    return jnp.sum(grid.width * jnp.maximum(_SAFETY * change, 2 * last), axis=-1)


def orbit_of_motion(
    known: Known,
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
    compressor, scales = known.compressor, known.scales
    closure = closure_of(compressor.motor)
    grid = resolution.panels_between(known.edges, motion.places)
    fine = panels(lax.stop_gradient(grid.edges), 2 * resolution.nodes) if estimate else None
    grids = _Grids(grid, fine)

    at = instants(compressor, grids.angle)
    energy, acceleration = grids.row(motion.energy), grids.row(motion.acceleration)
    state, change = state_of(at, scales, energy, acceleration)
    if motion.journals is not None:
        compressor = with_journals(compressor, grids.row(motion.journals))
    loop = loop_of(compressor, state, at.gas_force, at.kinematics)
    unknown, joints = None, loop.loops.start()
    if not compressor.frictionless:
        # the unknowns at the nodes; those at the places are not needed any more
        unknown = grids.row(grid.by_panels(motion.joints))
        joints = joints_of(loop, scales, unknown)
    loads = loop.loads(joints, True)
    law = closure.law(compressor.motor, scales.base, change)
    known_at = (at.inertia, at.inertia_1, at.conservative, law, loads.total_loss_torque)

    def instant(grid, pick):
        values = (pick(value) for value in (*known_at, state.speed, energy))
        units = scales.speed, scales.energy, scales.base
        return Instant(grid, *units, *values, motion.first_energy)

    now = instant(grid, grid.by_panels)
    finer = None if fine is None else instant(fine, grids.finer)
    growth = None
    if closure.needs_steepness:
        known_now = (compressor, at, scales, energy, acceleration)
        rates = steepness(*frozen((*known_now, energy if unknown is None else unknown)))
        growth = grid.total(grid.by_panels(rates))
    status = _status(known, at, energy, now, finer, growth, report)

    motor = closure.torque(now)
    totals = _by_joint(loads, lambda losses: grid.total(grid.by_panels(losses)))
    account = Energy(grid.total(motor), -grid.total(now.conservative), totals)
    error = dict.fromkeys(totals, jnp.full((), jnp.nan))
    if finer is not None:
        # The error of the motion: the kinetic energy that the torques at the finer nodes add to it. All
        # losses grow with it as the inertia forces do; a small one may, where they nearly cancel the gas
        # force, change by as much as the large ones.
        moved = _energy_error(closure, finer, grids.finer(state.acceleration), growth)
        moved *= 2 * lax.stop_gradient(account.total_loss)
        error = _by_joint(loads, lambda losses: _quadrature_error(grids, losses) + moved)
    at, state, loads = jax.tree.map(grid.by_panels, (at, state, loads))
    positions = None
    if motion.journals is not None:
        flat = motion.journals.reshape(*motion.journals.shape[:2], -1)
        positions = {one.joint: flat[:, i] for i, one in enumerate(moving(known.compressor))}
        drive = journal_drive(known.compressor, loads.forces, state)
        status = orbit_status(grid.rule, drive, motion.journals, status)
    return orbit_on_panels(
        grid, at, state, motor, loads, account, error, status, report, solver, positions
    )


def _status(
    known: Known, at: Instants, energy, now: Instant, finer: Instant | None, growth, report
) -> Status:
    """How the motion counts: converged, resolved, as its motor says, and never at a halt."""
    period = now.grid.total(1 / now.speed)
    status = Status.where(report.settled, Status.converged, Status.not_converged)
    if finer is not None:
        resolved = jnp.abs(finer.grid.total(1 / finer.speed) - period) < _PERIOD_ERROR * period
        status = Status.where(report.settled & ~resolved, Status.unresolved, status)
    motor, scales = known.compressor.motor, known.scales
    status = closure_of(motor).verdict(motor, period, growth, status)
    _, whole = floored_energy(at.inertia, scales, energy)
    floored = jnp.min(whole) <= 2 * ENERGY_FLOOR * scales.energy
    return Status.where(floored, Status.stalled, status)


def _by_joint(loads: JointLoads, function) -> dict[str, Float[Array, ""]]:
    """What a function gives for the losses (j, r) of all joints at once, by joint."""
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
    """
    elapsed, at_edges = grid.cumulative(1 / state.speed)
    find = jax.vmap(partial(highest, grid.rule, grid.width))
    extremes = find(jnp.stack([-state.speed, state.speed]))

    sizes = magnitude(*jnp.stack(list(loads.forces.values()), axis=1))
    peaks = find(sizes)
    terms = jnp.abs(lax.stop_gradient(sizes) @ grid.rule.to_legendre.T)
    error = jnp.max(terms[..., -2] + terms[..., -1], axis=-1)

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
    )


def _resolution(grid: Panels, speed: Float[Array, "p s"]) -> Float[Array, ""]:
    terms = jnp.abs(speed @ grid.rule.to_legendre.T)
    swing = jnp.max(speed) - jnp.min(speed)
    # a swing below a millionth of the speed is of no interest, and ends in rounding
    return jnp.max(terms[:, -2] + terms[:, -1]) / (swing + 1e-6 * jnp.max(speed))
