"""`solve_cycle`: the periodic cycle at a given motion of the crank."""

from collections.abc import Callable, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from .._core.each import stacked
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import admissible, clipped, is_any_traced, strongly_typed
from .._core.one_by_one import one_by_one
from .._core.polynomials import gauss
from .._core.roots import frozen
from .._core.status import SolveFailed, Status, ended_in
from ..mechanism import AbstractMechanism
from ._climb import climbed, evidence, raise_where_unsolved
from ._cycle import Cycle, values_only
from ._cycle_evaluation import CycleSolution, cycle_of, cycles_of
from ._cycle_options import CycleOptions
from ._cylinder import Cylinder, Pace, ports_fit, prepare
from ._cylinder_system import Cylinders
from ._ends import Ends, ends_of, grouping, has_ends, one_end, options_of
from ._gas_balance import STATES, account_scales
from ._piped import PipedLines
from ._plenum import PER_PLENUM
from ._revolutions import START, March, march
from ._rounds import ConstantLines, blank_solution, laid, rounds_of
from ._several import SeveralCycles, is_solved
from ._waves import is_piped, pipings, waves_at_rest
from .wall_network import OF_WALL


def solve_cycle(
    cylinder: Cylinder,
    mechanism: AbstractMechanism,
    speed: float | Float[Array, ""],
    options: CycleOptions | None = None,
    *,
    pace: Pace | None = None,
    start: Cycle | CycleSolution | None = None,
    throw: bool = True,
) -> Cycle:
    """Find the periodic cycle.

    The panels and steps that the machine needs are found by the way, and where Newton's method does not
    hold in the largest size, the march stands. Derivatives outside of `jit` are taken at the cycle that
    was so found. Within `jit` a program has one size: that of the options.

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] mean speed of the crank.
        options: of the solver.
        pace: how unevenly the revolution passes; constant speed if absent.
        start: a cycle of a similar machine by collocation with as many panels and nodes. Nothing is
            marched where this one has the same events.
        throw: raise if the cycle was not found: within `jit` and `vmap` when the program runs and for
            any of a batch, for which `throw=False` leaves it to `status`.

    Returns:
        The cycle. A machine that delivers nothing or whose gas condenses has finite numbers and a
        status that says so.

    Raises:
        SolveFailed: if `throw` and the status is not `Status.converged`.
        BadInput: flanges of pipes that are not one of all cylinders or one of each, or a march of a
            cycle behind pipes.
    """
    one_end(cylinder)
    options = options or CycleOptions()
    check_piping(cylinder, 1, options)
    if is_piped(cylinder):
        options = options.behind_pipes()
    speed = jnp.asarray(speed, float)  # a plain number would be part of the program
    machine = jax.tree.map(strongly_typed, (cylinder, mechanism, speed))
    # under `grad` alone these are plain numbers, and the size can follow from the machine; under
    # `jit` and `vmap` they are not
    values = frozen(machine)
    if is_any_traced(values, pace, start):
        cycle = _solved_if_admissible(*machine, options, pace, start)
        if throw:
            raise_where_unsolved(cycle, options)
        return cycle

    def solve(size):
        # a start has the panels of the first size
        start_of_size = start if size is options else None
        return _solved_if_admissible(*values, size, pace, start_of_size)

    if pace is None:
        # a march has no waves of its own, so that it cannot stand behind the largest size of pipes
        cycle, options = climbed(solve, options, by_march=not is_piped(cylinder))
    else:
        # a pace is known on panels of its own, which are edges for the cycle
        cycle = solve(options)
    if throw and not np.all(ended_in(cycle.status, Status.converged)):
        raise SolveFailed(cycle.status, evidence(cycle, options))
    if not is_any_traced(machine):
        return cycle
    if cycle.solver == "march":
        return _solved_if_admissible(*machine, options, pace, None)  # refuses by name
    # nothing is solved again: derivatives of whatever order hold at the cycle that was found
    return _followed(*machine, pace, cycle)


