r"""`simulate`: methods of diffrax by tolerance over a run-up from rest, beside SciPy.

The machine has its own motor if that is a torque law over speed, otherwise one of 10 % slip through the
mean torque of its steady running state. The error is that of the speed at 201 instants, over the largest.
"""

from functools import cache, partial

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from .._fields import BadInput
from ..compressor import Compressor
from ..crank import TimeIntegration, acceleration, simulate
from ._extremes import with_slip
from ._measure import Program
from ._report import Reference
from ._study import Call, Question, Setting, Solved, Study

_SLIP, _REVOLUTIONS, _INSTANTS = 0.1, 3.0, 201
_DIFFRAX = {
    "Tsit5": (1e-3, 1e-5, 1e-7, 1e-9),
    "Dopri8": (1e-3, 1e-5, 1e-7, 1e-9),
    "Bosh3": (1e-2, 1e-3, 1e-4),
    "Kvaerno3": (1e-2, 1e-3, 1e-4),
    "Kvaerno5": (1e-3, 1e-5, 1e-7),
}
_ORDINARY = ("Tsit5", "Dopri8", "Kvaerno5")
_SCIPY = (1e-5, 1e-7)
_TIGHT = 1e-11


def transient_study(question: Question, thorough: bool) -> Study:
    """Methods of the time integration.

    Raises:
        BadInput: neither a torque law nor a periodic state to make one from.
    """
    given = question.compressor
    assert given is not None
    machine = given if given.motor.closes == "torque" else with_slip(given, _SLIP)
    if machine is None:
        bound = "a torque law over speed, for a machine without a periodic state"
        raise BadInput("motor", type(given.motor).__name__, bound)
    duration = _REVOLUTIONS * 2 * np.pi / float(machine.motor.speed_guess)

    @cache
    def program(name):
        def speeds(machine, tolerance):
            options = TimeIntegration(getattr(diffrax, name)(), tolerance, 1 << 17, _INSTANTS)
            found = simulate(machine, jnp.asarray(duration), until_rest=False, options=options,
                             throw=False)  # fmt: skip
            return Solved(found.state.speed, found.steps, True, found.status)

        return Program(speeds, machine, jnp.asarray(1e-5))

    def call(name, tolerance):
        return Call(program(name).on(machine, jnp.asarray(tolerance)), program(name))

    def reference():
        found = call("Dopri8", _TIGHT).run()
        if found.why:
            raise BadInput("machine", found.why, "one that runs up from rest")
        other = _by_scipy(machine, duration, _TIGHT)
        return Reference(np.asarray(found.value), other, ("Dopri8", "SciPy's DOP853"))

    settings = [
        Setting(name, f"tolerance={tol:g}", partial(call, name, tol), (-np.log10(tol),))
        for name, tolerances in _DIFFRAX.items()
        if thorough or name in _ORDINARY
        for tol in tolerances
    ]
    settings += [
        Setting("SciPy", f"DOP853 rtol={tol:g}",
                lambda tol=tol: Call(partial(_by_scipy, machine, duration, tol)), (-np.log10(tol),))
        for tol in _SCIPY
    ]  # fmt: skip
    note = f"run-up from rest over the time of {_REVOLUTIONS:g} revolutions"
    return Study(reference, tuple(settings), note)


@eqx.filter_jit
def _rate(machine: Compressor, angle, speed):
    rise, _, _ = acceleration(machine, angle, speed, machine.motor.torque(speed))
    return jnp.stack([speed, rise])


def _by_scipy(machine: Compressor, duration: float, tolerance: float):
    """[rad/s] (instants,) speeds by a Python loop around the compiled law of motion."""
    arrays, rest = eqx.partition(machine, eqx.is_array)
    rate = jax.jit(lambda a, y: _rate(eqx.combine(a, rest), y[0], y[1]))
    scale = float(machine.motor.speed_guess)
    done = solve_ivp(lambda t, y: np.asarray(rate(arrays, y)), (0.0, duration), np.zeros(2),
                     method="DOP853", rtol=tolerance, atol=tolerance * np.array([1.0, scale]),
                     t_eval=np.linspace(0.0, duration, _INSTANTS))  # fmt: skip
    if not done.success:
        raise RuntimeError(done.message)
    return done.y[1]
