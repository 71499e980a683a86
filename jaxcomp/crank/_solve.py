"""`solve_orbit`: the periodic state, by either solver.

Of a machine with valves pressure and speed of one revolution follow each from the other.
The speed enters the cylinder through the time that every crank angle takes, and the pressure the
crank as any prescribed gas does. The cycle is marched at constant speed in the first iteration; from
then on one Newton solve of the cycle and one orbit make an iteration. It contracts by the relative
change of the work with speed times the fluctuation, about 0.02 on ordinary machines; the mean speed of
a motor with a torque curve is found with it. Derivatives follow from the implicit function theorem,
with the iteration linearised once. Cycle and crank are traced once for values and once for derivatives,
since such a program takes far longer to compile than to run.

Several cylinders between the same lines each have a cycle of their own, by their own crank angle; where
they share plenums these are solved together, on the panels of all.

The speed reaches the cylinder as polynomials on the panels of its own cycle, through the values that the
crank's polynomials have at the nodes there. All corners that the valves make are edges of both, so that
the transfer is as exact as the two solutions.
"""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import admissible, clipped, is_traced, replaced
from .._core.roots import frozen, settle, zeros_of
from .._core.status import SolveFailed, Status
from ..compressor import Compressor, HasCompressor, compressor_of, mechanisms_of
from ..cylinder import Cycle, Cylinder
from ..cylinder.interface import (
    CycleSolution,
    Pace,
    SeveralCycles,
    climb,
    evidence,
    follow_cycles,
    is_solved,
    no_solution,
    of_each,
    pace_of,
    raise_where_unsolved,
    solution_of,
    solve_cycles,
    unsolved,
)
from ..motor import ConstantSpeed
from ._collocation import Collocation, default_collocation
from ._films import has_thin_film
from ._orbit import Orbit, Verification
from ._warming import LARGEST_RISE, at_rise, first_rise, law_of, rise_after, secant

if TYPE_CHECKING:
    from ._integration import TimeIntegration
    from ._shooting import Shooting

# [-] Resolution beyond which a revolution is not resolved. Seen at a conrod ratio of 0.95 without
# edges at the load reversals: 0.21 with 5 nodes on a panel, the fluctuation 3.9 % off; 0.06 with 8,
# 0.8 % off.
_COARSE = 0.1
# [-] Residual of the joint loop, of the work over a revolution, and estimated error of the losses over
# the work of the motor, beyond which nothing counts as solved: rounding, 1e-9 and 1e-7 are usual.
_JOINT_RESIDUAL = 1e-6
_ENERGY_RESIDUAL = 1e-5
_LOSS_ERROR = 1e-2
# [-] Margin of the joints below which a failure is put down to the lock that is near: of the machine of
# Tsuji et al. with more and more friction at the wall the iterations grow from 21 at a margin of 0.12 to
# 104 at 0.017, and the error of the losses from 2e-4 to 6e-3; at 0.009 it is 1e-2.
_NEAR_LOCKING = 0.05
_TOLERANCE, _MAX_ITERATIONS = 1e-10, 20
_KELVINS = 100.0  # a rise of the suction gas as an unknown of order one
# Of derivatives: what is left of them is the contraction to this power, 1e-10 on ordinary machines.
_TANGENT_ITERATIONS = 6