def check_piping(cylinder: Cylinder, count: int, options: CycleOptions) -> None:
    """Check that the pipes of a machine suit its cylinders and its solver.

    Args:
        cylinder: gas side.
        count: of cylinders.
        options: of the solver.

    Raises:
        BadInput: they do not.
    """
    for name, piping in zip(("suction", "discharge"), pipings(cylinder), strict=True):
        if piping is None:
            continue
        if options.method == "march":
            bound = "absent with method=march: pipes are solved by collocation"
            raise BadInput(f"gas.{name}.piping", "given", bound)
        flanges = len(piping.flanges)
        ends = grouping(cylinder, count).ends
        if flanges not in (1, count, ends):
            bound = f'"flange" of all cylinders, or flange-1 to flange-{count}, one of each'
            if ends > count:
                bound = f"{bound}, or to flange-{ends}, one of each end, head before crank end"
            raise BadInput(f"gas.{name}.piping.pipes", ", ".join(piping.flanges), bound)


def solve_cycles(
    cylinder: Cylinder,
    mechanisms: Sequence[AbstractMechanism],
    phase: Float[Array, " k"],
    speed: float | Float[Array, ""],
    options: CycleOptions,
    pace: Pace | None = None,
    start: CycleSolution | None = None,
) -> Cycle | SeveralCycles:
    """The periodic cycles of the cylinders of an admissible crankshaft, between the same lines.

    With plenums these are shared, and the cylinders are solved together, with panels for each of them;
    without any every cylinder is solved by itself, and cylinders that are the same once. The ends of
    double-acting cylinders are cylinders of their own, together where gas passes the rings.

    Args:
        cylinder: gas, valves and lines of every cylinder.
        mechanisms: the piston's motion in each of k cylinders.
        phase: [rad] own crank angle of each less that of the crank.
        speed: [rad/s] mean speed of the crank.
        options: of the solver.
        pace: as `pace_of` gives it; constant speed if absent.
        start: as `solution_of` or `no_solution` give it.
    """
    check_piping(cylinder, len(mechanisms), options)
    if is_piped(cylinder):
        options = options.behind_pipes()
    if has_ends(cylinder):
        ends = ends_of(cylinder, mechanisms, phase)
        return _of_ends(partial(_solved_ends, options=options), ends, speed, pace, start)
    if len(mechanisms) == 1:
        return _solved(cylinder, mechanisms[0], speed, options, pace, start)
    if cylinder.plenums or is_piped(cylinder):
        return _solved_together(cylinder, stacked(mechanisms), phase, speed, options, pace, start)

    def cycle_of_piston(mechanism, pace, start):
        return _solved(cylinder, mechanism, speed, options, pace, start)

    # one object and not equal ones: whether traced numbers are equal cannot be asked
    if pace is None and start is None and all(other is mechanisms[0] for other in mechanisms):
        return SeveralCycles(
            over_cylinders(cycle_of_piston(mechanisms[0], None, None), len(mechanisms))
        )
    return SeveralCycles(eqx.filter_vmap(cycle_of_piston)(stacked(mechanisms), pace, start))


def follow_cycles(
    cylinder: Cylinder, mechanisms, phase, speed, pace, cycles: Cycle | SeveralCycles
) -> Cycle | SeveralCycles:
    """Cycles that have been found, with their dependence on the machine and how they ended.

    Nothing is solved.

    Args:
        cylinder, mechanisms, phase, speed, pace: as in `solve_cycles`.
        cycles: what it found, by collocation.
    """

    def follow(mechanism, pace, cycle):
        system = Cylinders(prepare(cylinder, mechanism, speed, pace), jnp.zeros(1))
        # the status stays that of the solver: a solution tells only whether it was solved
        followed = cycle_of(system, solution_of(cycle), False)
        return eqx.tree_at(lambda c: c.status, followed, cycle.status)

    if isinstance(cycles, Cycle):
        return follow(mechanisms[0], pace, cycles)
    if has_ends(cylinder):
        ends = ends_of(cylinder, mechanisms, phase)
        followed = _of_ends(_followed_ends, ends, speed, pace, solution_of(cycles))
        return eqx.tree_at(lambda c: c.each.status, followed, cycles.each.status)
    if cycles.together is None:
        return SeveralCycles(eqx.filter_vmap(follow)(stacked(mechanisms), pace, cycles.each))
    system = _together(cylinder, stacked(mechanisms), phase, speed, pace)
    followed = cycles_of(system, solution_of(cycles), False)
    return eqx.tree_at(lambda c: c.each.status, followed, cycles.each.status)


