r"""Periodic orbit by shooting with diffrax over crank angle.

The state is speed, time and the energy accounts, and the positions of journals that move;
$d\omega/d\theta = \alpha/\omega$. Newton's method finds the speed and the positions at the top dead
centre (and the level of the motor torque, if the mean speed is given) for which a revolution ends as it
began. At a given speed the motor gives what keeps it. Steps end at the kinks that are known beforehand.

Derivatives follow from the implicit function theorem: one more integration, differentiable, gives the
parameter dependence of the periodicity condition, and its known Jacobian gives that of the unknowns.
"""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import clip, max_of, maximum, min_of
from .._core.roots import AbstractRoot, FixedPointReport, frozen, root, zeros_of
from .._core.status import Status
from ..compressor import Compressor, instants, kink_angles, loads_at
from ..cylinder import CycleOptions
from ..mechanism import CrankState
from ._collocation import Collocation, default_cycle
from ._crank_motion import closure_of, motion_at
from ._evaluation import orbit_on_panels
from ._integration import inside_panels, rates_over_angle
from ._iteration import OrbitParameters, prepare, revolution_edges
from ._journals import by_joint, journal_drive, orbit_status, orbiting_journals, with_journals
from ._orbit import Energy, Orbit
from ._panels import panels

# [rad] Distance of a step's end from a load reversal, more than the error of its place. Derivatives
# err by about as much: the one step across the change takes its sides at random.
_BESIDE = 2e-7
# Nodes of the solution that gives the places. With 8, and of a machine with six near-zero loads with 16,
# they err by more than that on machines with offset and weights: a long step then began on the wrong
# side, and derivatives were 7e-4 and 2e-3 off.
_PLACING = 32
# Stops on either side of a load minimum, at 0.1 rad and closing in by 0.15 each: the last at 8e-6 rad. On
# the machine of Tsuji et al. the load of the piston pin turns round within 6e-5 rad.
_CLOSING = 6

# [-] Gap reported of a revolution that could not be integrated.
_LOST = 1e6


