r"""Crank and cylinders with valves in time: the equation of motion, and the balances of the gas.

The unknowns are angle, speed and works of the crank, and mass and temperature of the gas with lift,
velocity and port velocity of every valve, for each cylinder, and the states of the plenums, which all
cylinders share. What the valves do and the crank's rest are events: a step
ends there, and the state jumps. The heat transfer takes the mean piston speed from the
speed of the instant. Values only.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .._core.each import stacked
from .._core.errors import BadInput
from .._core.extremes import maximum
from .._core.fields import ANY, quantity, replaced
from .._core.roots import zeros_of
from ..compressor import Compressor, instants, mechanisms_of
from ..cylinder import Cylinder
from ..cylinder._cylinder import Case, prepare
from ..cylinder._cylinder_system import Cylinders
from ..cylinder._ends import ends_of, grouping, has_ends
from ..cylinder._gas_balance import (
    EVENTS,
    STATES,
    Accounts,
    Rates,
    account_scales,
    temperature_and_density,
    valve_scales,
)
from ..cylinder._march import AbstractLaw, Record, Stretch, stretch, within_steps
from ..cylinder._plenum import chains, first_states
from ..gas import AbstractGas
from ..mechanism import CrankState
from ._crank_motion import acceleration
from ._journals import journal_drive, orbiting_journals, with_journals

_LONGEST_TRIES = 8  # passes for a step that is kept, on the average, after which to give up


class HeldPressure(AbstractGas):
    """A pressure that something else decides, at one instant.

    Args:
        value: [Pa] in each cylinder.
        back_pressure: [Pa] behind the piston.
    """

    in_files: ClassVar[bool] = False
    for_each_cylinder: ClassVar[bool] = True

    value: Float[Array, ""] = quantity("Pa", ANY)
    back_pressure: Float[Array, ""] = quantity("Pa", ANY)

    @property
    def behind_piston(self):
        return self.back_pressure

    def pressure(self, stroke):
        return self.value + 0 * stroke.angle


class HeldEnds(AbstractGas):
    """Pressures on both sides of a piston that something else decides, at one instant.

    Args:
        head_end: [Pa] in the head end of each cylinder.
        crank_end: [Pa] in its crank end.
        rod_diameter: [m] of its piston rod.
        ambient_pressure: [Pa] on the rod's other end.
    """

    in_files: ClassVar[bool] = False
    for_each_cylinder: ClassVar[bool] = True

    head_end: Float[Array, ""] = quantity("Pa", ANY)
    crank_end: Float[Array, ""] = quantity("Pa", ANY)
    rod_diameter: Float[Array, ""] = quantity("m", ANY)
    ambient_pressure: Float[Array, ""] = quantity("Pa", ANY)

    @property
    def behind_piston(self):
        return self.ambient_pressure

    def pressure(self, stroke):
        """[Pa] In the head end."""
        return self.head_end + 0 * stroke.angle

    def on_piston(self, stroke, area):
        head = self.pressure(stroke)
        # The crank end pushes on the ring about the rod, the ambient on the rod's other end.
        rod = jnp.pi / 4 * self.rod_diameter**2 / area
        return head, head - (1 - rod) * self.crank_end - rod * self.ambient_pressure


class GasCourse(eqx.Module):
    """The gas in k cylinders over time, or in the k ends of double-acting ones, head before crank end.

    Attributes:
        pressure: [Pa] (k, n)
        temperature: [K] (k, n)
        mass: [kg] (k, n)
        lift: [m] (k, 2, n) of suction and discharge valve.
        flow: [kg/s] (k, 2, n) through them, forward.
        totals: [kg] and [J] since the start, (k,) each.
        plenum_pressure: [Pa] (p, n) in the plenums before the suction valves and behind the discharge
            valves, which all cylinders share; `None` without any.
    """

    pressure: Float[Array, "k n"]
    temperature: Float[Array, "k n"]
    mass: Float[Array, "k n"]
    lift: Float[Array, "k 2 n"]
    flow: Float[Array, "k 2 n"]
    totals: Accounts
    plenum_pressure: Float[Array, "p n"] | None = None
    sides: int = eqx.field(static=True, default=1)
    stages: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def names(self) -> list[str]:
        """Name of each of the k, by its cylinder and end; empty of a single one."""
        count = self.pressure.shape[0]
        if count == 1:
            return [""]
        if self.sides == 1:
            return list(map(str, range(1, count + 1)))
        names = []
        for cylinder in range(1, count // 2 + 1):
            names += [f"{cylinder}.head", f"{cylinder}.crank"]
        return names

    @property
    def delivered(self) -> Float[Array, ""]:
        """[kg] since the start, of several stages by the last."""
        final_stage = max(self.stages, default=1)
        ends = np.flatnonzero(np.array(self.stages or (1,) * self.pressure.shape[0]) == final_stage)
        return jnp.sum(self.totals.discharge[ends])


class DenseSteps(eqx.Module):
    """Cubics between the steps of a march."""

    record: Record  # the steps, over the time in radians of the mean speed
    speed: Float[Array, ""]  # [rad/s] that speed
    unravel: Any = eqx.field(static=True)  # the state from its vector

    def evaluate(self, time: Float[Array, ""]):
        """The state at a time [s]."""
        return self.unravel(within_steps(self.record, time * self.speed))


class CrankAndGas(AbstractLaw):
    """A machine over time in radians of its motor's speed.

    The flags are those of the cylinders, whether the motor is on, and whether the crank has stopped.
    """

    compressor: Compressor  # whose gas is a `Cylinder`, for each of several cylinders
    system: Cylinders  # with their lines and plenums
    energy_scale: Float[Array, ""]  # [J] unit of the works
    off: Float[Array, ""]  # [s] at which the motor is switched off
    until_rest: bool = eqx.field(static=True)  # whether the march ends where the crank stops
    state_size: int = eqx.field(static=True)
    # angle, speed, gas with plenums, works and journals from the vector of the first states
    unravel: Any = eqx.field(static=True)

    @property
    def pace(self) -> Float[Array, ""]:
        """[rad/s] Unit of the speed."""
        return self.compressor.motor.speed_guess

    def gases(self, at, flags) -> Rates:
        """The rates of all cylinders and of the plenums."""
        return self.system.rates(at["angle"], at["gas"], flags[:-2], at["speed"] * self.pace)

    def rates(self, angle, state, flags):
        at = self.unravel(state[: self.state_size])
        gas_rates = self.gases(at, flags)
        rise, torques, journal_rates = _crank(
            self.compressor, at, gas_rates.pressure, flags[-2] > 0
        )
        # Speed and time are both counted by the pace, so that an acceleration stands over its square.
        rate = {
            "angle": at["speed"],
            "speed": rise / self.pace**2,
            "gas": gas_rates.state,
            "work": jax.tree.map(lambda m: m * at["speed"] / self.energy_scale, torques),
            **{name: rates / self.pace for name, rates in journal_rates.items()},
        }
        slopes = jnp.concatenate([ravel_pytree(rate)[0], gas_rates.accounts.ravel()])
        until_stop = at["speed"]
        if not self.until_rest:
            until_stop = jnp.ones(())
        return slopes, jnp.append(gas_rates.events, until_stop), gas_rates.force

    def towards(self, state, events):
        gas = self.unravel(state[: self.state_size])["gas"]
        return jnp.append(self.system.towards(gas, events[:-1]), True)

    def after(self, angle, event, state, flags, force):
        at = self.unravel(state[: self.state_size])
        code, new = self.system.after(event, at["gas"], flags[:-2], force)
        jumped = ravel_pytree({**at, "gas": self.system.jump(event, code, at["gas"])})[0]
        # The instant of the switch is a bound of the march, met to rounding from either side.
        # the step that ends at the switch has the motor on, the next one has it off
        motor_on = angle < self.off * self.pace * (1 - 1e-12)
        machine_flags = jnp.stack([motor_on, event == EVENTS * self.system.count]).astype(int)
        return code, state.at[: self.state_size].set(jumped), jnp.concatenate([new, machine_flags])

    def passed(self, ends, slopes, width, flags, least):
        def of_gas(vectors):
            return [self.unravel(vector[: self.state_size])["gas"] for vector in vectors]

        return self.system.passed(of_gas(ends), of_gas(slopes), width, flags[:-2], least)

    def longest(self, flags):
        return self.system.longest(flags[:-2])

    def going_on(self, flags):
        return flags[-1] == 0

    def course(self, marched: Stretch, time, at) -> tuple[GasCourse, Float[Array, " n"]]:
        """The gas at instants [s] with these states, and the acceleration of the crank [rad/s^2]."""
        # the flags of the step that an instant lies in: valves rest or move, and the motor is on or off
        row = jnp.searchsorted(marched.record.angle, time * self.pace, side="right") - 1
        flags = marched.record.flags[maximum(row, 0)]
        system = self.system
        some = self.system.cases.cylinder.plenums

        def cylinder_values(case, angle, gas):
            T, rho = temperature_and_density(case, angle, gas)
            scale = jnp.stack([valve_scales(case, which)[0] for which in (0, 1)])
            # the cubics between the steps overshoot a seat by what their tolerance lets them
            lift = maximum(gas[jnp.asarray([2, 5])], 0.0) * scale
            return T, rho * case.volume(angle)[0], lift, case.mass_scale * self.pace

        def instant(state_and_flags):
            at, flags = state_and_flags
            gas_rates = self.gases(at, flags)
            in_cylinders, plenums = system.parted(at["gas"])
            crank_angle = system.own_angle(at["angle"])
            T, mass, lift, scale = system.each(cylinder_values, crank_angle, in_cylinders)
            flow = gas_rates.accounts[:, 1:3] * scale[:, None]
            rise, *_ = _crank(self.compressor, at, gas_rates.pressure, flags[-2] > 0)
            of_plenums = None
            if some:
                suction, discharge = chains(system.shared, plenums)
                of_plenums = jnp.stack([gas.p for gas in (*suction.gases, *discharge.gases)])
            return (gas_rates.pressure, T, mass, lift, flow), of_plenums, rise

        # in parts of 64 instants: all at once would hold every property of the gas of a long run
        values, of_plenums, rise = jax.lax.map(instant, (at, flags), batch_size=64)
        totals = marched.state[self.state_size :].reshape(system.count, -1)
        totals = Accounts(*(totals * system.each(account_scales)).T)
        gas: Any = self.compressor.gas
        sides = 1 if gas.crank_end is None else 2
        stages = ()
        if gas.later_stages:
            stages = tuple(np.repeat(gas.stages, sides).tolist())
        courses = (jnp.moveaxis(value, 0, -1) for value in values)
        course = GasCourse(*courses, totals=totals, sides=sides, stages=stages)
        if some:
            course = dataclasses.replace(course, plenum_pressure=of_plenums.T)
        return course, rise


def march_with_gas(
    compressor: Compressor, options, until_rest: bool, duration, angle, speed, off
) -> tuple[CrankAndGas, Stretch]:
    """March crank and gas from a start with every cylinder at the state of the suction line.

    Args:
        compressor: whose gas is a `Cylinder`, for each of several cylinders.
        options: `TimeIntegration`; tolerance and greatest number of steps.
        until_rest: end where the crank stops.
        duration: [s]
        angle: [rad] at the start.
        speed: [rad/s] at the start.
        off: [s] at which the motor is switched off.
    """
    pace = compressor.motor.speed_guess
    system = _system(compressor)
    gas = system.each(_at_suction, system.own_angle(angle)).ravel()
    gas = jnp.concatenate([gas, first_states(system.shared, at_rest=True)])
    first = {"angle": angle, "speed": speed / pace, "gas": gas}
    if journals := orbiting_journals(compressor):
        first["journals"] = jnp.zeros((2, len(journals)))
    first["work"] = zeros_of(_crank, compressor, first, jnp.zeros(system.count), True)[1]
    start, unravel = ravel_pytree(first)
    energy_scale = instants(_held(compressor), angle).inertia * pace**2
    law = CrankAndGas(compressor, system, energy_scale, off, until_rest, start.size, unravel)
    signs = system.each(_first_flags).ravel()
    marched = stretch(
        law,
        jnp.zeros(()),
        duration * pace,
        jnp.concatenate([start, jnp.zeros(system.count * len(Accounts._fields))]),
        jnp.concatenate([signs, jnp.stack([off > 0, False]).astype(int)]),
        jnp.asarray(options.tolerance),
        _LONGEST_TRIES * options.max_steps,
        options.max_steps,
        (off * pace,),
    )
    return law, marched


def crank_rates(compressor: Compressor, at, motor_on):
    """The crank in time, at states of which those of the gas are no part.

    Args:
        compressor: whose gas has a pressure at every crank angle.
        at: angle [rad], speed over the motor's guess and, where journals move, their positions.
        motor_on: whether the motor is on.

    Returns:
        Acceleration [rad/s^2], the torques whose works are counted [N m], and the rates [1/s] of what
        moves besides, by its name in `at`.
    """
    crank_speed = at["speed"] * compressor.motor.speed_guess
    motor = jnp.where(motor_on, compressor.motor.torque(crank_speed), 0.0)
    machine = with_journals(compressor, at.get("journals"))
    journal_rates = {}
    rise, conservative, loads = acceleration(machine, at["angle"], crank_speed, motor)
    if "journals" in at:
        state = CrankState(at["angle"], crank_speed, rise)
        drive = journal_drive(compressor, loads.forces, state, in_time=True)
        journal_rates["journals"] = drive.rate(at["journals"])
    return rise, {"motor": motor, "gas": -conservative, "losses": loads.loss_torque}, journal_rates


def _crank(compressor: Compressor, at, pressure, motor_on):
    """`crank_rates` under given pressures in the cylinders."""
    return crank_rates(_held(compressor, pressure), at, motor_on)


def _system(compressor: Compressor) -> Cylinders:
    gas: Any = compressor.gas
    assert isinstance(gas, Cylinder)
    mechanisms = mechanisms_of(compressor)
    phase = compressor.crankshaft.distinct_phase
    speed = compressor.motor.speed_guess
    if has_ends(gas):
        _check_lines_between(gas)
        ends = ends_of(gas, mechanisms, phase)

        def case_of_end(gas_side, piston):
            return prepare(gas_side, piston, speed)

        if ends.phase.size > 1:
            cases = jax.vmap(case_of_end)(ends.cylinders, ends.pistons)
        else:
            cases = case_of_end(*jax.tree.map(lambda x: x[0], (ends.cylinders, ends.pistons)))
        return Cylinders(cases, ends.phase, in_time=True)

    def case_of(mechanism):
        return prepare(gas, mechanism, speed)

    cases = case_of(mechanisms[0])
    # the law of a single cylinder has no axis of cylinders
    if len(mechanisms) > 1:
        cases = jax.vmap(case_of)(stacked(mechanisms))
    return Cylinders(cases, phase, in_time=True)


def _check_lines_between(gas: Cylinder) -> None:
    """That the lines between stages have a pressure which a run in time leaves as it is."""
    if not gas.later_stages:
        return
    if gas.interstage_pressure is None:
        bound = (
            "given for a run in time, which holds the pressures between stages as large bottles would: "
            "`jaxcomp run` finds those of the periodic state"
        )
        raise BadInput("gas.interstage_pressure", "absent", bound)
    for number, stage in enumerate(gas.later_stages):
        if stage.cooler.before or stage.cooler.behind:
            bound = "without bottles in a run in time, which holds the pressures between stages"
            raise BadInput(f"gas.later_stages.{number}.cooler", "with plenums", bound)


def _held(compressor: Compressor, pressure=None) -> Compressor:
    """The compressor with given pressures in its cylinders, (k,); those of the suction line if absent."""
    gas: Any = compressor.gas
    count = compressor.crankshaft.count
    behind = gas.behind_piston
    if pressure is None:
        pressure = jnp.full(grouping(gas, count).ends, behind)
    if gas.crank_end is None:
        return replaced(compressor, gas=HeldPressure(pressure, behind))
    stages = (1,) * count
    if gas.later_stages:
        stages = gas.stages
    crank_ends = [gas.stage(number).crank_end for number in stages]
    held = HeldEnds(
        head_end=pressure[0::2],
        crank_end=pressure[1::2],
        rod_diameter=jnp.stack([end.rod_diameter for end in crank_ends]),
        ambient_pressure=jnp.stack([end.ambient_pressure for end in crank_ends]),
    )
    return replaced(compressor, gas=held)


def _at_suction(case: Case, angle) -> Float[Array, " 8"]:
    """The state of a cylinder full of the gas of the suction line, valves shut."""
    volume, _ = case.volume(angle)
    return jnp.zeros(STATES).at[0].set(volume / case.swept).at[1].set(1.0)


def _first_flags(case: Case) -> Int[Array, " 6"]:
    """Valves shut, and no difference of pressure at the suction valve."""
    high = jnp.where(case.suction.p > case.discharge.p, 1, -1)
    plus = jnp.ones((), int)
    zero = jnp.zeros((), int)
    return jnp.stack([zero, plus, plus, zero, plus, high])