def over_cylinders(tree, count: int):
    """A tree with an axis of so many cylinders that are alike."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tree)


def pace_of(
    solution: CycleSolution,
    excess: Callable[[Float[Array, ""]], Float[Array, ""]],
    phase: Float[Array, " k"],
) -> Pace:
    """Unevenness with which a crank turns, on the panels of cycles.

    Args:
        solution: of the cycles, see `solution_of` and `no_solution`.
        excess: [-] time that a crank angle takes, over its mean and less one.
        phase: [rad] own crank angle of each cylinder less that of the crank.

    Returns:
        Over the angle of the crank where cylinders are solved together; else over that of every cylinder,
        of several with an axis of them.
    """

    def on(edges, phase):
        places = gauss(solution.z.points.shape[-2] - 1).nodes
        angle = edges[:-1, None] + jnp.diff(edges)[:, None] * places
        return Pace(edges, jax.vmap(jax.vmap(excess))(angle - phase))

    edges = solution.z.edges
    if edges.ndim > 1 and edges.shape[0] < phase.size:
        # Groups of several, each solved over the angle of the crank.
        return jax.vmap(on)(edges, jnp.zeros(edges.shape[0]))
    if edges.ndim > 1:
        return jax.vmap(on)(edges, phase)
    if phase.size == 1:
        return on(edges, phase[0])
    return on(edges, jnp.zeros(()))


@eqx.filter_jit
def _followed(cylinder, mechanism, speed, pace, known_cycle: Cycle) -> Cycle:
    machine = clipped(cylinder), (clipped(mechanism),)
    followed = follow_cycles(*machine, jnp.zeros(1), speed, pace, known_cycle)
    assert isinstance(followed, Cycle)
    return followed


@kept_jit
def _solved_if_admissible(cylinder, mechanism, speed, options: CycleOptions, pace, start) -> Cycle:
    """The cycle of what may be out of bounds, which its status says."""
    # what is out of bounds is moved inside and solved, so that one such design of a batch leaves
    # numbers that are finite and a status that says so
    good = admissible(cylinder) & admissible(mechanism) & (speed > 0)
    good &= jnp.all(jnp.stack(ports_fit(cylinder, mechanism)))
    speed = jnp.where(speed > 0, speed, 1.0)
    if isinstance(start, Cycle):
        start = solution_of(start)
    cycle = _solved(clipped(cylinder), clipped(mechanism), speed, options, pace, start)
    status = Status.where(good, cycle.status, Status.bad_input)
    return eqx.tree_at(lambda c: c.status, cycle, status)


@eqx.filter_jit
def _solved(cylinder, mechanism, speed, options: CycleOptions, pace, start) -> Cycle:
    system = Cylinders(prepare(cylinder, mechanism, speed, pace), jnp.zeros(1))
    return cycle_of(*_solved_system(system, options, start))


@eqx.filter_jit
def _solved_together(cylinder, mechanisms, phase, speed, options: CycleOptions, pace, start):
    system = _together(cylinder, mechanisms, phase, speed, pace)
    return cycles_of(*_solved_system(system, options.of_several(system.count), start))


def _together(
    cylinder, mechanisms, phase, speed, pace, *, stacked_lines: bool = False
) -> Cylinders:
    """Cylinders that are solved together; with `stacked_lines` the gas side has an axis of them."""

    def prepared(cylinder, mechanism, phase):
        own_pace = None
        if pace is not None:
            # a pace counts the angle of the crank, every cylinder its own
            own_pace = Pace(pace.edges + phase, pace.excess)
        return prepare(cylinder, mechanism, speed, own_pace)

    over = jax.vmap(prepared, (0 if stacked_lines else None, 0, 0))
    return Cylinders(over(cylinder, mechanisms, phase), phase)


def _of_ends(solve: Callable, ends: Ends, speed, pace, start) -> SeveralCycles:
    """Cycles of the ends of all cylinders, group by group.

    Args:
        solve: cycles of the ends of one group, from the ends, speed, pace and start.
        ends: of all cylinders.
        speed: [rad/s] mean speed of the crank.
        pace, start: of every group, with an axis of them where there are several.
    """
    grouping = ends.grouping
    several = grouping.groups > 1
    if several:
        # groups do not touch and are alike in number: one program, each with its own solution
        over_groups = eqx.filter_vmap(lambda ends, pace, start: solve(ends, speed, pace, start))
        cycles = over_groups(ends.grouped(), pace, start)
        each = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), cycles.each)
        cycles = SeveralCycles(each, cycles.together)
    else:
        cycles = solve(ends, speed, pace, start)
    together = cycles.together if grouping.together > 1 else None
    cycles = _with_idle_ends(cycles, ends.stages)
    return SeveralCycles(
        cycles.each, together, grouping.sides, cycles.pulsation, stages=ends.stages
    )


def _with_idle_ends(cycles: SeveralCycles, stages: tuple[int, ...]) -> SeveralCycles:
    """Cycles in which ends may deliver nothing, as unloaded ones, where others of their stage do."""
    status = cycles.each.status
    stage = np.array(stages or (1,) * cycles.each.residual.size)
    # (e, e) which ends are of one stage
    among = stage[:, None] == stage
    none = status == Status.no_delivery
    delivers = jnp.any(among & ~none, axis=1)
    idle = none & delivers
    status = jax.vmap(lambda idle, end: Status.where(idle, Status.converged, end))(idle, status)
    return eqx.tree_at(lambda c: c.each.status, cycles, status)


def _system_of_ends(ends: Ends, speed, pace) -> Cylinders:
    """The ends of a group: alone on the pace over its own crank angle, several over the crank's."""
    if ends.phase.size == 1:
        cylinder, piston = jax.tree.map(lambda leaf: leaf[0], (ends.cylinders, ends.pistons))
        return Cylinders(prepare(cylinder, piston, speed, pace), jnp.zeros(1))
    return _together(ends.cylinders, ends.pistons, ends.phase, speed, pace, stacked_lines=True)