class Shooting(eqx.Module):
    """Options of the shooting solver.

    Attributes:
        solver: any solver of diffrax.
        tolerance: [-] wanted of the energy closure of the revolution. A step is allowed a thousandth of
            it, in units of the mean speed, of the period and of the mean kinetic energy: places
            where a load changes its side are met unprepared, and there the error estimate of a step
            is too hopeful. Derivatives converge after the values; measured on the machine of Tsuji et
            al. with offset and weights, as worst relative error of an elasticity: 2e-4 at the
            default, 1e-7 with `Shooting(diffrax.Dopri8(), 1e-9)`. Given as an array, all tolerances
            share one compiled program.
        adjoint: how diffrax differentiates a revolution; the default serves reverse mode,
            `diffrax.ForwardMode()` serves forward mode.
        reversals: how many load reversals in mid-stroke the steps avoid to cross; 0 looks for none.
        max_newton: Newton steps on the periodicity condition.
        max_steps: steps of one revolution.
        output_nodes: nodes on every panel at which forces and speed are reported.
        cycle: how the cycle of a gas with valves is solved.
    """

    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    tolerance: float | Float[Array, ""] = 1e-7
    adjoint: diffrax.AbstractAdjoint = eqx.field(default_factory=diffrax.RecursiveCheckpointAdjoint)
    reversals: int = eqx.field(static=True, default=4)
    max_newton: int = eqx.field(static=True, default=12)
    max_steps: int = eqx.field(static=True, default=4096)
    output_nodes: int = eqx.field(static=True, default=12)
    cycle: CycleOptions = eqx.field(default_factory=default_cycle)

    name: ClassVar[str] = "shooting"

    @property
    def step_tolerance(self) -> float | Float[Array, ""]:
        """[-] Relative tolerance of the time steps, tighter than that of the orbit."""
        return 1e-3 * self.tolerance

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        closure = closure_of(compressor.motor)
        machine = frozen(compressor)
        fixed = self._prepared(machine)
        first = jnp.ones(2 if closure.level_is_unknown else 1)
        if not closure.integrates:
            first *= machine.motor.speed_guess / fixed.speed
        # journals begin in the middle of their films
        first = jnp.concatenate([first, jnp.zeros(2 * len(orbiting_journals(machine)))])
        shot, steps = self._newton(machine, fixed, first)
        result = root(_Following(compressor, shot, fixed, self))
        unknowns, end, _ = result
        gap_size = max_of(jnp.abs(lax.stop_gradient(_gap_at(end, unknowns, compressor, fixed))))
        gap_size = jnp.where(jnp.isfinite(gap_size), gap_size, _LOST)
        _, end, course = jax.tree.map(lambda x: jnp.where(jnp.isfinite(x), x, 1.0), result)
        settled = gap_size <= 3 * self.tolerance
        report = FixedPointReport(steps, gap_size, settled)
        status = Status.where(settled, Status.converged, Status.not_converged)
        if closure.integrates and not closure.level_is_unknown:
            unstable = shot.jacobian[0, 0] >= 0
            status = Status.where(settled & unstable, Status.no_periodic_state, status)
        return self._orbit(compressor, unknowns, fixed, end, course, status, report)

    def solved(self, compressor: Compressor, solution: None = None) -> tuple[Orbit, None]:
        """The orbit; it keeps no unknowns that a later call could follow, see `Collocation.solved`."""
        return self.solve(compressor), None

    def _prepared(self, machine: Compressor) -> "_Fixed":
        """Scales, stops and panels of a machine without derivatives."""
        edges = revolution_edges(kink_angles(machine))
        parameters = prepare(machine, edges)
        # Constant speed gives the level of torque from which Newton's method starts.
        grid = panels(edges, 8)
        at = instants(machine, grid.angle)
        speed = jnp.full_like(at.angle, parameters.scales.speed)
        state = CrankState(at.angle, speed, jnp.zeros_like(speed))
        centred = None
        journals = len(orbiting_journals(machine))
        if journals:
            centred = jnp.zeros((2, journals, *speed.shape))
        loads = loads_at(with_journals(machine, centred), state, at.gas_force, False)
        net = grid.total(loads.total_loss_torque - at.conservative)
        level = jnp.ones(())
        if closure_of(machine.motor).level_is_unknown:
            level = net / grid.total(machine.motor.torque(speed))
        return _Fixed(
            parameters.scales.speed,
            parameters.scales.energy,
            level,
            edges,
            *self._stops(machine, parameters),
        )

    def _stops(self, machine: Compressor, parameters: OrbitParameters):
        """Where steps end, and the edges of the panels on which the result is reported.

        Steps end at the known kinks, beside each load reversal, and closing in on near-zero loads.

        A step that ended on a reversal itself would pick a side at random, and its derivative with it.
        Near a load of almost zero the derivatives of its magnitude turn round within an angle so short
        that the step control, which watches values only, would step over it. Only the places come from
        the collocation solver; the solution does not.
        """
        edges = parameters.edges
        if machine.frictionless or not self.reversals:
            return edges[1:-1], edges
        problem = Collocation(_PLACING, self.reversals).problem(machine)
        motion, (reversals, _) = problem.solve(parameters)
        kinks, minima = jnp.split(motion.places, 2)
        sides = jnp.array([-_BESIDE, _BESIDE])
        closing = 0.1 * 0.15 ** jnp.arange(_CLOSING)
        around = jnp.concatenate([-closing, closing])
        used = reversals.row[:, None] >= 0
        near_kinks = jnp.where(used[: self.reversals], kinks[:, None] + sides, edges[1])
        near_minima = jnp.where(used[self.reversals :], minima[:, None] + around, edges[1])
        stops = jnp.concatenate([edges[1:-1], *map(jnp.ravel, (near_kinks, near_minima))])
        inside = (stops > edges[0]) & (stops < edges[-1])
        places = clip(motion.places, edges[0], edges[-1])
        return (
            jnp.sort(jnp.where(inside, stops, edges[1])),
            jnp.sort(jnp.concatenate([edges, places])),
        )

    def _newton(self, machine: Compressor, fixed: "_Fixed", start) -> tuple["_Shot", Any]:
        """Newton's method on the periodicity condition, over one integration that does all.

        The integration gives the accounts and the speed as well, and the dependence of everything on
        the unknowns.
        """
        eye = jnp.eye(start.size)

        def going_on(carry):
            _, _, size, steps = carry
            return (size > 0.3 * self.tolerance) & (steps < self.max_newton)

        def advance(carry):
            unknowns, _, _, steps = carry
            ((end, course), (end_slope, course_slope)), step_ends = self.march(
                machine, unknowns, fixed, diffrax.ForwardMode(), slopes=True
            )
            result = (unknowns, end, course)
            by_unknowns = (eye, end_slope, course_slope)
            gap, jacobian = _along(
                lambda end, unknowns: _gap_at(end, unknowns, machine, fixed),
                (end, unknowns),
                (end_slope, eye),
            )
            step = jnp.linalg.solve(jacobian, gap)
            # A revolution that could not be integrated has no step to offer; the gap reports it.
            lost = ~jnp.all(jnp.isfinite(step))
            jacobian = jnp.where(lost, eye, jacobian)
            # a long step may reach a halt; half the speed at a time is far enough
            step = jnp.where(lost, 0.0, clip(step, -0.5, 0.5))
            # the last step is so short that everything follows it linearly
            result = jax.tree.map(lambda x, slope: x - slope @ step, result, by_unknowns)
            shot = _Shot(result, by_unknowns, jacobian, step_ends)
            return unknowns - step, shot, max_of(jnp.abs(step)), steps + 1

        begin = _at_rest(machine, start, fixed)
        count = self._nodes(fixed).size
        course = jax.tree.map(lambda x: jnp.zeros((count, *x.shape)), _reported(begin))
        no_result = start, begin, course
        slopes = jax.tree.map(lambda x: jnp.zeros((*x.shape, start.size)), no_result)
        # as the record is behind its last step
        no_steps = jnp.full(self.max_steps, jnp.inf)
        no_shot = _Shot(no_result, slopes, eye, no_steps)
        carry = (start, no_shot, jnp.asarray(jnp.inf), jnp.asarray(0))
        _, shot, _, steps = lax.while_loop(going_on, advance, carry)
        return lax.stop_gradient(shot), steps

    def _nodes(self, fixed: "_Fixed"):
        """[rad] Where the speed is reported."""
        return panels(fixed.places, self.output_nodes).angle.ravel()

    def march(
        self,
        machine: Compressor,
        unknowns,
        fixed: "_Fixed",
        adjoint: diffrax.AbstractAdjoint,
        slopes: bool = False,
        step_ends: Float[Array, " m"] | None = None,
    ):
        """Integrate one revolution.

        Args:
            machine: without journals' places.
            unknowns: speed at the beginning, level of the torque, positions of journals.
            fixed: what follows no parameter.
            adjoint: how it is differentiated.
            slopes: whether the same steps integrate as well how everything changes with the unknowns,
                (..., u).
            step_ends: [rad] where steps end; by default where the error asks for it.

        Returns:
            The state at the end with speed and positions at the panels' nodes, a pair of both with their
            slopes if `slopes`; and where steps ended, (m,), infinite behind the last one.
        """
        y0 = _at_rest(machine, unknowns, fixed)
        if slopes:
            y0 = y0, jax.jacfwd(lambda unknowns: _at_rest(machine, unknowns, fixed))(unknowns)

        def reported(t, y, args):
            if slopes:
                return tuple(map(_reported, y))
            return _reported(y)

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(_rate_and_slopes if slopes else _rate),
            self.solver,
            t0=fixed.edges[0],
            t1=fixed.edges[-1],
            dt0=0.01,
            y0=y0,
            args=(machine, unknowns, fixed, revolution_edges(kink_angles(machine))),
            saveat=diffrax.SaveAt(
                subs=[
                    diffrax.SubSaveAt(t1=True),
                    diffrax.SubSaveAt(ts=self._nodes(fixed), fn=reported),
                    diffrax.SubSaveAt(steps=True, fn=lambda t, y, args: None),
                ]
            ),
            stepsize_controller=self._step_control(fixed, slopes, step_ends),
            max_steps=self.max_steps,
            adjoint=adjoint,
            throw=False,
        )
        assert solution.ys is not None
        assert solution.ts is not None
        end, at_nodes, _ = solution.ys
        end = jax.tree.map(lambda x: x[-1], end)
        marched = end, at_nodes
        if slopes:
            marched = tuple(zip(end, at_nodes, strict=True))
        return marched, solution.ts[-1]

    def _step_control(self, fixed: "_Fixed", slopes: bool, step_ends):
        """Steps by their error, or steps with given ends."""
        if step_ends is None:
            by_error = diffrax.PIDController(
                rtol=self.step_tolerance,
                atol=self.step_tolerance,
                # by the state alone, so that the values are those of a march without slopes
                norm=lambda y: optimistix.rms_norm(y[0] if slopes else y),
            )
            return diffrax.ClipStepSizeController(by_error, jump_ts=fixed.stops)
        # A revolution at a time, whatever the error: every step goes to the next of the ends.
        revolution = diffrax.PIDController(rtol=1.0, atol=1.0, dtmin=2 * jnp.pi)
        # diffrax tells of a step that ends at a jump where the next one begins, just behind the jump.
        at_jump = jnp.isin(step_ends, jnp.nextafter(fixed.stops, jnp.inf))
        between = jnp.where(at_jump, jnp.inf, step_ends)
        return diffrax.ClipStepSizeController(revolution, step_ts=between, jump_ts=fixed.stops)

    def _orbit(self, compressor, unknowns, fixed: "_Fixed", end, course, status, report) -> Orbit:
        edges = revolution_edges(kink_angles(compressor))
        grid = panels(jnp.interp(fixed.places, fixed.edges, edges), self.output_nodes)
        speed = maximum(course["speed"].reshape(grid.angle.shape), 1e-3) * fixed.speed
        places = None
        if "journals" in course:
            places = grid.by_panels(jnp.moveaxis(course["journals"], 0, -1))
        machine = with_journals(compressor, places)
        motion, motor = _motion(machine, grid.angle, speed, unknowns, fixed, evidence=True)
        state = CrankState(grid.angle, speed, motion.acceleration)
        work = jax.tree.map(lambda w: w * fixed.energy, end["work"])
        energy = Energy(work["motor"], work["gas"], work["losses"])
        # Close to self-locking the steps to acceleration and joint forces may be too few.
        lost = ~(jnp.abs(energy.residual) <= 10 * self.tolerance)
        status = Status.where(lost & (status == Status.converged), Status.not_converged, status)
        stalled = min_of(speed) <= 2e-3 * fixed.speed
        status = Status.where(stalled, Status.stalled, status)
        if places is not None:
            drive = journal_drive(compressor, motion.loads.forces, state)
            status = orbit_status(grid.rule, drive, places, status)
        # which of the losses an open balance belongs to is not known: it may be all of any
        open_ = lax.stop_gradient(jnp.abs(energy.motor_work - energy.gas_work - energy.total_loss))
        orbit = orbit_on_panels(
            grid=grid,
            at=motion.at,
            state=state,
            motor_torque=motor,
            loads=motion.loads,
            energy=energy,
            loss_error=dict.fromkeys(energy.losses, open_),
            status=status,
            report=report,
            solver=self.name,
            positions=by_joint(compressor, places),
        )
        # the integrated time is exact to the tolerance of a step, the quadrature of its nodes is not
        return eqx.tree_at(lambda o: o.mean_speed, orbit, fixed.speed / end["time"])


