"""Crank and cylinder together: pressure and speed of one revolution, each from the other.

The speed enters the cylinder through the time that every crank angle takes, and the pressure the
crank as any prescribed gas does. The cycle is marched at constant speed in the first iteration; from
then on one Newton solve of the cycle and one orbit make an iteration. It contracts by the relative
change of the work with speed times the fluctuation, about 0.02 on ordinary machines; the mean speed of
a motor with a torque curve is found with it. Derivatives follow from the implicit function theorem,
with the iteration linearised once. Cycle and crank are traced once for values and once for derivatives,
since such a program takes far longer to compile than to run.

Several cylinders between the same lines each have a cycle of their own, by their own crank angle.

Of the speed the cylinder sees its mean and twelve harmonics; what they leave out is about a hundredth of
the fluctuation, at the corners that the valves make.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from .._fields import listed, of_cylinder, replaced
from .._implicit import frozen, settle
from .._status import Status
from ..compressor import Compressor
from ..cylinder import Cycle, CycleOptions, Cylinder, SeveralCycles, solve_cycle
from ..cylinder._solve import Found, follow_cycle, found_of, nothing_found
from ..motor import ConstantSpeed
from ._orbit import Orbit

HARMONICS = 12  # of the time over the crank angle, whose acceleration has kinks
_OPTIONS = CycleOptions(panels=40, nodes=8)
_TOLERANCE, _MAX_ITERATIONS = 1e-10, 20
# Of derivatives: what is left of them is the contraction to this power, 1e-10 on ordinary machines.
_TANGENT_ITERATIONS = 6


def solve_with_cylinder(compressor: Compressor, solver) -> Orbit:
    """The orbit of an admissible compressor whose gas is a `Cylinder`.

    Args:
        compressor: the machine.
        solver: of the crank's motion under a prescribed pressure.
    """
    assert isinstance(compressor.gas, Cylinder)
    if isinstance(compressor.motor, ConstantSpeed) or not compressor.gas.inert:
        # a marched cycle has no panels to start from: its speed is the mean one
        cycle = _at_constant_speed(compressor)
        settled = jnp.asarray(True)
        orbit = _orbit_of(compressor, cycle, solver)
    else:
        (cycle, orbit), _, settled = _coupled(compressor, solver)
    status = Status.where(settled, orbit.status, Status.not_converged)
    status = Status.where(cycle.converged, status, cycle.status)
    return eqx.tree_at(
        lambda o: (o.status, o.cycle), orbit, (status, cycle), is_leaf=lambda leaf: leaf is None
    )


@eqx.filter_custom_jvp
def _coupled(compressor: Compressor, solver):
    """Cycle and orbit that agree, the motion they have, and whether the iteration converged.

    The unknowns are the logarithm of the mean speed over the motor's guess, and harmonics of the time
    that a crank angle takes.
    """
    compressor = frozen(compressor)
    still = jnp.zeros(1 + 2 * HARMONICS)
    shapes = eqx.filter_eval_shape(_iteration, compressor, solver, still, _nothing(compressor))
    # nothing is known of a cycle and an orbit before the first iteration
    beside = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes[1])
    none = _repeated(compressor, Status.not_converged)
    beside = eqx.tree_at(lambda found: _cycles(found[0]).status, beside, none)

    def step(motion, last):
        cycle = last[0]
        several = isinstance(cycle, SeveralCycles)
        found = jax.vmap(found_of)(cycle.each) if several else found_of(cycle)
        return _iteration(compressor, solver, motion, found)

    motion, found, report = settle(step, still, beside, _TOLERANCE, _MAX_ITERATIONS)
    return found, motion, report.settled


@eqx.filter_jit  # traced once, for its shapes and for all that is solved
def _iteration(compressor: Compressor, solver, motion, start: Found):
    """The motion that the pressure it causes gives the crank, with cycle and orbit.

    The cycle is marched where nothing has been found, and where the motion has changed its events.
    """
    speed, fluctuation = _speeds(compressor, motion)

    def one(mechanism, fluctuation, start):
        return solve_cycle(
            compressor.gas,
            mechanism,
            speed,
            _OPTIONS,
            fluctuation=tuple(fluctuation),
            start=start,
            throw=False,
        )

    cycle = _of_each(compressor, one, fluctuation, start)
    orbit = _orbit_of(compressor, cycle, solver)
    return _motion(compressor, orbit), (cycle, orbit)


@_coupled.def_jvp
def _coupled_jvp(primals, tangents):
    compressor, solver = primals
    out = _coupled(compressor, solver)
    (cycle, _), motion, _ = out
    numbers, rest = eqx.partition(compressor, eqx.is_inexact_array)

    def iteration(numbers, motion):
        compressor = eqx.combine(numbers, rest)
        speed, fluctuation = _speeds(compressor, motion)

        def one(mechanism, fluctuation, cycle):
            fluctuation = tuple(fluctuation)
            return follow_cycle(compressor.gas, mechanism, speed, _OPTIONS, fluctuation, cycle)

        made = _of_each(compressor, one, fluctuation, _cycles(frozen(cycle)))
        orbit = _orbit_of(compressor, made, solver)
        return eqx.filter((_motion(compressor, orbit), (made, orbit)), eqx.is_inexact_array)

    _, linear = jax.linearize(iteration, numbers, motion)
    given = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, numbers, tangents[0])

    none, still = jax.tree.map(jnp.zeros_like, numbers), jnp.zeros_like(motion)
    directly, beside = linear(given, still)
    _, across = jax.linearize(lambda motion: linear(none, motion), still)

    def solve(matvec, right_side):
        def closer(_, value):
            return value + right_side - matvec(value)

        return lax.fori_loop(0, _TANGENT_ITERATIONS, closer, right_side)

    moved = lax.custom_linear_solve(
        lambda v: v - across(v)[0], directly, solve, transpose_solve=solve
    )
    found = jax.tree.map(jnp.add, beside, across(moved)[1])
    return out, (found, moved, None)


def _speeds(compressor: Compressor, motion):
    """Mean speed, and harmonics (2, h) over the crank angle; of several cylinders each its own."""
    harmonics = motion[1:].reshape(2, HARMONICS)
    speed = compressor.motor.speed_guess * jnp.exp(motion[0])
    if compressor.cylinders is None:
        return speed, harmonics
    phase = compressor.cylinders.phase[:, None] * jnp.arange(1, HARMONICS + 1)
    c, s = jnp.cos(phase), jnp.sin(phase)
    cosine, sine = harmonics
    return speed, jnp.stack([cosine * c - sine * s, cosine * s + sine * c], axis=1)


def _of_each(compressor: Compressor, one, *given) -> Cycle | SeveralCycles:
    """The cycle of every cylinder, by a function of its mechanism and of what else is given for each."""
    if compressor.cylinders is None:
        return one(compressor.mechanism, *given)
    count = compressor.cylinders.count
    each = [of_cylinder(compressor.mechanism, i + 1) for i in range(count)]
    mechanisms = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)
    return SeveralCycles(eqx.filter_vmap(one)(mechanisms, *given))


def _at_constant_speed(compressor: Compressor) -> Cycle | SeveralCycles:
    speed = compressor.motor.speed_guess

    def one(mechanism):
        return solve_cycle(compressor.gas, mechanism, speed, _OPTIONS, throw=False)

    if compressor.cylinders is None or listed(compressor.mechanism):
        return _of_each(compressor, one)
    # cylinders that are alike have one cycle
    return SeveralCycles(_repeated(compressor, one(compressor.mechanism)))


def _cycles(cycle: Cycle | SeveralCycles) -> Cycle:
    """One, or all of several stacked."""
    return cycle.each if isinstance(cycle, SeveralCycles) else cycle


def _repeated(compressor: Compressor, tree):
    """The same for each of several cylinders."""
    if compressor.cylinders is None:
        return tree
    count = compressor.cylinders.count
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tree)


def _nothing(compressor: Compressor) -> Found:
    """What there is of every cylinder's cycle before the first iteration."""
    return _repeated(compressor, nothing_found(compressor.gas, _OPTIONS))


def _orbit_of(compressor: Compressor, cycle: Cycle | SeveralCycles, solver) -> Orbit:
    """The motion of the crank under the pressure of a cycle."""
    return solver.solve(replaced(compressor, gas=cycle.gas()))


def _motion(compressor: Compressor, orbit: Orbit):
    """Logarithm of the mean speed, and harmonics of the time that a crank angle takes."""
    guess = compressor.motor.speed_guess
    # less its mean: the quadrature is none for a harmonic alone
    excess = orbit.mean_speed / orbit.state.speed - 1
    phase = jnp.arange(1, HARMONICS + 1)[:, None] * orbit.state.angle
    weight = orbit.weight * excess / jnp.pi
    harmonics = [jnp.cos(phase) @ weight, jnp.sin(phase) @ weight]
    return jnp.concatenate([jnp.log(orbit.mean_speed / guess)[None], *harmonics])