def _cycles_of_group(system: Cylinders, solution: CycleSolution, marching: bool) -> SeveralCycles:
    if system.count > 1:
        return cycles_of(system, solution, marching)
    alone = cycle_of(system, solution, marching)
    return SeveralCycles(jax.tree.map(lambda leaf: leaf[None], alone), pulsation=alone.pulsation)


@eqx.filter_jit
def _solved_ends(ends: Ends, speed, pace, start, options: CycleOptions) -> SeveralCycles:
    system = _system_of_ends(ends, speed, pace)
    return _cycles_of_group(*_solved_system(system, options.of_several(system.count), start))


def _followed_ends(ends: Ends, speed, pace, solution: CycleSolution) -> SeveralCycles:
    return _cycles_of_group(_system_of_ends(ends, speed, pace), solution, False)


def _solved_system(system: Cylinders, options: CycleOptions, start: CycleSolution | None):
    """System, solution and whether it was marched, of which `cycle_of` and `cycles_of` make cycles."""
    marching = options.method == "march" or not system.cases.cylinder.inert
    if marching:
        system = values_only(system)
    # marches and rounds are not differentiated: `cycle_of` gives their result its derivatives, by
    # the equations that it solves
    frozen = lax.stop_gradient(system)
    if marching:
        return system, _march_only(frozen, options, start), marching
    if not is_piped(system.cases.cylinder):
        return system, rounds_of(frozen, options, start, ConstantLines()), marching
    # a network that rings takes five times the rounds of another
    solution = one_by_one(partial(rounds_of, lines=PipedLines()), frozen, options, start)
    return system, solution, marching


