"""`solve_cycle`: the periodic cycle at a given motion of the crank."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from .._core.each import stacked
from .._core.fields import admissible, clipped, is_traced, strongly_typed
from .._core.polynomials import gauss
from .._core.status import SolveFailed, Status
from ..mechanism import AbstractMechanism
from ._balance import FLAGS, STATES, Accounts
from ._collocation import newton
from ._cycle import Cycle, values_only
from ._cylinder import Cylinder, Pace, ports_fit, prepare
from ._evaluation import CycleSolution, account_scales, cycle_of, cycles_of
from ._panels import Mesh, Unknowns, lay_mesh
from ._plenum import PER_PLENUM
from ._revolutions import START, TURN, march
from ._several import SeveralCycles
from ._system import Cylinders
from .wall_network import OF_WALL


class CycleOptions(eqx.Module):
    """Options of the solver of the cycle.

    Attributes:
        method: "collocation" marches until the sequence of events stands and then solves for the
            whole revolution by Newton's method; "march" goes on marching. With quasi-steady ports
            the march is all there is, and derivatives are refused.
        nodes: Gauss nodes on every panel.
        panels: into which the revolution is cut; one more than events are needed at least. Of 1,000
            scattered designs of one machine 922 converge with 48 panels; of the others 12 have
            more events and 66 too few panels between them. All 78 converge with 96, which are taken
            where these fail, except within a program that is traced.
        tolerance: [-] last step of Newton's method.
        march_tolerance: [-] error of a step of the march before the collocation; a tenth of it in every
            further round.
        value_tolerance: [-] the same where the march gives the values.
        max_newton: steps.
        max_revolutions: marched at a stretch.
        max_rounds: of march and Newton's method.
        max_passes: tries of steps in a revolution.
        capacity: steps of a revolution that are kept.
    """

    method: Literal["collocation", "march"] = eqx.field(static=True, default="collocation")
    nodes: int = eqx.field(static=True, default=6)
    panels: int = eqx.field(static=True, default=48)
    tolerance: float | Float[Array, ""] = 1e-11
    march_tolerance: float | Float[Array, ""] = 3e-5
    value_tolerance: float | Float[Array, ""] = 1e-8
    max_newton: int = eqx.field(static=True, default=8)
    max_revolutions: int = eqx.field(static=True, default=30)
    max_rounds: int = eqx.field(static=True, default=4)
    max_passes: int = eqx.field(static=True, default=4000)
    capacity: int = eqx.field(static=True, default=768)

    def refined(self, status: Status) -> "CycleOptions | None":
        """The options with twice the panels, if a status (of any of a batch) may ask for them."""
        full = self.method == "march" or 2 * self.panels > _MOST_PANELS
        if full or not bool(jnp.any(may_lack_panels(status))):
            return None
        return dataclasses.replace(self, panels=2 * self.panels)

    def of_several(self, count: int) -> "CycleOptions":
        """The options where cylinders are solved together: panels and steps are those of each."""
        return dataclasses.replace(
            self,
            panels=count * self.panels,
            max_passes=count * self.max_passes,
            capacity=count * self.capacity,
        )


def may_lack_panels(status: Status) -> Bool[Array, ""]:
    """Whether a cycle that ended so may be found on more panels."""
    return (status == Status.too_many_events) | (status == Status.not_converged)


# Panels up to which those that are too few are doubled.
_MOST_PANELS = 128


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

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] mean speed of the crank.
        options: of the solver.
        pace: how unevenly the revolution passes; constant speed if absent.
        start: a cycle of a similar machine by collocation with as many panels and nodes. Nothing is
            marched where this one has the same events.
        throw: raise if the cycle was not found. Within `jit`, `vmap` or `grad` nothing is raised;
            look at `status` there.

    Returns:
        The cycle. A machine that delivers nothing or whose gas condenses has finite numbers and a
        status that says so.

    Raises:
        SolveFailed: if `throw` and the status is not `Status.converged`.
    """
    options = options or CycleOptions()
    speed = jnp.asarray(speed, float)  # a plain number would be part of the program
    cylinder, mechanism = jax.tree.map(strongly_typed, (cylinder, mechanism))
    cycle = _solved_if_admissible(cylinder, mechanism, speed, options, pace, start)
    shown = not is_traced(cycle.status._value)
    while shown and pace is None and cylinder.inert and (more := options.refined(cycle.status)):
        options = more
        cycle = _solved_if_admissible(cylinder, mechanism, speed, options, None, None)
    if shown and throw and bool(jnp.any(cycle.status != Status.converged)):
        raise SolveFailed(cycle.status, f"residual {float(jnp.max(cycle.residual)):.2g}")
    return cycle


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
    without any every cylinder is solved by itself, and cylinders that are the same once.

    Args:
        cylinder: gas, valves and lines of every cylinder.
        mechanisms: the piston's motion in each of k cylinders.
        phase: [rad] own crank angle of each less that of the crank.
        speed: [rad/s] mean speed of the crank.
        options: of the solver.
        pace: as `pace_of` gives it; constant speed if absent.
        start: as `solution_of` or `no_solution` give it.
    """
    if len(mechanisms) == 1:
        return _solved(cylinder, mechanisms[0], speed, options, pace, start)
    if cylinder.plenums:
        return _solved_together(cylinder, stacked(mechanisms), phase, speed, options, pace, start)

    def one(mechanism, pace, start):
        return _solved(cylinder, mechanism, speed, options, pace, start)

    if pace is None and start is None and all(other is mechanisms[0] for other in mechanisms):
        return SeveralCycles(over_cylinders(one(mechanisms[0], None, None), len(mechanisms)))
    return SeveralCycles(eqx.filter_vmap(one)(stacked(mechanisms), pace, start))


def follow_cycles(
    cylinder: Cylinder, mechanisms, phase, speed, pace, found: Cycle | SeveralCycles
) -> Cycle | SeveralCycles:
    """Cycles that have been found, with their dependence on the machine; nothing is solved.

    Args:
        cylinder, mechanisms, phase, speed, pace: as in `solve_cycles`.
        found: what it found, by collocation.
    """

    def one(mechanism, pace, cycle):
        system = Cylinders(prepare(cylinder, mechanism, speed, pace), jnp.zeros(1))
        return cycle_of(system, solution_of(cycle), False)

    if isinstance(found, Cycle):
        return one(mechanisms[0], pace, found)
    if found.together is None:
        return SeveralCycles(eqx.filter_vmap(one)(stacked(mechanisms), pace, found.each))
    system = _together(cylinder, stacked(mechanisms), phase, speed, pace)
    return cycles_of(system, solution_of(found), False)


def over_cylinders(tree, count: int):
    """A tree with an axis of so many cylinders that are alike."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tree)


