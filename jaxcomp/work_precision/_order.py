r"""Orders of convergence: fixed steps of diffrax on a stretch of the revolution without kinks.

Across a kink no method keeps its order, so the equation of motion is integrated from the periodic
state over the longest stretch between kinks and load reversals. The reference is the orbit by
collocation, beside an eighth-order method with many steps.
"""

from functools import cache, partial
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._status import Status
from ..compressor import Compressor, kink_angles
from ..crank import Collocation, acceleration, solve_orbit
from ._measure import Program
from ._report import Order, Reference, observed_order
from ._study import Call, Question, Setting, Solved, Study

_STEPS = (1, 2, 3, 4, 5, 6, 8, 16, 32, 64, 128)
_MANY = 512
# [-] Errors that may be rounding: a hundred steps leave 1e-14.
_ROUNDING = 5e-14
# [-] Share of the stretch left out at either end: a load reversal is only bracketed by two nodes.
_MARGIN = 0.05
# Integrations that are tried, beginning in the first third of the stretch.
_STARTS = 6
# Of the implicit stages. Closer to rounding their iteration sees no contraction and gives up.
_ROOTS = {"rtol": 1e-11, "atol": 1e-11}

# Orders of the methods: those of their classes.
_METHODS = ("Euler", "Heun", "Bosh3", "Dopri5", "Tsit5", "Dopri8", "Kvaerno3", "Kvaerno5")
# The implicit methods take a minute to compile.
_ORDINARY = ("Heun", "Bosh3", "Tsit5", "Dopri8")


class _Stretch(NamedTuple):
    """A stretch of the periodic state.

    Attributes:
        starts: [rad] (s,) angles at which integrations begin: an error that changes its sign with the
            number of steps is hidden at one of them, not at all.
        first: [rad/s] (s,) speed there.
        high: [rad] where they end.
        last: [rad/s] speed there.
        level: [-] of the motor torque.
    """

    starts: Float[Array, " s"]
    first: Float[Array, " s"]
    high: Float[Array, ""]
    last: Float[Array, ""]
    level: Float[Array, ""]


def order_study(question: Question, thorough: bool) -> Study:
    """Methods of diffrax by number of steps; errors are of the speed at the end of the stretch."""
    machine = question.compressor
    assert machine is not None
    stretch = _longest_stretch(machine, question.load_reversals)
    names = _METHODS if thorough else _ORDINARY

    def reference():
        other = programs["Dopri8"]()(machine, stretch, jnp.asarray(_MANY))
        methods = "collocation, 24 nodes", f"Dopri8, {_MANY} steps"
        return Reference(float(stretch.last), float(other.value), methods)

    def orders(rows, reference):
        found = {}
        for name in names:
            mine = [row for row in rows if row.method == name]
            order = observed_order(
                [row.iterations for row in mine],
                [row.error for row in mine],
                max(5 * reference.floor, _ROUNDING),
            )
            expected = _solver(name).order(diffrax.ODETerm(lambda t, y, args: y))
            found[name] = Order(int(expected), order)
        return found

    programs = {name: cache(partial(_program, machine, stretch, name)) for name in names}

    def prepare(name, steps):
        program = programs[name]()
        return Call(program.on(machine, stretch, jnp.asarray(steps)), program)

    settings = tuple(
        Setting(name, f"{steps} steps", partial(prepare, name, steps), (float(steps),))
        for name in names
        for steps in _STEPS
    )
    ends = (np.rad2deg(float(x)) for x in (stretch.starts[0], stretch.high))
    note = "fixed steps from {:.0f} to {:.0f}°".format(*ends)
    return Study(reference, settings, note, orders)


def _solver(name: str) -> diffrax.AbstractSolver:
    made = getattr(diffrax, name)
    return made(root_finder=diffrax.VeryChord(**_ROOTS)) if name[:2] == "Kv" else made()


def _program(machine, stretch, name):
    def worst(machine, stretch, steps):
        """Of all starts, the last speed that is furthest off."""
        over = jax.vmap(
            lambda low, first: _integrate(machine, stretch, low, first, _solver(name), steps)
        )
        speeds, ended = over(stretch.starts, stretch.first)
        status = Status.where(jnp.all(ended), Status.converged, Status.not_converged)
        return Solved(speeds[jnp.argmax(jnp.abs(speeds - stretch.last))], steps, True, status)

    return Program(worst, machine, stretch, jnp.asarray(_STEPS[0]))


def _integrate(
    machine: Compressor, stretch: _Stretch, low, first, solver: diffrax.AbstractSolver, steps
):
    """[rad/s] speed at the end of the stretch by a number of equal steps, and whether they ended."""
    scale, level = machine.motor.speed_guess, stretch.level

    def rate(angle, y, args):
        del args
        speed = y * scale
        rise, _, _ = acceleration(machine, angle, speed, level * machine.motor.torque(speed))
        return rise / speed / scale

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        solver,
        t0=low,
        t1=stretch.high,
        dt0=(stretch.high - low) / steps,
        y0=first / scale,
        max_steps=2 * _MANY,
        stepsize_controller=diffrax.ConstantStepSize(),
        throw=False,
    )
    assert found.ys is not None
    return found.ys[-1] * scale, found.result == diffrax.RESULTS.successful


def _longest_stretch(machine: Compressor, reversals: int) -> _Stretch:
    """The longest stretch of the periodic state without kinks and load reversals."""
    orbit = solve_orbit(machine, Collocation(nodes=24, reversals=reversals))
    angle = np.asarray(orbit.state.angle)
    sides = np.sign(np.concatenate([orbit.loads.kinks, orbit.loads.minima]))
    changed = np.any(sides[:, 1:] != sides[:, :-1], axis=0)
    between = (angle[1:] + angle[:-1]) / 2
    first = np.asarray(kink_angles(machine))
    edges = np.sort(np.concatenate([first, first[:1] + 2 * np.pi, between[changed]]))
    longest = int(np.argmax(np.diff(edges)))
    low, high = edges[longest : longest + 2]
    low, high = low + _MARGIN * (high - low), high - _MARGIN * (high - low)
    # ends at nodes: the solution there needs no interpolation
    inside = np.flatnonzero((angle >= low) & (angle <= high))
    starts, end = inside[: inside.size // 3 : max(1, inside.size // (3 * _STARTS))], inside[-1]
    speed, torque = jnp.asarray(orbit.state.speed), orbit.motor_torque
    level = torque[end] / machine.motor.torque(speed[end])
    return _Stretch(
        jnp.asarray(angle[starts]), speed[starts], jnp.asarray(angle[end]), speed[end], level
    )