def solve_orbit(
    machine: Compressor | HasCompressor,
    solver: "Shooting | Collocation | None" = None,
    *,
    verify: "bool | TimeIntegration" = False,
    throw: bool = True,
) -> Orbit:
    """Find the periodic state of the crank.

    Args:
        machine: a compressor, a machine or a scene.
        solver: options of the solver. If absent, `default_collocation`: the whole revolution at once,
            with panel edges for as many load reversals as the mechanism has. `Shooting()` integrates it
            with diffrax and shares no more than the laws, at many times the cost.
        verify: march one revolution from the found state with diffrax, independently of the solver:
            `orbit.verification` then has the error of speed, losses, efficiency and peaks. `True` takes
            `diffrax.Dopri8` at 1e-12; for a stiff motor or a narrow transition of friction give
            `TimeIntegration(diffrax.Kvaerno5())`. Of a cylinder the pressure that was found is taken
            as given.
        throw: raise if no periodic state was found. Within `jit` and `vmap` a machine with valves whose
            cycle was not found raises when the program runs, any of a batch; other machines do not
            raise there. `throw=False` leaves it to `status`.

    Returns:
        The orbit with its energy account and its evidence. A design that is out of bounds, that
        locks or that stalls has finite numbers and a status that says so.

    Raises:
        SolveFailed: if `throw` and the status is not `Status.converged`, or the march did not end.

    >>> from jaxcomp import load
    >>> orbit = solve_orbit(load("mayekawa-wbhe"))
    >>> print(f"{100 * orbit.mechanical_efficiency:.2f} %, {orbit.motor_power / 1e3:.2f} kW")
    91.17 %, 5.66 kW
    >>> bool(orbit.converged), bool(abs(orbit.energy.residual) < 1e-9)
    (True, True)
    """
    compressor = compressor_of(machine)
    if solver is None:
        solver = default_collocation(compressor)
    values = frozen(compressor)
    if any(is_traced(leaf) for leaf in jax.tree.leaves(values)):
        # within a program that is traced anyway, one of its own would be traced twice for derivatives
        orbit = _solved(compressor, solver)
        if throw and orbit.cycle is not None:
            raise_where_unsolved(orbit.cycle, solver.cycle)
    else:
        orbit = _orbit_outside(compressor, values, solver, throw)
    if verify is False:
        return orbit
    from ._verify import march_options

    options = march_options() if verify is True else verify
    orbit = eqx.tree_at(
        lambda o: o.verification,
        orbit,
        _verification(compressor, orbit, options),
        is_leaf=lambda leaf: leaf is None,
    )
    status = orbit.verification.status
    if throw and not is_traced(status._value) and bool(jnp.any(status != Status.converged)):
        raise SolveFailed(
            status,
            f"the march that verifies the orbit did not end within {options.max_steps} steps; take "
            "verify=TimeIntegration(diffrax.Kvaerno5(), tolerance=1e-8)",
        )
    return orbit


def _orbit_outside(compressor: Compressor, values: Compressor, solver, throw: bool) -> Orbit:
    """The orbit outside of traced programs, in the size of the cycle that the machine needs.

    Args:
        compressor: perhaps with derivatives.
        values: without.
        solver: of the orbit.
        throw: raise if no periodic state was found.
    """
    with_derivatives = any(is_traced(leaf) for leaf in jax.tree.leaves(compressor))
    if not isinstance(compressor.gas, Cylinder):
        orbit = (_solved if with_derivatives else _solve)(compressor, solver)
        if throw:
            _raise_if_failed(orbit, solver)
        return orbit

    def solve(cycle_options, _):
        return _solve(values, dataclasses.replace(solver, cycle=cycle_options))

    orbit, cycle_options = climb(solve, solver.cycle, None, True)
    solver = dataclasses.replace(solver, cycle=cycle_options)
    if throw:
        _raise_if_failed(orbit, solver)
    if not with_derivatives:
        return orbit
    return _solved(compressor, solver, orbit)


def _raise_if_failed(orbit: Orbit, solver) -> None:
    """Raise with what is known of an orbit that was not found."""
    status = orbit.status
    if is_traced(status._value):
        # since its orbit has derivatives; a whole number cannot be taken out of their trace
        code = frozen(jnp.asarray(status._value, float))
        if is_traced(code):
            return
        status = eqx.tree_at(lambda s: s._value, status, code.astype(jnp.int32))
    if not bool(jnp.any(status != Status.converged)):
        return
    if orbit.cycle is not None and not bool(of_each(orbit.cycle).converged.all()):
        raise SolveFailed(status, evidence(orbit.cycle, solver.cycle), orbit)
    seen = frozen(orbit)
    crank_is_solved = float(seen.residual) < _JOINT_RESIDUAL
    if seen.cycle is not None and crank_is_solved and bool(status == Status.not_converged):
        raise SolveFailed(
            status,
            f"pressure and speed of the crank did not agree within {_MAX_ITERATIONS} iterations: the "
            f"speed fluctuates by {100 * float(seen.speed_fluctuation):.3g} % of its mean; more inertia "
            "of the crankshaft or a higher speed makes it steadier",
            orbit,
        )
    worst = seen.weakest_cylinder
    where = "" if worst is None else f" in cylinder {int(worst)}"
    raise SolveFailed(
        status,
        f"residual {float(seen.residual):.2g} after {int(seen.iterations)} iterations, "
        f"joint margin {float(seen.margin):.3g}{where}, energy open by "
        f"{float(seen.energy.residual):.2g}, losses known to "
        f"{float(seen.efficiency_error):.2g} of the work",
        orbit,
    )