def pace_of(
    found: CycleSolution,
    excess: Callable[[Float[Array, ""]], Float[Array, ""]],
    phase: Float[Array, " k"],
) -> Pace:
    """How unevenly a crank turns, on the panels of cycles.

    Args:
        found: of the cycles, see `solution_of` and `no_solution`.
        excess: [-] time that a crank angle takes, over its mean and less one.
        phase: [rad] own crank angle of each cylinder less that of the crank.

    Returns:
        Over the angle of the crank where cylinders are solved together; else over that of every cylinder,
        of several with an axis of them.
    """

    def on(edges, phase):
        places = gauss(found.z.points.shape[-2] - 1).nodes
        angle = edges[:-1, None] + jnp.diff(edges)[:, None] * places
        return Pace(edges, jax.vmap(jax.vmap(excess))(angle - phase))

    edges = found.z.edges
    if edges.ndim > 1:
        return jax.vmap(on)(edges, phase)
    return on(edges, phase[0] if phase.size == 1 else jnp.zeros(()))


@eqx.filter_jit
def _solved_if_admissible(cylinder, mechanism, speed, options: CycleOptions, pace, start) -> Cycle:
    """The cycle of what may be out of bounds, which its status says."""
    good = admissible(cylinder) & admissible(mechanism) & (speed > 0)
    good &= jnp.all(jnp.stack(ports_fit(cylinder, mechanism)))
    speed = jnp.where(speed > 0, speed, 1.0)
    start = solution_of(start) if isinstance(start, Cycle) else start
    cycle = _solved(clipped(cylinder), clipped(mechanism), speed, options, pace, start)
    status = Status.where(good, cycle.status, Status.bad_input)
    return eqx.tree_at(lambda c: c.status, cycle, status)


