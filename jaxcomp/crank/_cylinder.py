"""Crank and cylinder together: pressure and speed of one revolution, each from the other.

The speed enters the cylinder through the time that every crank angle takes, and the pressure the
crank as any prescribed gas does. The cycle is marched once at constant speed; from then on one
Newton solve of the cycle and one orbit make a pass. A pass contracts by the relative change of the
work with speed times the fluctuation, about 0.02 on ordinary machines; the mean speed of a
motor with a torque curve is found with it. Derivatives follow from the implicit function theorem.

Of the speed the cylinder sees its mean and twelve harmonics; what they leave out is about a hundredth of
the fluctuation, at the corners that the valves make.
"""

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from .._implicit import AbstractFixedPoint, fixed_point, settle
from .._status import Status
from ..compressor import Compressor
from ..cylinder import Cycle, CycleOptions, Cylinder, solve_cycle
from ..motor import ConstantSpeed
from ._orbit import Orbit

HARMONICS = 12  # of the time over the crank angle, whose acceleration has kinks
_OPTIONS = CycleOptions(panels=40)


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
    else:
        motion, (start, report) = fixed_point(_Coupling(solver), compressor)
        cycle, settled = _cycle_at(compressor, motion, start), report.settled
    orbit = _orbit_of(compressor, cycle, solver)
    status = Status.where(settled, orbit.status, Status.not_converged)
    status = Status.where(cycle.converged, status, cycle.status)
    return eqx.tree_at(
        lambda o: (o.status, o.cycle), orbit, (status, cycle), is_leaf=lambda leaf: leaf is None
    )


class _Coupling(AbstractFixedPoint):
    """The motion that the pressure it causes itself gives the crank.

    The unknowns are the logarithm of the mean speed over the motor's guess, and harmonics of the time
    that a crank angle takes.
    """

    solver: eqx.Module
    tolerance: float = 1e-10
    max_iterations: int = eqx.field(static=True, default=20)

    def solve(self, parameters):
        compressor = lax.stop_gradient(parameters)
        first = _first_cycle(compressor)
        begin = _motion(compressor, _orbit_of(compressor, first, self.solver))

        def step(motion):
            return self.step(compressor, (first,), motion), None

        motion, _, report = settle(step, begin, None, self.tolerance, self.max_iterations)
        return motion, (first, report)

    def step(self, parameters, data, unknowns):
        cycle = _cycle_at(parameters, unknowns, data[0])
        return _motion(parameters, _orbit_of(parameters, cycle, self.solver))


def _first_cycle(compressor: Compressor) -> Cycle:
    speed = compressor.motor.speed_guess
    return solve_cycle(compressor.gas, compressor.mechanism, speed, _OPTIONS, throw=False)


def _cycle_at(compressor: Compressor, motion, start: Cycle) -> Cycle:
    """The cycle at a motion of the crank, from a similar one."""
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