class _Fixed(NamedTuple):
    """Quantities that do not follow the parameters in derivatives."""

    speed: Float[Array, ""]  # [rad/s] scale
    energy: Float[Array, ""]  # [J] scale
    level: Float[Array, ""]  # [-] scale of the motor torque
    edges: Float[Array, " k"]  # [rad] of the revolution, at known kinks
    stops: Float[Array, " s"]  # [rad] where steps end
    places: Float[Array, " p"]  # [rad] edges of the panels of the result


class _Shot(NamedTuple):
    """A revolution that ends as it began."""

    result: Any  # unknowns, state at the end, speed and positions at the nodes
    by_unknowns: Any  # derivatives of the result over the unknowns
    jacobian: Float[Array, "u u"]  # of the periodicity condition over the unknowns
    step_ends: Float[Array, " m"]  # [rad] of the integration, infinite behind the last one


def _at_rest(machine, unknowns, fixed) -> dict[str, Any]:
    """Speed, positions, time and accounts at the beginning of a revolution."""
    y: dict[str, Any] = {"speed": unknowns[0], "time": jnp.zeros(())}
    if count := len(orbiting_journals(machine)):
        y["journals"] = unknowns[-2 * count :].reshape(2, count)
    args = machine, unknowns, fixed, jnp.zeros_like(fixed.edges)
    return y | {"work": zeros_of(_rate, fixed.edges[0], y, args)["work"]}