def _solved(
    compressor: Compressor, solver: "Shooting | Collocation", found: Orbit | None = None
) -> Orbit:
    """The orbit of what may be out of bounds, which its status says; see `_orbit`."""
    good = admissible(compressor)
    orbit = _orbit(clipped(compressor), solver, found)
    status = orbit.status
    failed = (status == Status.unresolved) | (status == Status.not_converged)
    failed |= status == Status.stalled  # as losses beyond all bounds look
    near = failed & (orbit.margin < _NEAR_LOCKING)
    status = Status.where(near, Status.near_locking, status)
    status = Status.where(orbit.margin <= 0, Status.self_locking, status)
    status = Status.where(good, status, Status.bad_input)
    return eqx.tree_at(lambda o: o.status, orbit, status)


_solve = kept_jit(_solved)


@kept_jit
def _verification(compressor: Compressor, orbit: Orbit, options: "TimeIntegration") -> Verification:
    from ._verify import verification

    return verification(orbit.under_gas(clipped(compressor)), orbit, options)


def _orbit(
    compressor: Compressor, solver: "Shooting | Collocation", found: Orbit | None = None
) -> Orbit:
    """The orbit with the checks that hold for every motor and solver.

    Args:
        compressor: admissible.
        solver: of the orbit.
        found: the orbit of a machine with valves, which is not searched for then.
    """
    if isinstance(compressor.gas, Cylinder):
        even = isinstance(compressor.motor, ConstantSpeed)
        orbit = _with_cylinder(compressor, solver, even, found)
    else:
        orbit = solver.solve(compressor)
    seen: Orbit = lax.stop_gradient(orbit)
    # what everything else is made of, so that a number that nobody asks for is not computed
    leaves = jax.tree.leaves((seen.state, seen.loads.forces, seen.loads.loss_torque, seen.energy))
    finite = jnp.isfinite(sum(jnp.sum(leaf) for leaf in leaves))
    assert seen.loads.residual is not None
    # the loop of the joints closes with the motion, to the tolerance that was asked for
    joints = jnp.max(jnp.abs(seen.loads.residual)) <= _JOINT_RESIDUAL + 10 * solver.tolerance
    coarse = seen.resolution > _COARSE
    coarse |= ~(jnp.abs(seen.energy.residual) <= _ENERGY_RESIDUAL)
    if getattr(solver, "estimate", True):
        coarse |= ~(seen.efficiency_error <= _LOSS_ERROR)
        if seen.gas_work_error is not None:
            size = jnp.abs(seen.energy.gas_work) + seen.energy.total_loss
            coarse |= seen.gas_work_error > _LOSS_ERROR * size
    good = orbit.status == Status.converged
    thin = has_thin_film(compressor, seen)
    status = Status.where(good & thin, Status.thin_film, orbit.status)
    status = Status.where(good & coarse, Status.unresolved, status)
    status = Status.where(good & ~(finite & joints), Status.not_converged, status)
    return eqx.tree_at(lambda o: o.status, orbit, status)


def orbit_at_constant_speed(compressor: Compressor, solver: Collocation) -> Orbit:
    """The cycle at the mean speed, and the crank's motion under the pressure so found.

    Args:
        compressor: admissible, whose gas is a `Cylinder`.
        solver: of the crank's motion.
    """
    return _with_cylinder(compressor, solver, True)


def _with_cylinder(compressor: Compressor, solver, even: bool, found: Orbit | None = None) -> Orbit:
    """The orbit of an admissible compressor whose gas is a `Cylinder`.

    Args:
        compressor: the machine.
        solver: of the crank's motion under a prescribed pressure.
        even: whether the gas sees the mean speed.
        found: the orbit, where it is followed and not searched for.
    """
    assert isinstance(compressor.gas, Cylinder)
    warmed = law_of(compressor) is not None
    if warmed and not compressor.gas.inert:
        bound = "absent where a valve has no `port_length`; `suction.heating` is a constant rise"
        raise BadInput("gas.suction.warming", "given", bound)
    marched = solver.cycle.method == "march" or not compressor.gas.inert
    if (even and not warmed) or marched:
        # a marched cycle has no panels to start from: its speed is the mean one
        speed = compressor.motor.speed_guess
        if found is None or marched:
            cycle = _cycles(compressor, solver, speed)
        else:
            cycle = _followed_cycles(compressor, speed, None, found.cycle)
        settled = jnp.asarray(True)
        orbit = _orbit_of(compressor, cycle, solver)
    else:
        known = None if found is None else (found.cycle, _without_cycle(found))
        (cycle, orbit), motion, settled = _coupled(compressor, solver, even, known)
        if motion.rise is not None:
            settled &= _KELVINS * motion.rise < 0.999 * LARGEST_RISE
    if found is not None:
        cycle = _with_status_of(cycle, found.cycle)
    status = Status.where(settled, orbit.status, Status.not_converged)
    status = Status.where(cycle.converged, status, cycle.status)
    orbit = eqx.tree_at(lambda o: o.status, orbit, status)
    return _with_cycle(orbit, cycle)