@eqx.filter_jit
def _solved(cylinder, mechanism, speed, options: CycleOptions, pace, start) -> Cycle:
    system = Cylinders(prepare(cylinder, mechanism, speed, pace), jnp.zeros(1))
    return cycle_of(*_found(system, options, start))


@eqx.filter_jit
def _solved_together(cylinder, mechanisms, phase, speed, options: CycleOptions, pace, start):
    system = _together(cylinder, mechanisms, phase, speed, pace)
    return cycles_of(*_found(system, options.of_several(phase.shape[0]), start))


def _together(cylinder, mechanisms, phase, speed, pace) -> Cylinders:
    def one(mechanism, phase):
        own = None if pace is None else Pace(pace.edges + phase, pace.excess)
        return prepare(cylinder, mechanism, speed, own)

    return Cylinders(jax.vmap(one)(mechanisms, phase), phase)


def _found(system: Cylinders, options: CycleOptions, start: CycleSolution | None):
    """What `cycle_of` and `cycles_of` make cycles of."""
    marching = options.method == "march" or not system.cases.cylinder.inert
    if marching:
        arrays, rest = eqx.partition(system, eqx.is_inexact_array)
        system = eqx.combine(values_only(arrays), rest)
    frozen = lax.stop_gradient(system)
    found = _march_only(frozen, options) if marching else _rounds(frozen, options, start)
    return system, found, marching


def unsolved(cycle: Cycle | SeveralCycles) -> Cycle | SeveralCycles:
    """A cycle of which nothing has been found."""
    failed = jax.tree.map(jnp.full_like, of_each(cycle).status, Status.not_converged)
    return eqx.tree_at(lambda cycle: of_each(cycle).status, cycle, failed)


def of_each(cycle: Cycle | SeveralCycles) -> Cycle:
    """The cycle, or all of several with an axis of them."""
    return cycle.each if isinstance(cycle, SeveralCycles) else cycle


def is_solved(cycle: Cycle) -> Bool[Array, ""]:
    """Whether Newton's method found the cycle, be it one without delivery or of wet gas."""
    failed = (Status.not_converged, Status.too_many_events, Status.bad_input)
    return jnp.all(jnp.stack([cycle.status != one for one in failed]))


def _march_only(system: Cylinders, options: CycleOptions) -> CycleSolution:
    tolerance = jnp.asarray(options.value_tolerance)
    begin, wanted = system.initial(START), jnp.asarray(True)
    repeat = 10 * tolerance
    end = march(system, options, tolerance, repeat, *begin, wanted, options.max_revolutions)
    solved = (end.change <= repeat) & end.whole
    mesh, z = lay_mesh(end.record, options.panels, options.nodes)
    counts = jnp.zeros((), int), end.revolutions, end.passes
    return CycleSolution(mesh, z, z, end.totals, solved, end.change, *counts)


def _after_newton(system, options: CycleOptions, mesh, z, totals, counts) -> CycleSolution:
    new, report = newton(system, mesh, z, options.tolerance, options.max_newton)
    solved = mesh.fits & (report.size < 1e-7) & report.holds
    counts = tuple(jnp.asarray(count) for count in counts)
    return CycleSolution(mesh, new, z, totals, solved, report.size, report.steps, *counts)


