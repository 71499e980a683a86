"""Crank motion in time: run-up from rest, running, power-off and stop."""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.declared import (
    Record,
    computed,
    computed_part,
    computed_word,
    held,
    reading,
    word,
)
from .._core.errors import BadInput
from .._core.evidence import Check, ended, is_small
from .._core.exported import kept_jit
from .._core.extremes import max_of, minimum
from .._core.fields import admissible, clipped, is_traced, replaced
from .._core.results import Data, Result
from .._core.roots import zeros_of
from .._core.status import SolveFailed, Status
from ..compressor import Compressor, HasCompressor, compressor_of, instants
from ..cylinder import Cylinder
from ..cylinder._cycle import values_only
from ..mechanism import CrankState
from ._integration import TimeIntegration
from ._journals import orbiting_journals
from ._orbit import Energy
from ._performance import law_of
from ._solve_orbit import solve_orbit
from ._transient_gas import DenseSteps, GasCourse, crank_rates, march_with_gas
from ._warming import at_rise


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class CrankCourse(Result):
    """Course of a crank's motion at n instants.

    Attributes:
        time: [s] (n,)
        angle: [rad] (n,) since the start, not wrapped.
        speed: [rad/s] (n,)
        acceleration: [rad/s^2] (n,)
        motor_work, gas_work: [J] (n,) since the start.
        losses: [J] (n,) since the start, by joint.
        kinetic_energy: [J] (n,)
    """

    time: Float[Array, " n"] = reading("s", "time")
    angle: Float[Array, " n"] = reading("rad", "time", doc="since the start, not wrapped")
    speed: Float[Array, " n"] = reading("rad/s", "time")
    acceleration: Float[Array, " n"] = reading("rad/s^2", "time", table_only=True)
    motor_work: Float[Array, " n"] = reading("J", "time", table_only=True)
    gas_work: Float[Array, " n"] = reading("J", "time", table_only=True)
    losses: dict[str, Float[Array, " n"]] = reading("J", "time", table_only=True)
    kinetic_energy: Float[Array, " n"] = reading("J", "time", table_only=True)

    table_dims: ClassVar[tuple[str, ...]] = ("time",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from self.data_of("time", crank_angle="angle")
        yield from self.data_of("speed", "acceleration", "motor_work", "gas_work")
        yield from self.members_of(loss="losses")
        yield from self.data_of("kinetic_energy")


@dataclasses.dataclass(frozen=True)
class GasExtremes(Record):
    """Gas that was delivered [kg], and highest pressure [Pa] and temperature [K] in a cylinder."""

    delivered_mass: Any = reading("kg")
    highest_pressure: Any = reading("Pa")
    highest_temperature: Any = reading("K")


class Transient(Result, eqx.Module):
    """Crank motion over time.

    Attributes:
        time: [s] listed instants, shape (n,).
        state: crank angle [rad], speed [rad/s], acceleration [rad/s^2] there, shape (n,).
        energy: work since the start [J], every entry of shape (n,).
        kinetic_energy: [J] shape (n,).
        stopped: whether the crank came to rest before the end.
        end_time: [s] the end asked for, or the instant of rest.
        steps: steps of the integrator.
        status: `Status.converged` if the end or the rest was reached.
        positions: [-] (2, n) centres of the journals that move over their clearances, by joint.
        gas: the gas in cylinders with valves; `None` where the pressure is prescribed.

    Files of `save` leave out the dense output, which `at` reads.
    """

    time: Float[Array, " n"]
    state: CrankState
    energy: Energy
    kinetic_energy: Float[Array, " n"]
    stopped: Bool[Array, ""] = word()
    end_time: Float[Array, ""] = reading("s")
    steps: Int[Array, ""] = reading("")
    status: Status = held()
    positions: dict[str, Float[Array, "2 n"]] = held()
    _dense: Any = held()
    _scales: tuple[Float[Array, ""], Float[Array, ""]] = held()
    gas: GasCourse | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("time",)
    not_saved: ClassVar[tuple[str, ...]] = ("_dense",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield from self.data_of("end_time")
        yield Data("stopped", "", self.stopped)
        yield from self.course.described()
        for name, (x, y) in self.positions.items():
            yield Data(f"eccentricity.{name}", "", jnp.hypot(x, y), at, "over the clearance")
        if self.gas is not None:
            yield from _of_gas(self.gas, at)

    @computed_part(CrankCourse)
    def course(self) -> CrankCourse:
        """Motion, works and kinetic energy at the listed instants."""
        # the works are those of the whole course; the properties below have their ends
        return CrankCourse(
            time=self.time,
            angle=self.state.angle,
            speed=self.state.speed,
            acceleration=self.state.acceleration,
            motor_work=self.energy.motor_work,
            gas_work=self.energy.gas_work,
            losses=self.energy.losses,
            kinetic_energy=self.kinetic_energy,
        )

    @computed("")
    def revolutions(self) -> Any:
        """[-] Revolutions of the crank since the start."""
        angle = np.asarray(self.state.angle)
        return (angle[-1] - angle[0]) / (2 * np.pi)

    @computed("rad")
    def end_angle(self) -> Any:
        """[rad] Crank angle at the end."""
        return self.state.angle[-1]

    @computed("rad/s")
    def end_speed(self) -> Any:
        """[rad/s] Speed at the end."""
        return self.state.speed[-1]

    @computed("rad/s")
    def highest_speed(self) -> Any:
        """[rad/s] Highest speed at a listed instant."""
        return np.max(self.state.speed)

    @computed("s")
    def time_of_highest_speed(self) -> Any:
        """[s] Instant of the highest speed."""
        return self.time[np.argmax(self.state.speed)]

    @computed("J")
    def motor_work(self) -> Any:
        """[J] Work of the motor up to the end."""
        return self.energy.motor_work[-1]

    @computed("J")
    def gas_work(self) -> Any:
        """[J] Work of the gas up to the end."""
        return self.energy.gas_work[-1]

    @computed("J")
    def losses(self) -> dict[str, Any]:
        """[J] Losses up to the end, by joint."""
        return {name: work[-1] for name, work in self.energy.losses.items()}

    @computed("J")
    def kinetic_energy_gained(self) -> Any:
        """[J] Kinetic energy at the end less that at the start."""
        return self.kinetic_energy[-1] - self.kinetic_energy[0]

    @computed("")
    def energy_residual(self) -> Any:
        """[-] Residual of the energy up to the end, see `residual`."""
        return self.residual[-1]

    @computed_part(GasExtremes, inline=True, optional=True)
    def gas_extremes(self) -> GasExtremes | None:
        """Gas delivered, and its extremes; `None` where the pressure is prescribed."""
        if self.gas is None:
            return None
        return GasExtremes(
            delivered_mass=self.gas.delivered,
            highest_pressure=np.max(self.gas.pressure),
            highest_temperature=np.max(self.gas.temperature),
        )

    @computed_word()
    def converged(self) -> Bool[Array, ""]:
        """Whether the end or the rest was reached."""
        return self.status == Status.converged

    @computed_word(key="status")
    def status_word(self) -> str:
        """Status in words."""
        return Status[self.status]

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of the integration; `tolerance` is that of the integrator."""
        return (
            ended("Solution", Status[self.status], bool(self.converged)),
            is_small("Energy closure", float(self.energy_residual), tolerance),
        )

    @property
    def residual(self) -> Float[Array, " n"]:
        """[-] work that is neither in the motion, the gas nor the losses, over the work done."""
        gained = self.kinetic_energy - self.kinetic_energy[0]
        work = self.energy.motor_work - self.energy.gas_work - self.energy.total_loss
        # a machine that coasts has no work of the motor, one that starts no energy to begin with
        size = max_of(jnp.abs(self.energy.motor_work)) + max_of(self.kinetic_energy)
        return (work - gained) / size

    def at(self, time: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Angle [rad] and speed [rad/s] at any time [s] up to the end, by dense output.

        Raises:
            BadInput: a result that was read from a file, which has the listed instants alone.
        """
        if self._dense is None:
            raise BadInput("transient", "read from a file", "as `simulate` returned it")
        y = self._dense.evaluate(minimum(time, self.end_time))
        return y["angle"], y["speed"] * self._scales[0]


def simulate(
    machine: Compressor | HasCompressor,
    duration: float | Float[Array, ""],
    *,
    angle: float | Float[Array, ""] = 0.0,
    speed: float | Float[Array, ""] = 0.0,
    power_off: float | Float[Array, ""] | None = None,
    until_rest: bool = True,
    options: TimeIntegration | None = None,
    throw: bool = True,
) -> Transient:
    """Integrate the crank in time.

    Derivatives pass through the integration, but leave out that the instants move at which friction
    jumps, at the dead centres: an error of 3e-4 to 3e-3 on the machine of Tsuji et al. Those of
    `solve_orbit` have no such error. Cylinders with valves begin with the gas of the suction line, and
    have no derivatives; lines with the same pressure make a start with equalised pressures. Pressures
    between stages are held, and have to be given.

    Args:
        machine: a compressor, a machine or a scene; its motor must have a torque law over speed.
        duration: [s] time to integrate.
        angle: [rad] crank angle at the start.
        speed: [rad/s] speed at the start; zero starts from rest.
        power_off: [s] instant at which the motor is switched off, if any.
        until_rest: end where the crank stops. Coulomb friction has no meaning beyond; a
            regularised law creeps on, or swings back under the gas, if this is false.
        options: the integrator, `TimeIntegration()` if absent.
        throw: raise if the end is not reached (not within `jit` or `vmap`; see `status` there).

    Suction gas that a law of warming heats has the rise of the periodic state throughout.

    Raises:
        BadInput: if the motor holds a speed, since that is no torque law.
        SolveFailed: if `throw` and the integration did not reach its end.

    >>> from jaxcomp import load
    >>> from jaxcomp.scene import with_value
    >>> motor = {"type": "slip_line", "slope": "20 N m s", "synchronous_speed": "1000 rpm"}
    >>> run_up = simulate(with_value(load("mayekawa-wbhe"), "motor", motor), 0.5)
    >>> angle, speed = run_up.at(0.5)
    >>> print(f"{speed * 30 / jnp.pi:.0f} rpm after {angle / (2 * jnp.pi):.1f} turns from rest")
    917 rpm after 8.0 turns from rest
    """
    compressor = compressor_of(machine)
    if compressor.motor.closes != "torque":
        raise BadInput(
            "motor",
            type(compressor.motor).__name__,
            "a torque law over speed (ConstantTorque, SlipLine, Kloss)",
        )
    valves = isinstance(compressor.gas, Cylinder)
    if options is None:
        options = TimeIntegration()
    if isinstance(duration, (int, float)) and not duration > 0:
        raise BadInput("duration", duration, "> 0")
    off = jnp.inf if power_off is None else power_off
    # arrays, so that another duration or speed is no program of its own
    start = tuple(
        jnp.asarray(x, dtype=jnp.result_type(float)) for x in (duration, angle, speed, off)
    )
    if law_of(compressor) is not None:  # of a shell that the run is too short to warm
        steady = solve_orbit(compressor, throw=throw).cycle
        assert steady is not None
        compressor = at_rise(compressor, steady.case.suction.T - steady.case.comes.T)
    # events of valves need a march of their own
    solve = _simulate_gas if valves else _simulate
    result = solve(compressor, options, until_rest, *start)
    concrete = not is_traced(result.status._value)
    if throw and concrete and bool(result.status != Status.converged):
        raise SolveFailed(
            result.status,
            f"reached t = {float(result.end_time):.4g} s after {int(result.steps)} steps",
        )
    return result


@kept_jit
def _simulate(
    machine: Compressor, options: TimeIntegration, until_rest, duration, angle, speed, off
):
    good = admissible(machine)
    compressor = clipped(machine)
    # every state is of the size of one, so that one tolerance serves them all
    speed_scale = compressor.motor.speed_guess
    energy_scale = instants(compressor, angle).inertia * speed_scale**2

    def rate(t, y, args):
        del args
        rise, torques, journal_rates = crank_rates(compressor, y, t < off)
        crank_speed = y["speed"] * speed_scale
        work = jax.tree.map(lambda torque: torque * crank_speed / energy_scale, torques)
        return {"angle": crank_speed, "speed": rise / speed_scale, "work": work, **journal_rates}

    y0 = {"angle": angle, "speed": speed / speed_scale}
    journals = orbiting_journals(compressor)
    if journals:
        y0["journals"] = jnp.zeros((2, len(journals)))
    y0["work"] = zeros_of(rate, jnp.zeros(()), y0, None)["work"]
    progress_meter = diffrax.NoProgressMeter()
    if options.progress:
        progress_meter = diffrax.TextProgressMeter()
    # downwards only: a start from rest begins with a speed of zero
    stop = diffrax.Event(lambda t, y, args, **_: y["speed"], root_finder=None, direction=False)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        options.solver,
        t0=0.0,
        t1=duration,
        dt0=None,
        y0=y0,
        saveat=diffrax.SaveAt(t1=True, dense=True),
        stepsize_controller=diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=options.tolerance, atol=options.tolerance),
            # a motor that is never switched off has an infinite instant, at which no step can end
            jump_ts=minimum(off, 2 * duration)[None],
        ),
        max_steps=options.max_steps,
        event=stop if until_rest else None,
        adjoint=options.adjoint,
        throw=False,
        progress_meter=progress_meter,
    )
    stopped = solution.result == diffrax.RESULTS.event_occurred
    reached = stopped | (solution.result == diffrax.RESULTS.successful)
    assert solution.ts is not None
    end = solution.ts[-1]
    time = jnp.linspace(0.0, 1.0, options.samples) * end
    ys = jax.vmap(solution.evaluate)(time)
    return _listed(
        compressor,
        good,
        (time, ys, jax.vmap(lambda t, y: crank_rates(compressor, y, t < off)[0])(time, ys)),
        reached,
        (speed_scale, energy_scale),
        stopped=stopped,
        end_time=end,
        steps=solution.stats["num_steps"],
        positions=_positions(compressor, ys),
        _dense=solution,
    )