def _without_cycle(orbit: Orbit) -> Orbit:
    return eqx.tree_at(lambda o: (o.cycle, o.verification), orbit, (None, None), is_leaf=_is_none)


def _is_none(leaf) -> bool:
    return leaf is None


def _with_status_of(cycle: Cycle | SeveralCycles, found: Cycle | SeveralCycles):
    """A cycle that was followed, which ended as the one that was found."""
    return eqx.tree_at(lambda c: of_each(c).status, cycle, of_each(found).status)


def _followed_cycles(compressor: Compressor, speed, pace, found: Cycle | SeveralCycles):
    return follow_cycles(compressor.gas, *_cylinders(compressor), speed, pace, frozen(found))


def _with_cycle(orbit: Orbit, cycle: Cycle | SeveralCycles) -> Orbit:
    return eqx.tree_at(lambda o: o.cycle, orbit, cycle, is_leaf=lambda leaf: leaf is None)


class _Motion(NamedTuple):
    """The motion of the crank as the cylinders see it."""

    level: Float[Array, ""]  # [-] logarithm of the mean speed over the motor's guess
    # over the own crank angle of each cylinder, that of the crank if they share plenums; `None` at
    # constant speed
    pace: Pace | None
    rise: Float[Array, ""] | None  # [-] of the suction gas by a law of its own, in parts of 100 K


@eqx.filter_custom_jvp
def _coupled(compressor: Compressor, solver, even: bool, known: tuple | None):
    """Cycle and orbit that agree, the motion they have, and whether the iteration converged.

    The unknowns are those of `_Motion`.

    Args:
        compressor: the machine.
        solver: of the crank's motion.
        even: leaves out how the crank's speed fluctuates.
        known: cycle and orbit, where they have been found.
    """
    compressor = frozen(compressor)
    if known is not None:
        return known, _motion_of(compressor, known, even), jnp.asarray(True)
    # nothing is known of a cycle and an orbit before the first iteration
    nothing = no_solution(compressor.gas, compressor.crankshaft.count, solver.cycle)
    phase = compressor.crankshaft.distinct_phase
    steady = None if even else pace_of(nothing, jnp.zeros_like, phase)
    rise = first_rise(compressor)
    rise = None if rise is None else rise / _KELVINS
    still = _Motion(jnp.zeros(()), steady, rise)
    _, (cycle, orbit) = zeros_of(_iteration, compressor, solver, still, nothing)
    beside = unsolved(cycle), orbit

    def step(motion, last):
        (cycle, _), before = last
        new, found = _iteration(compressor, solver, motion, solution_of(cycle))
        # without a cycle there is nothing to go on with: the iteration ends, and its status is that one
        solved = is_solved(of_each(found[0]))
        new = jax.tree.map(lambda after, before: jnp.where(solved, after, before), new, motion)
        now = motion.rise, new.rise
        if rise is not None:
            new = new._replace(rise=secant(before, now))
        return new, (found, now)

    beside = beside, (still.rise, still.rise)
    motion, (found, _), report = settle(step, still, beside, _TOLERANCE, _MAX_ITERATIONS)
    return found, motion, report.settled


def _motion_of(compressor: Compressor, known: tuple, even: bool) -> _Motion:
    """The motion of cycle and orbit that have been found."""
    cycle, orbit = known
    rise = rise_after(compressor, _with_cycle(orbit, cycle), first_rise(compressor))
    level, pace = jnp.zeros(()), None
    if not even:
        level, pace = _motion(compressor, cycle, orbit)
    return _Motion(level, pace, None if rise is None else rise / _KELVINS)


