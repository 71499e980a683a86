r"""Methods of diffrax in time: orders of convergence by fixed steps, and the run-up of `simulate`.

Across a kink no method keeps its order, so `order_study` integrates the equation of motion from the
periodic state over the longest stretch between kinks and load reversals. Its reference is the orbit by
collocation, beside an eighth-order method with many steps.

`transient_study` runs a machine up from rest by tolerance, beside SciPy. The machine has its own motor
if that is a torque law over speed, otherwise one of 10 % slip through the mean torque of its steady
running state. The error is that of the speed at 201 instants, over the largest.
"""

from functools import partial
from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.integrate import solve_ivp

from jaxcomp import BadInput, Collocation, TimeIntegration, simulate, solve_orbit
from jaxcomp._core.status import Status
from jaxcomp.compressor import Compressor, kink_angles
from jaxcomp.crank._crank_motion import acceleration
from jaxcomp.study.accuracy import Report
from jaxcomp.study.accuracy._extremes import with_slip
from jaxcomp.study.accuracy._report import Reference
from jaxcomp.study.accuracy._study import (
    Call,
    Compiled,
    Question,
    Setting,
    Solved,
    Study,
    digits,
    series,
)

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
# All methods, and those without the implicit ones, which take a minute to compile.
_FIXED = {
    True: ("Euler", "Heun", "Bosh3", "Dopri5", "Tsit5", "Dopri8", "Kvaerno3", "Kvaerno5"),
    False: ("Heun", "Bosh3", "Tsit5", "Dopri8"),
}

_SLIP, _REVOLUTIONS, _INSTANTS = 0.1, 3.0, 201
_ADAPTIVE = {
    "Tsit5": (1e-3, 1e-5, 1e-7, 1e-9),
    "Dopri8": (1e-3, 1e-5, 1e-7, 1e-9),
    "Bosh3": (1e-2, 1e-3, 1e-4),
    "Kvaerno3": (1e-2, 1e-3, 1e-4),
    "Kvaerno5": (1e-3, 1e-5, 1e-7),
}
_ORDINARY = ("Tsit5", "Dopri8", "Kvaerno5")
_SCIPY = (1e-5, 1e-7)
_TIGHT = 1e-11


class Order(NamedTuple):
    """Convergence of a method of known order.

    Attributes:
        expected: order of the method.
        observed: [-] slope of error over step in logarithms.
    """

    expected: int
    observed: float


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
    machine = question.crank
    stretch = _longest_stretch(machine, question.load_reversals)
    programs = {name: Compiled(partial(_worst_end, _solver(name))) for name in _FIXED[thorough]}

    def call(name, steps):
        return programs[name].call(machine, stretch, jnp.asarray(steps))

    def reference():
        other = call("Dopri8", _MANY).run()
        methods = "collocation, 24 nodes", f"Dopri8, {_MANY} steps"
        return Reference(float(stretch.last), float(other.value), methods)

    settings: list[Setting] = []
    for name in programs:
        settings += series(name, "{} steps", partial(call, name), _STEPS, float)
    ends = (np.rad2deg(float(x)) for x in (stretch.starts[0], stretch.high))
    note = "fixed steps from {:.0f} to {:.0f}°".format(*ends)
    return Study(reference, tuple(settings), note)


# Settings from which an order is read: the coarser ones may not be on the slope yet.
_ON_SLOPE = 4


def observed_order(steps, errors, floor: float) -> float:
    """Slope of the logarithm of the error over that of the step, of the finest steps above a floor.

    NaN with fewer than two errors above the floor, which is rounding or the error of the reference.
    """
    steps, errors = np.asarray(steps, float), np.asarray(errors, float)
    good = np.flatnonzero(np.isfinite(errors) & (errors > floor))[-_ON_SLOPE:]
    if good.size < 2:
        return float("nan")
    return float(-np.polyfit(np.log(steps[good]), np.log(errors[good]), 1)[0])