def _march_only(
    system: Cylinders, options: CycleOptions, start: CycleSolution | None
) -> CycleSolution:
    tolerance = jnp.asarray(options.value_tolerance)
    # a revolution of many steps does not repeat to the error of a single one
    repeat = 10 * tolerance
    state, flags = system.initial(START)
    if start is not None:
        state = jnp.where(start.solved, start.z.left[0], state)
        flags = jnp.where(start.solved, start.mesh.flags[0], flags)
    end = march(
        system,
        options,
        tolerance,
        repeat,
        state,
        flags,
        jnp.asarray(True),
        options.revolutions_at_most,
    )
    mesh, z, events = laid(system, end, options)
    return CycleSolution(
        mesh=mesh,
        z=z,
        marched=z,
        totals=end.totals,
        solved=(end.change <= repeat) & end.ended & mesh.fits,
        residual=end.change,
        steps=jnp.zeros((), int),
        revolutions=end.revolutions,
        passes=end.passes,
        events=events,
        repeats=end.change <= repeat,
        alternates=_alternates(end, repeat),
    )


def _alternates(end: March, repeat) -> Bool[Array, ""]:
    """Whether a march repeats after two revolutions, and not after one."""
    return (end.change > 100 * repeat) & (end.change_of_two < 0.1 * end.change)


def solution_of(cycle: Cycle | SeveralCycles, followed: bool = False) -> CycleSolution:
    """Solution of a cycle by collocation; of several alone, with an axis of them.

    Args:
        cycle: that of one cylinder, or those of several.
        followed: with its dependence on the machine.
    """
    if isinstance(cycle, SeveralCycles) and cycle.together is None:
        return jax.vmap(partial(solution_of, followed=followed))(cycle.each)
    if not followed:
        cycle = lax.stop_gradient(cycle)
    if isinstance(cycle, SeveralCycles):
        together = cycle.together
        # one cylinder that was not solved makes all of them useless as a start: they have one
        # vector of unknowns
        solved = jnp.broadcast_to(is_solved(cycle.each), jnp.shape(together.solved))
        return together._replace(marched=together.z, solved=solved)
    mesh, z, _ = cycle.raw
    totals = (jnp.stack(cycle.totals) / account_scales(cycle.case))[None]
    return CycleSolution(
        mesh=mesh,
        z=z,
        marched=z,
        totals=totals,
        solved=is_solved(cycle),
        residual=cycle.residual,
        steps=cycle.iterations,
        revolutions=cycle.revolutions,
        passes=cycle.passes,
        events=cycle.valve_events,
        repeats=cycle.repeats,
        alternates=jnp.asarray(False),
        waves=None if cycle.pulsation is None else cycle.pulsation.waves,
    )


def no_solution(cylinder: Cylinder, count: int, options: CycleOptions) -> CycleSolution:
    """Solution of `count` cylinders before the first round; without plenums, of each of them."""
    if has_ends(cylinder):
        ends = grouping(cylinder, count)
        size = ends.together * STATES + PER_PLENUM * len(cylinder.plenums)
        blank = blank_solution(ends.together, size, options_of(cylinder, count, options))
        if is_piped(cylinder):
            blank = blank._replace(waves=waves_at_rest(cylinder))
        if ends.groups == 1:
            return blank
        return over_cylinders(blank, ends.groups)
    if count > 1 and not (cylinder.plenums or is_piped(cylinder)):
        return over_cylinders(no_solution(cylinder, 1, options), count)
    own_states = STATES + (0 if cylinder.walls is None else OF_WALL)
    size = count * own_states + PER_PLENUM * len(cylinder.plenums)
    blank = blank_solution(count, size, options_of(cylinder, count, options))
    if is_piped(cylinder):
        blank = blank._replace(waves=waves_at_rest(cylinder))
    return blank
