r"""Periodic orbit by shooting with diffrax over crank angle.

The state is speed, time and the energy accounts; $d\omega/d\theta = \alpha/\omega$. Newton's method
finds the speed at the top dead centre (and the level of the motor torque, if the mean speed is given)
for which a turn ends as it began. Steps end at the kinks that are known beforehand.

Derivatives follow from the implicit function theorem: one more integration, differentiable, gives the
parameter dependence of the periodicity condition, and its known Jacobian gives that of the unknowns.
"""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._implicit import FixedPointReport
from .._status import Status
from ..compressor import Compressor, kink_angles, loads_at
from ..mechanism import CrankState
from ..motor import MeanSpeed
from ._changes import Resolution, place_changes
from ._motion import solve_acceleration
from ._orbit import Energy, Orbit
from ._panels import panels
from ._passes import initial_motion, lay_turn, motor_level, torques, turn_edges
from ._turn import orbit_on_panels

# [rad] Distance of a step's end from a change of side, more than the error of its place. Derivatives
# err by about as much: the one step across the change takes its sides at random.
_BESIDE = 2e-7
# Stops on either side of a pinch, at 0.1 rad and closing in by 0.15 each: the last at 8e-6 rad. On the
# machine of Tsuji et al. the load of the piston pin turns round within 6e-5 rad.
_CLOSING = 6

# [-] Gap reported of a turn that could not be integrated.
_LOST = 1e6