def _along(function, values, slopes):
    """Values of a function, and their change with the unknowns that the last axis of `slopes` counts."""
    value, change = jax.linearize(function, *values)
    return value, jax.vmap(change, -1, -1)(*slopes)


@eqx.filter_jit
def _rate_and_slopes(place, y, args):
    machine, unknowns, fixed, edges = args
    values, slopes = y

    def rate(values, unknowns):
        return _rate(place, values, (machine, unknowns, fixed, edges))

    return _along(rate, (values, unknowns), (slopes, jnp.eye(unknowns.size)))


@eqx.filter_jit  # of one program, so that its stages, derivatives and batches trace it once
def _rate(place, y, args):
    """Change of the state with the place in the fixed turn."""
    machine, unknowns, fixed, edges = args
    # Where the torque jumps, at the dead centre of an offset machine, the derivative needs the motion of
    # the jump: the integration runs between fixed edges, the crank between those of the machine. The
    # values of both are the same.
    branch, stretch = inside_panels(fixed.edges, place, edges)
    # A halt is reported by the end values; the floor keeps them finite.
    speed = maximum(y["speed"], 1e-3) * fixed.speed
    places = y.get("journals")
    motion, motor = _motion(with_journals(machine, places), branch, speed, unknowns, fixed)
    torques = {"motor": motor, "gas": -motion.at.conservative, "losses": motion.loads.loss_torque}
    units = fixed.speed, fixed.energy
    rates = rates_over_angle(machine, motion, speed, torques, places, units)
    # In revolutions at the scale of the speed: it ends near one, of the size of the other unknowns.
    rates["time"] = rates["time"] / (2 * jnp.pi)
    return jax.tree.map(lambda x: x * stretch, rates)