@kept_jit
def _simulate_gas(
    machine: Compressor, options: TimeIntegration, until_rest, duration, angle, speed, off
):
    good = admissible(machine)
    compressor = values_only(clipped(machine))
    law, marched = march_with_gas(compressor, options, until_rest, duration, angle, speed, off)
    end = marched.angle / law.pace
    dense = DenseSteps(marched.record, law.pace, law.unravel)
    time = jnp.linspace(0.0, 1.0, options.samples) * end
    ys = jax.vmap(dense.evaluate)(time)
    gas, rise = law.course(marched, time, ys)
    return _listed(
        # Only inertias are read there; a `Cylinder` has no pressure by the angle alone.
        replaced(compressor, gas=None),
        good,
        (time, ys, rise),
        marched.complete,
        (law.pace, law.energy_scale),
        stopped=marched.flags[-1] > 0,
        end_time=end,
        steps=marched.steps,
        positions=_positions(compressor, ys),
        _dense=dense,
        gas=gas,
    )


def _positions(compressor: Compressor, ys) -> dict[str, Float[Array, "2 n"]]:
    """[-] Of the journals that move, by joint."""
    journals = enumerate(orbiting_journals(compressor))
    return {journal.joint: ys["journals"][..., i].T for i, journal in journals}


def _listed(compressor: Compressor, good, motion, reached, scales, **entries) -> Transient:
    """The result from time [s], states and acceleration [rad/s^2] at its instants."""
    time, ys, rise = motion
    pace, energy_scale = scales
    speed = ys["speed"] * pace
    work = jax.tree.map(lambda w: w * energy_scale, ys["work"])
    status = Status.where(reached, Status.converged, Status.not_converged)
    return Transient(
        time=time,
        state=CrankState(ys["angle"], speed, rise),
        energy=Energy(work["motor"], work["gas"], work["losses"]),
        kinetic_energy=0.5 * instants(compressor, ys["angle"]).inertia * speed**2,
        status=Status.where(good, status, Status.bad_input),
        _scales=scales,
        **entries,
    )


def _of_gas(gas: GasCourse, at) -> Iterator[Data]:
    """Pressure, temperature, mass, lifts and flows; of several cylinders with their numbers."""
    plenums = () if gas.plenum_pressure is None else gas.plenum_pressure
    for number, pressure in enumerate(plenums, 1):
        yield Data(f"plenum_pressure.{number}", "Pa", pressure, at)
    gas = dataclasses.replace(gas, plenum_pressure=None)
    for number, name in enumerate(gas.names):
        in_cylinder = jax.tree.map(lambda leaf, number=number: leaf[number], gas)
        end = f".{name}" if name else ""
        yield Data(f"pressure{end}", "Pa", in_cylinder.pressure, at)
        yield Data(f"temperature{end}", "K", in_cylinder.temperature, at)
        yield Data(f"mass{end}", "kg", in_cylinder.mass, at)
        for place, valve in enumerate(("suction", "discharge")):
            yield Data(f"lift.{valve}_valve{end}", "m", in_cylinder.lift[place], at)
            yield Data(f"flow.{valve}_valve{end}", "kg/s", in_cylinder.flow[place], at)
        yield Data(f"delivered{end}", "kg", in_cylinder.totals.discharge, (), "since the start")