class Shooting(eqx.Module):
    """Options of the shooting solver.

    Attributes:
        solver: any explicit or implicit solver of diffrax.
        tolerance: [-] wanted of the energy closure of the turn. A step is allowed a thousandth of
            it, in units of the mean speed, of the period and of the mean kinetic energy: places
            where a load changes its side are met unprepared, and there the error estimate of a step
            is too hopeful. Derivatives converge after the values; measured on the machine of Tsuji et
            al. with offset and weights, as worst relative error of an elasticity: 2e-4 at the
            default, 1e-7 with `Shooting(diffrax.Dopri8(), 1e-9)`. Given as an array, all tolerances
            share one compiled program.
        adjoint: how diffrax differentiates a turn; the default serves reverse mode,
            `diffrax.ForwardMode()` serves forward mode.
        kinks: how many changes of side in mid-stroke the steps avoid to cross; 0 looks for none.
        max_newton: Newton steps on the periodicity condition.
        max_steps: steps of one turn.
        output_nodes: nodes on every panel at which forces and speed are reported.
    """

    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    tolerance: float | Float[Array, ""] = 1e-7
    adjoint: diffrax.AbstractAdjoint = eqx.field(default_factory=diffrax.RecursiveCheckpointAdjoint)
    kinks: int = eqx.field(static=True, default=4)
    max_newton: int = eqx.field(static=True, default=12)
    max_steps: int = eqx.field(static=True, default=4096)
    output_nodes: int = eqx.field(static=True, default=12)

    name: ClassVar[str] = "shooting"

    @property
    def step_tolerance(self) -> float | Float[Array, ""]:
        """[-] Relative tolerance of the time steps, tighter than that of the orbit."""
        return 1e-3 * self.tolerance

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        frozen = lax.stop_gradient(compressor)
        edges = lax.stop_gradient(turn_edges(kink_angles(compressor)))
        turn = lay_turn(frozen, edges, 8)
        # Constant speed gives the level of torque from which Newton's method starts.
        level = motor_level(turn, torques(frozen, turn, initial_motion(turn)))
        scales = (turn.speed_scale, turn.energy_scale, level)
        stops, places = self._stops(frozen, edges)
        start = jnp.ones(2 if isinstance(compressor.motor, MeanSpeed) else 1)

        fixed = (scales, edges, stops)

        root, jacobian, steps = self._newton(
            lambda unknowns: self._gap(unknowns, frozen, fixed, diffrax.ForwardMode()), start
        )
        unknowns = _follow_parameters(compressor, (root, jacobian, fixed), self)
        end, states = self._turn(compressor, unknowns, *fixed, places=places, adjoint=self.adjoint)
        gap_size = jnp.max(jnp.abs(lax.stop_gradient(_gap_at(end, unknowns, compressor, scales))))
        gap_size = jnp.where(jnp.isfinite(gap_size), gap_size, _LOST)
        end, states = jax.tree.map(lambda x: jnp.where(jnp.isfinite(x), x, 1.0), (end, states))
        settled = gap_size <= 3 * self.tolerance
        report = FixedPointReport(steps, gap_size, settled)
        status = Status.where(settled, Status.converged, Status.not_converged)
        unstable = (jacobian[0, 0] >= 0) & (not isinstance(compressor.motor, MeanSpeed))
        status = Status.where(settled & unstable, Status.no_periodic_state, status)
        return self._orbit(compressor, unknowns, scales, edges, places, end, states, status, report)

    def _stops(self, machine: Compressor, edges):
        """Where steps end, and the edges of the panels on which the result is reported.

        Steps end at the known kinks, beside each change of side, and closing in on pinches.

        A step that ended on a change itself would pick a side at random, and its derivative with it.
        Near a pinch the derivatives of a load turn round within an angle so short that the step
        control, which watches values only, would step over it. Only the places come from the
        collocation solver; the solution does not.
        """
        if machine.friction is None or not self.kinks:
            return edges[1:-1], edges
        changes, _, _ = place_changes(machine, Resolution(8, self.kinks, 3, 80))
        kinks, pinches = jnp.split(changes.angle, 2)
        beside = jnp.array([-_BESIDE, _BESIDE])
        closing = 0.1 * 0.15 ** jnp.arange(_CLOSING)
        around = jnp.concatenate([-closing, closing])
        used = changes.row[:, None] >= 0
        near_kinks = jnp.where(used[: self.kinks], kinks[:, None] + beside, edges[1])
        near_pinches = jnp.where(used[self.kinks :], pinches[:, None] + around, edges[1])
        stops = jnp.concatenate([edges[1:-1], *map(jnp.ravel, (near_kinks, near_pinches))])
        inside = (stops > edges[0]) & (stops < edges[-1])
        places = jnp.clip(changes.angle, edges[0], edges[-1])
        return (
            jnp.sort(jnp.where(inside, stops, edges[1])),
            jnp.sort(jnp.concatenate([edges, places])),
        )

    def _gap(self, unknowns, machine, fixed, adjoint):
        """By how much a turn misses its own beginning."""
        end, _ = self._turn(machine, unknowns, *fixed, adjoint=adjoint)
        return _gap_at(end, unknowns, machine, fixed[0])

    def _newton(self, gap, start):
        """Newton's method that hands out its Jacobian as well: the derivatives need it."""

        def value_twice(unknowns):
            value = gap(unknowns)
            return value, value

        def going_on(carry):
            _, _, size, steps = carry
            return (size > 0.3 * self.tolerance) & (steps < self.max_newton)

        def advance(carry):
            unknowns, _, _, steps = carry
            jacobian, value = jax.jacfwd(value_twice, has_aux=True)(unknowns)
            step = jnp.linalg.solve(jacobian, value)
            # A turn that could not be integrated has no step to offer; the gap reports it.
            lost = ~jnp.all(jnp.isfinite(step))
            jacobian = jnp.where(lost, jnp.eye(start.size), jacobian)
            # a long step may reach a halt; half the speed at a time is far enough
            step = jnp.where(lost, 0.0, jnp.clip(step, -0.5, 0.5))
            return unknowns - step, jacobian, jnp.max(jnp.abs(step)), steps + 1

        begin = (start, jnp.eye(start.size), jnp.asarray(jnp.inf), jnp.asarray(0))
        root, jacobian, _, steps = lax.while_loop(going_on, advance, begin)
        return lax.stop_gradient(root), lax.stop_gradient(jacobian), steps

    def _turn(self, machine, unknowns, scales, edges, stops, *, places=None, adjoint):
        """Integrate one turn to its end.

        With `places`, edges of panels, keep the accounts and return the speed at their nodes too.
        """
        speed_scale, energy_scale, level_scale = scales
        holds_speed = isinstance(machine.motor, MeanSpeed)
        moving = turn_edges(kink_angles(machine))

        def rate(place, y, args):
            del args
            branch, stretch = _follow(edges, moving, place)
            # A halt is reported by the end values; the floor keeps them finite.
            speed = jnp.maximum(y["speed"], 1e-3) * speed_scale
            motor = machine.motor.torque(speed)
            if holds_speed:
                motor = motor * unknowns[1] * level_scale
            rise, conservative, gas = solve_acceleration(machine, branch, speed, motor)
            out = {"speed": rise / speed / speed_scale, "time": speed_scale / speed / (2 * jnp.pi)}
            if places is not None:
                state = CrankState(branch, speed, rise)
                loads = loads_at(machine, state, gas, evidence=False)
                work = {"motor": motor, "gas": -conservative, "losses": loads.loss_torque}
                out["work"] = jax.tree.map(lambda torque: torque / energy_scale, work)
            return jax.tree.map(lambda x: x * stretch, out)

        y0 = {"speed": unknowns[0], "time": jnp.zeros(())}
        saveat = diffrax.SaveAt(t1=True)
        if places is not None:
            nothing = {"motor": jnp.zeros(()), "gas": jnp.zeros(())}
            names = jax.eval_shape(lambda: rate(edges[0], y0 | {"work": None}, None))["work"]
            nothing["losses"] = {name: jnp.zeros(()) for name in names["losses"]}
            y0["work"] = nothing
            nodes = panels(places, self.output_nodes).angle.ravel()
            saveat = diffrax.SaveAt(
                subs=[
                    diffrax.SubSaveAt(t1=True),
                    diffrax.SubSaveAt(ts=nodes, fn=lambda t, y, args: y["speed"]),
                ]
            )
        steps = diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=self.step_tolerance, atol=self.step_tolerance), jump_ts=stops
        )
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            self.solver,
            t0=edges[0],
            t1=edges[-1],
            dt0=0.01,
            y0=y0,
            saveat=saveat,
            stepsize_controller=steps,
            max_steps=self.max_steps,
            adjoint=adjoint,
            throw=False,
        )
        if places is None:
            return jax.tree.map(lambda x: x[-1], solution.ys), None
        assert solution.ys is not None
        end, speed = solution.ys
        return jax.tree.map(lambda x: x[-1], end), speed

    def _orbit(
        self, compressor, unknowns, scales, edges, places, end, speed, status, report
    ) -> Orbit:
        speed_scale, energy_scale, level_scale = scales
        moved = jnp.interp(places, edges, turn_edges(kink_angles(compressor)))
        grid = panels(moved, self.output_nodes)
        speed = jnp.maximum(speed.reshape(grid.angle.shape), 1e-3) * speed_scale
        motor = compressor.motor.torque(speed)
        if isinstance(compressor.motor, MeanSpeed):
            motor = motor * unknowns[1] * level_scale
        rise, _, _ = _over_panels(solve_acceleration)(compressor, grid.angle, speed, motor)
        state = CrankState(grid.angle, speed, rise)
        work = jax.tree.map(lambda w: w * energy_scale, end["work"])
        energy = Energy(work["motor"], work["gas"], work["losses"])
        loads = loads_at(compressor, state)
        # Close to self-locking the steps of the joint loop, or those to the acceleration, are too few.
        quick = loads_at(compressor, state, evidence=False)
        sound = loads.agrees(quick.total_loss_torque)
        sound &= jnp.abs(energy.residual) <= 10 * self.tolerance
        lost = ~sound & (status == Status.converged)
        status = Status.where(lost, Status.not_converged, status)
        stalled = jnp.min(speed) <= 2e-3 * speed_scale
        status = Status.where(stalled, Status.stalled, status)
        orbit = orbit_on_panels(
            compressor, grid, state, motor, loads, energy, status, report, self.name
        )
        mean_speed = speed_scale / end["time"]
        return eqx.tree_at(lambda o: o.mean_speed, orbit, mean_speed)


