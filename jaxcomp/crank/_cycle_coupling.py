"""Crank and cycle that agree: pressure and speed of one revolution follow each from the other.

The speed enters the cylinder through the time that every crank angle takes, and the pressure the crank
as any prescribed gas does. One solve of the cycle and one of the crank make a step. By itself it
contracts by the relative change of the work with speed times the fluctuation, about 0.02 on ordinary
machines and 0.5 or none where a light crank nearly stops in every revolution; mixed with the steps
before it takes 5 and 20 of them. The mean speed of a motor with a torque curve, and the rise of suction
gas by a law of its own, are found with it. The first step marches the cycle at constant speed; the later
ones begin with its solution.

Derivatives follow from the implicit function theorem, with the step linearised once. Cycle and crank are
traced once for values and once for derivatives, since such a program takes far longer to compile than to
run.

Several cylinders between the same lines each have a cycle of their own, by their own crank angle; where
they share plenums these are solved together, on the panels of all.

The speed reaches the cylinder as polynomials on the panels of its own cycle, through the values that the
crank's polynomials have at the nodes there. All corners that the valves make are edges of both, so that
the transfer is as exact as the two solutions. Panels move from step to step as the valves' events do:
what steps gave is compared on a fixed grid, and combined on the newest panels.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.elimination import solve_small
from .._core.extremes import clip, max_of, maximum
from .._core.fields import replaced
from .._core.polynomials import gauss
from .._core.roots import frozen, mix, zeros_of
from .._core.status import Status
from ..compressor import Compressor, mechanisms_of
from ..cylinder import Cycle, Cylinder
from ..cylinder._cycle import values_only
from ..cylinder._cycle_evaluation import CycleSolution
from ..cylinder._cylinder import Pace
from ..cylinder._ends import guessed_pressures, phase_of_ends
from ..cylinder._several import SeveralCycles, is_near, of_each, unsolved
from ..cylinder._solve_cycle import follow_cycles, no_solution, pace_of, solution_of, solve_cycles
from ..motor import ConstantSpeed
from ._collocation import Collocation
from ._orbit import Orbit
from ._performance import law_of
from ._reversals import CrankSolution
from ._warming import LARGEST_RISE, at_rise, first_rise, rise_after

# [-] Change by a step at which crank and cycle agree. In larger sizes panels are laid anew for a hundred
# events and more, which moves the slow part of a revolution by some 1e-9.
_TOLERANCE = 1e-10
_TOLERANCE_OF_LARGER_SIZES = 1e-8
# Of a cycle that is marched, which repeats within 1e-7. A bounce that comes or goes between two marches
# jerks the crank where it is slowest: of one that slows down to a fifth of its mean speed, with 288
# events in a revolution, changes never fell below 3e-5 there and rose to 1e-3, while the work stayed
# within 1e-7 of itself and the flow within 1e-8.
_MARCHED_TOLERANCE = 1e-5
_MARCHED_NOISE = 1e-3
MAX_ITERATIONS = 40
_KELVINS = 100.0  # a rise of the suction gas as an unknown of order one
# [rad] Crank angles at which the motions of two steps are compared; between two of them the fluctuation
# of the speed hardly bends.
_GRID = np.linspace(0.0, 2 * np.pi, 257)[:-1]
# Of derivatives: largest remainder, in parts of the direct ones, and steps after which to give up.
_TANGENT_TOLERANCE = 1e-11
_TANGENT_ITERATIONS = 30


class Motion(NamedTuple):
    """The motion of the crank as the cylinders see it."""

    level: Float[Array, ""]  # [-] logarithm of the mean speed over the motor's guess
    # over the own crank angle of each cylinder, that of the crank if they share plenums; `None` at
    # constant speed
    pace: Pace | None
    rise: Float[Array, ""] | None  # [-] of the suction gas by a law of its own, in parts of 100 K
    # [-] logarithms of the pressures [Pa] between stages, where the flows decide them
    between: Float[Array, " s"] | None = None


def orbit_at_constant_speed(compressor: Compressor, solver: Collocation) -> Orbit:
    """The cycle at the mean speed, and the crank's motion under the pressure so found.

    Args:
        compressor: admissible, whose gas is a `Cylinder`.
        solver: of the crank's motion.
    """
    return orbit_with_cylinder(compressor, solver, even=True)


def orbit_with_cylinder(
    compressor: Compressor, solver, *, even: bool = False, followed_orbit: Orbit | None = None
) -> Orbit:
    """The orbit of an admissible compressor whose gas is a `Cylinder`.

    Args:
        compressor: the machine.
        solver: of the crank's motion under a prescribed pressure.
        even: whether the gas sees the mean speed, of whatever motor.
        followed_orbit: the orbit, where it is followed and not searched for.
    """
    assert isinstance(compressor.gas, Cylinder)
    even = even or isinstance(compressor.motor, ConstantSpeed)
    if _is_marched(compressor, solver):
        # Derivatives through a march would err by per cent: who asks for them gets an error instead.
        compressor = values_only(compressor)
    if even and law_of(compressor) is None and not _seeks_pressures(compressor):
        # the pressure depends on nothing that the crank does
        speed = compressor.motor.speed_guess
        if followed_orbit is None:
            cycle = _cycles(compressor, solver, speed)
        else:
            cycle = _followed_cycles(compressor, speed, None, followed_orbit.cycle)
        agreed = jnp.asarray(True)
        orbit, _ = _orbit_under_pressure(compressor, cycle, solver)
    else:
        followed = None
        if followed_orbit is not None:
            followed = (followed_orbit.cycle, _without_cycle(followed_orbit))
        (cycle, orbit), motion, agreed, _ = _coupled(compressor, solver, even, followed)
        if motion.rise is not None:
            # `rise_after` ends at the bound: a rise that is there satisfies no law
            agreed &= _KELVINS * motion.rise < 0.999 * LARGEST_RISE
    # what a crank that halts leaves of a revolution need not agree with anything
    is_final = agreed | (orbit.status == Status.stalled)
    status = Status.where(is_final, orbit.status, Status.not_converged)
    status = Status.where(cycle.converged, status, cycle.status)
    orbit = eqx.tree_at(lambda o: o.status, orbit, status)
    return _with_cycle(orbit, cycle)


def _is_marched(compressor: Compressor, solver) -> bool:
    """Whether the cycle has no derivatives."""
    assert isinstance(compressor.gas, Cylinder)
    return solver.cycle.method == "march" or not compressor.gas.inert


@eqx.filter_custom_jvp
def _coupled(compressor: Compressor, solver, even: bool, followed: tuple | None):
    """Cycle and orbit that agree, their motion, whether they were found, and the unknowns of the crank.

    Args:
        compressor: the machine.
        solver: of the crank's motion.
        even: leaves out how the crank's speed fluctuates.
        followed: cycle and orbit, where they have been found.
    """
    compressor = frozen(compressor)
    if followed is not None:
        return followed, _motion_of_solution(compressor, followed, even), jnp.asarray(True), None
    # nothing is known of a cycle and an orbit before the first step
    no_cycle = no_solution(compressor.gas, compressor.crankshaft.count, solver.cycle)
    phase = _phase_of_cycles(compressor)
    steady = None
    if not even:
        steady = pace_of(no_cycle, jnp.zeros_like, phase)
    rise = first_rise(compressor)
    between = None
    if _seeks_pressures(compressor):
        between = jnp.log(guessed_pressures(compressor.gas, mechanisms_of(compressor)))
    first_motion = Motion(jnp.zeros(()), steady, _in_hundreds(rise), between)
    _, (cycle, *of_crank) = zeros_of(_step, compressor, solver, first_motion, no_cycle)

    def step(motion, last_solution):
        new, solution = _step(compressor, solver, motion, solution_of(last_solution[0]))
        # without a cycle there is nothing to go on with: the iteration ends, and its status is that one
        goes_on = is_near(of_each(solution[0]))
        return jax.tree.map(
            lambda after, before: jnp.where(goes_on, after, before), new, motion
        ), solution

    first_solution = unsolved(cycle), *of_crank
    tolerance, noise = _agreement(compressor, solver)
    motion, (cycle, orbit, crank_solution), report = mix(
        step, first_motion, first_solution, tolerance, MAX_ITERATIONS, _sampled, _combined, noise
    )
    return (cycle, orbit), motion, report.settled, crank_solution


def _agreement(compressor: Compressor, solver) -> tuple[float, float]:
    """[-] Change by a step at which crank and cycle agree, and changes that may be noise."""
    if _is_marched(compressor, solver):
        return _MARCHED_TOLERANCE, _MARCHED_NOISE
    if solver.cycle.size == 0:
        return _TOLERANCE, 0.0
    return _TOLERANCE_OF_LARGER_SIZES, 0.0


def _sampled(motion: Motion) -> Float[Array, " n"]:
    """A motion as numbers that do not depend on where panels lie."""
    # The edges of the panels follow the events of the valves: the values at the nodes of two steps belong
    # to different angles, and their difference tells nothing.
    numbers = [motion.level[None]]
    if motion.rise is not None:
        numbers.append(motion.rise[None])
    if motion.between is not None:
        numbers.append(motion.between)
    if motion.pace is not None:
        numbers.append(_excess_at(motion.pace, jnp.asarray(_GRID)).ravel())
    return jnp.concatenate(numbers)


def _excess_at(pace: Pace, angle: Float[Array, " n"]) -> Float[Array, "*k n"]:
    """[-] The excess of a pace at crank angles [rad]; of k cylinders at those of each, if there are."""
    if pace.edges.ndim > 1:
        return jax.vmap(lambda pace_of_cylinder: jax.vmap(pace_of_cylinder.at)(angle))(pace)
    return jax.vmap(pace.at)(angle)


def _combined(weights: Float[Array, " depth"], outputs: Motion, newest: Motion) -> Motion:
    """The weighted sum of motions, on the panels of the newest."""
    # `None` in one motion is `None` in all: what is unknown is decided before the first step
    rise = None
    if outputs.rise is not None:
        rise = weights @ outputs.rise
    pace = newest.pace
    if pace is not None and outputs.pace is not None:
        on_newest = _combined_pace
        if pace.edges.ndim > 1:
            on_newest = jax.vmap(_combined_pace, (None, 1, 0))
        pace = on_newest(weights, outputs.pace, pace)
    between = None
    if outputs.between is not None:
        between = weights @ outputs.between
    return Motion(weights @ outputs.level, pace, rise, between)


def _combined_pace(weights: Float[Array, " depth"], outputs: Pace, newest: Pace) -> Pace:
    places = gauss(newest.excess.shape[-1]).nodes
    angle = newest.edges[:-1, None] + jnp.diff(newest.edges)[:, None] * places
    values = jax.vmap(_excess_at, (0, None))(outputs, angle.ravel())
    return Pace(newest.edges, (weights @ values).reshape(angle.shape))


def _motion_of_solution(compressor: Compressor, solution: tuple, even: bool) -> Motion:
    """The motion of cycle and orbit that have been found."""
    cycle, orbit = solution
    rise = rise_after(compressor, _with_cycle(orbit, cycle), first_rise(compressor))
    between = None
    if _seeks_pressures(compressor):
        between = jnp.log(cycle.interstage_pressures)
    return _motion_after(compressor, cycle, orbit, even, rise)._replace(between=between)


def _seeks_pressures(compressor: Compressor) -> bool:
    """Whether the flows of stages decide the pressures between them."""
    gas = compressor.gas
    assert isinstance(gas, Cylinder)
    return bool(gas.later_stages) and gas.interstage_pressure is None


def _between_after(cycle, between: Float[Array, " s"]) -> Float[Array, " s"]:
    """Logarithms of the pressures between stages after a revolution at others.

    A step of Newton's method for equal flows of all stages, whose slopes are estimated. Where a stage
    delivers nothing a pressure goes on as far as a factor of two.
    """
    flow = cycle.flow_of_stages
    least = 1e-9 * max_of(cycle.each.case.mass_scale)
    excess = -jnp.diff(jnp.log(maximum(flow, least)))
    slopes = lax.stop_gradient(_slopes_between(cycle))
    # What a step may change is bounded before the slopes share it out, and the change after it.
    bounded = clip(excess, -jnp.log(4.0), jnp.log(4.0))
    change = solve_small(slopes, bounded[:, None])[:, 0]
    return between - clip(change, -jnp.log(2.0), jnp.log(2.0))


def _slopes_between(cycle) -> Float[Array, "s s"]:
    """Slopes of the logarithm of a stage's flow over that of the next, by those of the pressures.

    A stage draws in proportion to the pressure before it, and less by the share that the gas in its
    clearance takes up again. Without that share a step overshot by 0.7 on a machine with 15 % clearance.
    """
    shares = cycle.reexpansion_of_stages
    diagonal = -(1 + shares[:-1] + shares[1:])
    before = 1 + shares[1:-1]
    behind = shares[1:-1]
    return jnp.diag(diagonal) + jnp.diag(before, -1) + jnp.diag(behind, 1)


def _motion_after(compressor: Compressor, cycle, orbit: Orbit, even: bool, rise) -> Motion:
    """The motion of an orbit, on the panels of the cycle under which it was found.

    Args:
        compressor: the machine.
        cycle: of its cylinders.
        orbit: under the pressure of the cycle.
        even: whether the gas sees the motor's guess of the speed.
        rise: [K] of the suction gas by a law of its own, or `None`.
    """
    level = jnp.zeros(())
    pace = None
    if not even:
        # time over angle, in parts of that at the mean speed: what the balances of the gas are driven by
        slowness = orbit.mean_speed / orbit.state.speed.reshape(-1, orbit.panel_nodes)
        crank_pace = Pace(orbit.panel_edges, slowness - 1)
        phase = _phase_of_cycles(compressor)
        pace = pace_of(solution_of(cycle, followed=True), crank_pace.at, phase)
        # as a logarithm, so that no mixture of steps makes a speed that is not positive
        level = jnp.log(orbit.mean_speed / compressor.motor.speed_guess)
    return Motion(level, pace, _in_hundreds(rise))


def _in_hundreds(rise: Float[Array, ""] | None) -> Float[Array, ""] | None:
    """A rise [K] as an unknown of order one, if it is one."""
    if rise is None:
        return None
    return rise / _KELVINS


@eqx.filter_jit  # traced once, for its shapes and for all that is solved
def _step(compressor: Compressor, solver, motion: Motion, start: CycleSolution):
    """The motion that the pressure it causes gives the crank, with cycle, orbit and its unknowns.

    The cycle is marched where nothing has been found, and where the motion has changed its events.
    """

    def cycle_of(machine, speed):
        return _cycles(machine, solver, speed, motion.pace, start)

    return _step_with(compressor, solver, motion, cycle_of)


def _step_with(compressor: Compressor, solver, motion: Motion, cycle_of, crank_solution=None):
    """A step, with the cycle of a compressor at a speed by `cycle_of`.

    The crank's unknowns are not searched for where a `crank_solution` is given.
    """
    rise = None
    if motion.rise is not None:
        rise = _KELVINS * motion.rise
    machine = at_rise(compressor, rise)
    if motion.between is not None:
        gas = replaced(machine.gas, interstage_pressure=jnp.exp(motion.between))
        machine = replaced(machine, gas=gas)
    cycle = cycle_of(machine, compressor.motor.speed_guess * jnp.exp(motion.level))
    orbit, crank_solution = _orbit_under_pressure(machine, cycle, solver, crank_solution)
    new_rise = rise_after(compressor, _with_cycle(orbit, cycle), rise)
    even = motion.pace is None
    moved = _motion_after(compressor, cycle, orbit, even, new_rise)
    if motion.between is not None:
        moved = moved._replace(between=_between_after(cycle, motion.between))
    return moved, (cycle, orbit, crank_solution)


@_coupled.def_jvp
def _coupled_jvp(primals, tangents):
    compressor, solver, even, followed = primals
    out = _coupled(compressor, solver, even, followed)
    (cycle, _), motion, _, crank_solution = out
    numbers, constants = eqx.partition(compressor, eqx.is_inexact_array)

    def step(numbers, motion):
        def cycle_of(machine, speed):
            return _followed_cycles(machine, speed, motion.pace, cycle)

        machine = eqx.combine(numbers, constants)
        # the equations of the crank are linearised at its unknowns: a second search for them would be
        # a twentieth of the program
        moved, (followed_cycle, orbit, _) = _step_with(
            machine, solver, motion, cycle_of, crank_solution
        )
        return eqx.filter((moved, (followed_cycle, orbit)), eqx.is_inexact_array)

    _, linear = jax.linearize(step, numbers, motion)
    tangent = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, numbers, tangents[0])

    zero_numbers, zero_motion = jax.tree.map(jnp.zeros_like, (numbers, motion))
    motion_direct, solution_direct = linear(tangent, zero_motion)
    # A step is linear in both at the solution, d motion = A d numbers + B d motion: the solver below
    # iterates with B alone, since A d numbers is the same in all of its iterations.
    # reverse mode wants each right side to depend on the tangents
    zero = 0 * sum(leaf.ravel()[0] for leaf in jax.tree.leaves(tangent) if leaf.size)
    motion_direct = jax.tree.map(lambda x: x + zero, motion_direct)
    _, by_motion = jax.linearize(lambda motion: linear(zero_numbers, motion), zero_motion)
    motion_moved = lax.custom_linear_solve(
        lambda v: jax.tree.map(jnp.subtract, v, by_motion(v)[0]),
        motion_direct,
        _mixed_solution,
        transpose_solve=_mixed_solution,
    )
    solution_moved = jax.tree.map(jnp.add, solution_direct, by_motion(motion_moved)[1])
    without_slopes = jax.tree.map(lambda _: None, crank_solution)
    return out, (solution_moved, motion_moved, None, without_slopes)


def _mixed_solution(matvec, right_side):
    """The solution of a linear system that is near the identity."""
    # Its matrix is never formed: a product costs as much as a step, and few are needed. Scaled, since
    # the tolerance of `mix` is one of numbers of order one and tangents have any size.
    largest = [max_of(jnp.abs(leaf)) for leaf in jax.tree.leaves(right_side)]
    scale = max_of(jnp.stack(largest))
    scale = jnp.where(scale > 0, scale, 1.0)
    target = jax.tree.map(lambda leaf: leaf / scale, right_side)

    def step(value, _):
        return jax.tree.map(lambda v, b, a: v + b - a, value, target, matvec(value)), None

    value, _, _ = mix(step, target, None, _TANGENT_TOLERANCE, _TANGENT_ITERATIONS)
    return jax.tree.map(lambda leaf: scale * leaf, value)


def _cycles(compressor: Compressor, solver, speed, pace=None, start=None) -> Cycle | SeveralCycles:
    """The cycle of the cylinder, or of all, at a given motion of the crank."""
    mechanisms, phases = _cylinders(compressor)
    return solve_cycles(compressor.gas, mechanisms, phases, speed, solver.cycle, pace, start)


def _followed_cycles(compressor: Compressor, speed, pace, cycle: Cycle | SeveralCycles):
    """Cycles that were found, with their dependence on the machine."""
    return follow_cycles(compressor.gas, *_cylinders(compressor), speed, pace, frozen(cycle))


def _cylinders(compressor: Compressor):
    """The mechanism of every cylinder, and their phases [rad]."""
    return mechanisms_of(compressor), compressor.crankshaft.distinct_phase


def _phase_of_cycles(compressor: Compressor) -> Float[Array, " k"]:
    """[rad] Own crank angle of every cycle less that of the crank."""
    assert isinstance(compressor.gas, Cylinder)
    return phase_of_ends(compressor.gas, compressor.crankshaft.distinct_phase)


def _orbit_under_pressure(
    compressor: Compressor, cycle: Cycle | SeveralCycles, solver, solution=None
) -> tuple[Orbit, CrankSolution | None]:
    """The motion of the crank under the pressure of a cycle, with its unknowns (`Collocation.solved`)."""
    return solver.solved(replaced(compressor, gas=cycle.gas()), solution)


def _with_cycle(orbit: Orbit, cycle: Cycle | SeveralCycles) -> Orbit:
    return eqx.tree_at(lambda o: o.cycle, orbit, cycle, is_leaf=_is_none)


def _without_cycle(orbit: Orbit) -> Orbit:
    return eqx.tree_at(lambda o: (o.cycle, o.verification), orbit, (None, None), is_leaf=_is_none)


def _is_none(leaf) -> bool:
    return leaf is None