def solution_of(cycle: Cycle | SeveralCycles, followed: bool = False) -> CycleSolution:
    """What was found of a cycle by collocation; of several alone, with an axis of them.

    Args:
        cycle: that of one cylinder, or those of several.
        followed: with its dependence on the machine.
    """
    if isinstance(cycle, SeveralCycles) and cycle.together is None:
        return jax.vmap(partial(solution_of, followed=followed))(cycle.each)
    cycle = cycle if followed else lax.stop_gradient(cycle)
    if isinstance(cycle, SeveralCycles):
        together = cycle.together
        return together._replace(marched=together.z, solved=is_solved(cycle.each))
    mesh, z, _ = cycle.raw
    totals = (jnp.stack(cycle.totals) / account_scales(cycle.case))[None]
    counts = cycle.iterations, cycle.revolutions, cycle.passes
    return CycleSolution(mesh, z, z, totals, is_solved(cycle), cycle.residual, *counts)


def _rounds(system: Cylinders, options: CycleOptions, start: CycleSolution | None) -> CycleSolution:
    """March and Newton's method in turns: where Newton leaves the sequence, march from there.

    If there is a start, the first round takes its panels instead of a march.
    """
    given = jnp.asarray(False) if start is None else start.solved

    def advance(carry):
        state, flags, last, rounds = carry
        ready = rounds < 0
        # where a branch was left, a coarser march has missed an event
        tolerance = options.march_tolerance * 0.1 ** jnp.maximum(rounds, 0)
        # further revolutions cost more than another round
        few = min(8, options.max_revolutions)
        repeat = 100 * tolerance  # Newton's method closes the rest
        wanted = ~(last.solved | ready)
        end = march(system, options, tolerance, repeat, state, flags, wanted, few)
        laid = *lay_mesh(end.record, options.panels, options.nodes), end.totals
        if start is not None:
            known = start.mesh, start.z, start.totals
            laid = jax.tree.map(partial(jnp.where, ready), known, laid)
        counts = last.revolutions + end.revolutions, last.passes + end.passes
        found = _after_newton(system, options, *laid, counts)
        mesh = found.mesh
        least = jnp.min(found.z.left[:, system.columns(0, 1)])
        sound = mesh.fits & (found.residual < 1e-7) & (least > 0.01)
        state = jnp.where(sound, found.z.left[0], end.state)
        flags = jnp.where(sound, mesh.flags[0], end.flags)
        usable = end.whole & mesh.fits
        return state, flags, found, jnp.where(usable, rounds + 1, options.max_rounds)

    def going_on(carry):
        _, _, found, rounds = carry
        return ~found.solved & (rounds < options.max_rounds)

    state, flags = system.initial(START)
    nothing = _nothing(system.count, system.size, options)
    if start is not None:
        nothing = nothing._replace(revolutions=start.revolutions, passes=start.passes)
    begin = state, flags, nothing, -1 * given
    return lax.while_loop(going_on, advance, begin)[2]


def no_solution(cylinder: Cylinder, count: int, options: CycleOptions) -> CycleSolution:
    """What there is of `count` cylinders before the first round; without plenums, of each of them."""
    if count > 1 and not cylinder.plenums:
        return over_cylinders(no_solution(cylinder, 1, options), count)
    own = STATES + (0 if cylinder.walls is None else OF_WALL)
    size = count * own + PER_PLENUM * len(cylinder.plenums)
    return _nothing(count, size, options if count == 1 else options.of_several(count))


def _nothing(count: int, states: int, options: CycleOptions) -> CycleSolution:
    p, s, none = options.panels, options.nodes, jnp.zeros((), int)
    flat = jnp.zeros(p, int)
    mesh = Mesh(jnp.zeros((p, FLAGS * count), int), flat, flat, jnp.asarray(False))
    edges = START + TURN * jnp.linspace(0.0, 1.0, p + 1)
    z = Unknowns(jnp.zeros((p, s + 1, states)), jnp.zeros((p, states)), edges)
    totals, solved = jnp.zeros((count, len(Accounts._fields))), jnp.asarray(False)
    return CycleSolution(mesh, z, z, totals, solved, jnp.zeros(()), none, none, none)
