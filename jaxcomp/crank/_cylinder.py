"""Crank and cylinder together: pressure and speed of one revolution, each from the other.

The speed enters the cylinder through the time that every crank angle takes, and the pressure the
crank as any prescribed gas does. The cycle is marched once at constant speed; from then on one
Newton solve of the cycle and one orbit make an iteration. It contracts by the relative change of the
work with speed times the fluctuation, about 0.02 on ordinary machines; the mean speed of a
motor with a torque curve is found with it. Derivatives follow from the implicit function theorem, with
the iteration linearised once.

Of the speed the cylinder sees its mean and twelve harmonics; what they leave out is about a hundredth of
the fluctuation, at the corners that the valves make.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from .._implicit import frozen, settle
from .._status import Status
from ..compressor import Compressor
from ..cylinder import Cycle, CycleOptions, Cylinder, solve_cycle
from ..motor import ConstantSpeed
from ._orbit import Orbit

HARMONICS = 12  # of the time over the crank angle, whose acceleration has kinks
_OPTIONS = CycleOptions(panels=40, nodes=8)
_TOLERANCE, _MAX_ITERATIONS, _MAX_ROUNDS = 1e-10, 20, 3
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
        cycle, settled = _first_cycle(compressor), jnp.asarray(True)
        orbit = _orbit_of(compressor, cycle, solver)
    else:
        (cycle, orbit), *_, settled = _coupled(compressor, solver)
    status = Status.where(settled, orbit.status, Status.not_converged)
    status = Status.where(cycle.converged, status, cycle.status)
    return eqx.tree_at(
        lambda o: (o.status, o.cycle), orbit, (status, cycle), is_leaf=lambda leaf: leaf is None
    )


@eqx.filter_custom_jvp
def _coupled(compressor: Compressor, solver):
    """Cycle and orbit that agree; then motion and first cycle, and whether the iteration converged.

    The unknowns are the logarithm of the mean speed over the motor's guess, and harmonics of the time
    that a crank angle takes.
    """
    compressor = frozen(compressor)

    def attempt(carry):
        motion, *_, rounds = carry
        first = _first_cycle(compressor, motion)

        def step(motion):
            return _iteration(compressor, solver, first, motion)

        beside = _empty(eqx.filter_eval_shape(step, motion)[1])
        motion, found, report = settle(step, motion, beside, _TOLERANCE, _MAX_ITERATIONS)
        return motion, found, first, report.settled, rounds + 1

    def going_on(carry):
        # the fluctuation of the speed has changed the events: march again at the motion found so far
        _, (cycle, _), _, _, rounds = carry
        lost = (cycle.status == Status.not_converged) | (cycle.status == Status.too_many_events)
        return (rounds == 0) | (lost & (rounds < _MAX_ROUNDS))

    begin = jnp.zeros(1 + 2 * HARMONICS), None, None, None, jnp.zeros((), int)
    shapes = eqx.filter_eval_shape(attempt, begin)
    carry = (begin[0], *_empty(shapes[1:4]), begin[4])
    motion, found, first, settled, _ = lax.while_loop(going_on, attempt, carry)
    return found, motion, first, settled


def _empty(shapes):
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)


@_coupled.def_jvp
def _coupled_jvp(primals, tangents):
    compressor, solver = primals
    out = _coupled(compressor, solver)
    _, motion, first, _ = out
    numbers, rest = eqx.partition(compressor, eqx.is_inexact_array)

    def iteration(numbers, motion):
        made = _iteration(eqx.combine(numbers, rest), solver, frozen(first), motion)
        return eqx.filter(made, eqx.is_inexact_array)

    _, linear = jax.linearize(iteration, numbers, motion)
    given = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, numbers, tangents[0])

    none, still = jax.tree.map(jnp.zeros_like, numbers), jnp.zeros_like(motion)

    def solve(matvec, right_side):
        def closer(_, value):
            return value + right_side - matvec(value)

        return lax.fori_loop(0, _TANGENT_ITERATIONS, closer, right_side)

    moved = lax.custom_linear_solve(
        lambda v: v - linear(none, v)[0], linear(given, still)[0], solve, transpose_solve=solve
    )
    found = linear(given, moved)[1]
    return out, (found, moved, *(jax.tree.map(lambda _: None, one) for one in out[2:]))


def _iteration(compressor: Compressor, solver, first: Cycle, motion):
    """The motion that the pressure it causes gives the crank, with cycle and orbit."""
    cycle = _cycle_at(compressor, motion, first)
    orbit = _orbit_of(compressor, cycle, solver)
    return _motion(compressor, orbit), (cycle, orbit)


def _first_cycle(compressor: Compressor, motion=None) -> Cycle:
    """The cycle at a motion of the crank, or at constant speed, from a march."""
    if motion is not None:
        return _cycle_at(compressor, motion, None)
    speed = compressor.motor.speed_guess
    return solve_cycle(compressor.gas, compressor.mechanism, speed, _OPTIONS, throw=False)


def _cycle_at(compressor: Compressor, motion, start: Cycle | None) -> Cycle:
    """The cycle at a motion of the crank, from a similar one or a march."""
    cosine, sine = motion[1:].reshape(2, HARMONICS)
    return solve_cycle(
        compressor.gas,
        compressor.mechanism,
        compressor.motor.speed_guess * jnp.exp(motion[0]),
        _OPTIONS,
        fluctuation=(cosine, sine),
        start=start,
        throw=False,
    )


def _orbit_of(compressor: Compressor, cycle: Cycle, solver) -> Orbit:
    """The motion of the crank under the pressure of a cycle."""
    return solver.solve(eqx.tree_at(lambda c: c.gas, compressor, cycle.gas()))


def _motion(compressor: Compressor, orbit: Orbit):
    """Logarithm of the mean speed, and harmonics of the time that a crank angle takes."""
    guess = compressor.motor.speed_guess
    # less its mean: the quadrature is none for a harmonic alone
    excess = orbit.mean_speed / orbit.state.speed - 1
    phase = jnp.arange(1, HARMONICS + 1)[:, None] * orbit.state.angle
    weight = orbit.weight * excess / jnp.pi
    harmonics = [jnp.cos(phase) @ weight, jnp.sin(phase) @ weight]
    return jnp.concatenate([jnp.log(orbit.mean_speed / guess)[None], *harmonics])