def _gap_at(end, unknowns, machine, scales):
    gaps = [end["speed"] - unknowns[0]]
    if isinstance(machine.motor, MeanSpeed):
        gaps.append(end["time"] * machine.motor.mean_speed / scales[0] - 1)
    return jnp.stack(gaps)


@eqx.filter_custom_jvp
def _follow_parameters(machine, solved, options):
    """The solved unknowns, with their dependence on the machine by the implicit function theorem.

    Only a derivative asks for the extra turn.
    """
    del machine, options
    return solved[0]


@_follow_parameters.def_jvp
def _follow_parameters_jvp(primals, tangents):
    machine, (root, jacobian, fixed), options = primals

    def gap(machine):
        return options._gap(root, machine, fixed, options.adjoint)

    _, moved = eqx.filter_jvp(gap, (machine,), (tangents[0],))
    return root, -jnp.linalg.solve(jacobian, moved)


def _over_panels(function):
    return jax.vmap(jax.vmap(function, (None, 0, 0, 0)), (None, 0, 0, 0))


def _follow(
    edges: Float[Array, " k"], moving: Float[Array, " k"], place: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Crank angle [rad] that belongs to a place in the fixed turn, and its rate [-].

    The integration runs between fixed edges, the crank between edges that move with the parameters:
    where the torque jumps, at the dead centre of an offset machine, the derivative needs the motion
    of the jump. The values of both are the same. The place is first moved off the edges of its panel
    by more than rounding, because a stage on an edge would pick the formula of either side at random.
    """
    panel = jnp.clip(jnp.searchsorted(edges, place, side="right") - 1, 0, edges.size - 2)
    left, right = edges[panel], edges[panel + 1]
    wide = right > left
    stretch = jnp.where(
        wide, (moving[panel + 1] - moving[panel]) / jnp.where(wide, right - left, 1), 1
    )
    inside = jnp.clip(place, left + 1e-10, right - 1e-10)
    return moving[panel] + (inside - left) * stretch, stretch