def _reported(y):
    """Quantities that are wanted at the nodes."""
    return {name: y[name] for name in ("speed", "journals") if name in y}


def _motion(machine, angle, speed, unknowns, fixed: "_Fixed", evidence=False):
    """The motion at instants, and the torque [N m] of the motor."""
    closure = closure_of(machine.motor)
    motor = machine.motor.torque(speed) if closure.integrates else jnp.zeros_like(speed)
    if closure.level_is_unknown:
        motor = motor * unknowns[1] * fixed.level
    motion = motion_at(machine, angle, speed, motor, evidence)
    if not closure.integrates:  # the motor gives what keeps its speed
        at = motion.at
        losses = motion.loads.total_loss_torque
        motor = 0.5 * at.inertia_1 * speed**2 - at.conservative + losses
    return motion, motor


def _gap_at(end, unknowns, machine, fixed: _Fixed):
    """By how much a revolution misses its own beginning, and the mean speed if that is given."""
    closure = closure_of(machine.motor)
    if closure.integrates:
        gaps = [end["speed"] - unknowns[0]]
    else:
        gaps = [unknowns[0] - machine.motor.mean_speed / fixed.speed]
    if closure.level_is_unknown:
        gaps.append(end["time"] * machine.motor.mean_speed / fixed.speed - 1)
    gaps = jnp.stack(gaps)
    if "journals" in end:
        gaps = jnp.concatenate([gaps, end["journals"].ravel() - unknowns[gaps.size :]])
    return gaps


class _Following(AbstractRoot):
    """A shot that follows the machine; only a derivative asks for one more integration."""

    machine: Any
    shot: _Shot
    fixed: _Fixed
    options: Shooting

    def solve(self):
        return self.shot.result

    def residual(self, unknowns):
        start, end, course = unknowns
        # Reverse mode integrates pieces of the revolution again, in a program of its own, from states
        # between which it kept none. If the error chose their steps anew, its last digits would be
        # others, at tolerances near rounding so would be the steps, and pieces would not meet: slopes
        # erred by up to 9 %.
        marched, _ = self.options.march(
            self.machine, start, self.fixed, self.options.adjoint, step_ends=self.shot.step_ends
        )
        gap = _gap_at(marched[0], start, self.machine, self.fixed)
        return gap, *jax.tree.map(jnp.subtract, marched, (end, course))

    def newton_correction(self, unknowns, residual):
        gap, *moved = residual
        moved = (jnp.zeros_like(gap), *moved)
        follow = -jnp.linalg.solve(self.shot.jacobian, gap)
        return jax.tree.map(lambda m, slope: m + slope @ follow, moved, self.shot.by_unknowns)