def orders(report: Report) -> dict[str, Order]:
    """Expected and observed order of each method of `order_study`."""
    floor, found = max(5 * report.reference.floor, _ROUNDING), {}
    for name in report.methods:
        own = [row for row in report.rows if row.method == name]
        order = observed_order([r.iterations for r in own], [r.error for r in own], floor)
        expected = _solver(name).order(diffrax.ODETerm(lambda t, y, args: y))
        found[name] = Order(int(expected), order)
    return found


def _solver(name: str) -> diffrax.AbstractSolver:
    made = getattr(diffrax, name)
    return made(root_finder=diffrax.VeryChord(**_ROOTS)) if name[:2] == "Kv" else made()


def _worst_end(solver: diffrax.AbstractSolver, machine: Compressor, stretch: _Stretch, steps):
    """Of all starts, the last speed that is furthest off."""
    scale, level = machine.motor.speed_guess, stretch.level

    def rate(angle, y, args):
        del args
        speed = y * scale
        rise, _, _ = acceleration(machine, angle, speed, level * machine.motor.torque(speed))
        return rise / speed / scale

    def march(low, first):
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

    speeds, ended = jax.vmap(march)(stretch.starts, stretch.first)
    status = Status.where(jnp.all(ended), Status.converged, Status.not_converged)
    return Solved(speeds[jnp.argmax(jnp.abs(speeds - stretch.last))], steps, True, status)


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


def transient_study(question: Question, thorough: bool) -> Study:
    """Methods of the time integration.

    Raises:
        BadInput: neither a torque law nor a periodic state to make one from.
    """
    given = question.crank
    machine = given if given.motor.closes == "torque" else with_slip(given, _SLIP)
    if machine is None:
        bound = "a torque law over speed, for a machine without a periodic state"
        raise BadInput("motor", type(given.motor).__name__, bound)
    scale = float(machine.motor.speed_guess)
    duration = _REVOLUTIONS * 2 * np.pi / scale

    def speeds(method, machine, tolerance):
        options = TimeIntegration(method, tolerance, 1 << 17, _INSTANTS)
        found = simulate(machine, jnp.asarray(duration), until_rest=False, options=options,
                         throw=False)  # fmt: skip
        return Solved(found.state.speed, found.steps, True, found.status)

    programs = {name: Compiled(partial(speeds, getattr(diffrax, name)())) for name in _ADAPTIVE}

    def call(name, tolerance):
        return programs[name].call(machine, jnp.asarray(tolerance))

    arrays, rest = eqx.partition(machine, eqx.is_array)

    @jax.jit
    def rate(arrays, y):
        machine = eqx.combine(arrays, rest)
        rise, _, _ = acceleration(machine, y[0], y[1], machine.motor.torque(y[1]))
        return jnp.stack([y[1], rise])

    def by_scipy(tolerance):
        return Call(partial(_speeds_by_scipy, partial(rate, arrays), scale, duration, tolerance))

    def reference():
        found = call("Dopri8", _TIGHT).run()
        if found.why:
            raise BadInput("machine", found.why, "one that runs up from rest")
        methods = "Dopri8", "SciPy's DOP853"
        return Reference(np.asarray(found.value), by_scipy(_TIGHT).run(), methods)

    settings: list[Setting] = []
    for name, tolerances in _ADAPTIVE.items():
        if thorough or name in _ORDINARY:
            settings += series(name, "tolerance={:g}", partial(call, name), tolerances, digits)
    settings += series("SciPy", "DOP853 rtol={:g}", by_scipy, _SCIPY, digits)
    note = f"run-up from rest over the time of {_REVOLUTIONS:g} revolutions"
    return Study(reference, tuple(settings), note)


def _speeds_by_scipy(rate, scale: float, duration: float, tolerance: float):
    """[rad/s] (instants,) speeds by a Python loop around the compiled law of motion."""
    done = solve_ivp(lambda t, y: np.asarray(rate(y)), (0.0, duration), np.zeros(2),
                     method="DOP853", rtol=tolerance, atol=tolerance * np.array([1.0, scale]),
                     t_eval=np.linspace(0.0, duration, _INSTANTS))  # fmt: skip
    if not done.success:
        raise RuntimeError(done.message)
    return done.y[1]