@eqx.filter_jit  # traced once, for its shapes and for all that is solved
def _iteration(compressor: Compressor, solver, motion, start: CycleSolution):
    """The motion that the pressure it causes gives the crank, with cycle and orbit.

    The cycle is marched where nothing has been found, and where the motion has changed its events.
    """

    def cycle_of(here, speed):
        return _cycles(here, solver, speed, motion.pace, start)

    return _iterated(compressor, solver, motion, cycle_of)


def _iterated(compressor: Compressor, solver, motion: _Motion, cycle_of):
    """An iteration, with the cycle of a compressor at a speed by `cycle_of`."""
    rise = None if motion.rise is None else _KELVINS * motion.rise
    here = at_rise(compressor, rise)
    cycle = cycle_of(here, compressor.motor.speed_guess * jnp.exp(motion.level))
    orbit = _orbit_of(here, cycle, solver)
    new = rise_after(compressor, _with_cycle(orbit, cycle), rise)
    level, pace = jnp.zeros(()), None  # the motor holds its speed
    if motion.pace is not None:
        level, pace = _motion(compressor, cycle, orbit)
    return _Motion(level, pace, None if new is None else new / _KELVINS), (cycle, orbit)


@_coupled.def_jvp
def _coupled_jvp(primals, tangents):
    compressor, solver, even, known = primals
    out = _coupled(compressor, solver, even, known)
    (cycle, _), motion, _ = out
    numbers, rest = eqx.partition(compressor, eqx.is_inexact_array)

    def iteration(numbers, motion):
        def cycle_of(here, speed):
            return _followed_cycles(here, speed, motion.pace, cycle)

        made = _iterated(eqx.combine(numbers, rest), solver, motion, cycle_of)
        return eqx.filter(made, eqx.is_inexact_array)

    _, linear = jax.linearize(iteration, numbers, motion)
    given = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, numbers, tangents[0])

    none, still = jax.tree.map(jnp.zeros_like, (numbers, motion))
    directly, beside = linear(given, still)
    # reverse mode wants each right side to depend on the tangents
    nothing = 0 * sum(leaf.ravel()[0] for leaf in jax.tree.leaves(given) if leaf.size)
    directly = jax.tree.map(lambda x: x + nothing, directly)
    _, across = jax.linearize(lambda motion: linear(none, motion), still)

    share = None  # of the rise that a degree more of it adds to itself
    if motion.rise is not None:
        share = across(still._replace(rise=jnp.ones_like(motion.rise)))[0].rise

    def solve(matvec, right_side):
        def closer(_, value):
            rest = jax.tree.map(jnp.subtract, right_side, matvec(value))
            if share is not None:
                rest = rest._replace(rise=rest.rise / (1 - share))
            return jax.tree.map(jnp.add, value, rest)

        return lax.fori_loop(0, _TANGENT_ITERATIONS, closer, right_side)

    moved = lax.custom_linear_solve(
        lambda v: jax.tree.map(jnp.subtract, v, across(v)[0]),
        directly,
        solve,
        transpose_solve=solve,
    )
    found = jax.tree.map(jnp.add, beside, across(moved)[1])
    return out, (found, moved, None)


def _cycles(compressor: Compressor, solver, speed, pace=None, start=None) -> Cycle | SeveralCycles:
    """The cycle of the cylinder, or of all, at a given motion of the crank."""
    given = speed, solver.cycle, pace, start
    return solve_cycles(compressor.gas, *_cylinders(compressor), *given)


def _cylinders(compressor: Compressor):
    """The mechanism of every cylinder, and their phases [rad]."""
    return mechanisms_of(compressor), compressor.crankshaft.distinct_phase


def _orbit_of(compressor: Compressor, cycle: Cycle | SeveralCycles, solver) -> Orbit:
    """The motion of the crank under the pressure of a cycle."""
    return solver.solve(replaced(compressor, gas=cycle.gas()))


def _motion(compressor: Compressor, cycle: Cycle | SeveralCycles, orbit: Orbit):
    """Level and pace of an orbit, on the panels of the cycle under which it was found."""
    slow = orbit.mean_speed / orbit.state.speed.reshape(-1, orbit.panel_nodes)
    own = Pace(orbit.panel_edges, slow - 1)
    phase = compressor.crankshaft.distinct_phase
    pace = pace_of(solution_of(cycle, followed=True), own.at, phase)
    return jnp.log(orbit.mean_speed / compressor.motor.speed_guess), pace
