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
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .._core.each import stacked
from .._core.fields import ANY, of_cylinder, quantity, replaced
from .._core.roots import zeros_of
from ..compressor import Compressor, instants
from ..cylinder import Cylinder
from ..cylinder.interface import (
    EVENTS,
    FLAGS,
    STATES,
    AbstractLaw,
    Accounts,
    Case,
    Rates,
    Record,
    Stretch,
    account_scales,
    after_event,
    chain_rates,
    chains,
    first_states,
    jump,
    longest_step,
    prepare,
    rates,
    stretch,
    temperature_and_density,
    towards,
    valve_scales,
    valve_sides,
    within_steps,
)
from ..gas import AbstractGas
from ._motion import acceleration

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


class GasCourse(eqx.Module):
    """The gas in k cylinders over time.

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

    The flags are those of the cylinders, whether the motor is on, and whether the crank has come to rest.
    """

    compressor: Compressor  # whose gas is a `Cylinder`, for each of several cylinders
    cases: Case  # the cylinders with their lines, stacked
    energy_scale: Float[Array, ""]  # [J] unit of the works
    off: Float[Array, ""]  # [s] at which the motor is switched off
    until_rest: bool = eqx.field(
        static=True
    )  # whether the march ends where the crank comes to rest
    kept: int = eqx.field(static=True)
    # angle, speed, gas, plenums and works from the vector of the states that are kept
    unravel: Any = eqx.field(static=True)

    @property
    def pace(self) -> Float[Array, ""]:
        """[rad/s] Unit of the speed."""
        return self.compressor.motor.speed_guess

    @property
    def shared(self) -> Case:
        """One of the cylinders, for lines and plenums."""
        return jax.tree.map(lambda leaf: leaf[0], self.cases)

    def gases(self, at, flags) -> tuple[Rates, Float[Array, " 3p"]]:
        """The rates of all cylinders and of the plenums."""
        now, shared = at["speed"] * self.pace, self.shared
        pair = chains(shared, at["plenums"]) if shared.cylinder.plenums else None
        sides = valve_sides(pair) if pair else None

        def one(case, angle, state, flags):
            return rates(case, angle, state, flags, speed=now, sides=sides)

        own = self.compressor.crankshaft.own_angle(at["angle"])
        found = jax.vmap(one)(self.cases, own, at["gas"], _of_cylinders(flags))
        if not pair:
            return found, jnp.zeros(0)
        scales = jax.vmap(account_scales)(self.cases)
        totals = Accounts(*jnp.sum(found.accounts * scales * self.pace, axis=0))
        suction = totals.suction, totals.suction_heat
        discharge = totals.discharge, totals.discharge_heat
        wall = shared.cylinder.wall_temperature
        return found, chain_rates(shared, pair, at["plenums"], suction, discharge, self.pace, wall)

    def rates(self, angle, state, flags):
        at = self.unravel(state[: self.kept])
        found, of_plenums = self.gases(at, flags)
        rise, torques = _crank(self.compressor, at, found.pressure, flags[-2] > 0)
        rate = {
            "angle": at["speed"],
            "speed": rise / self.pace**2,
            "gas": found.state,
            "plenums": of_plenums,
            "work": jax.tree.map(lambda m: m * at["speed"] / self.energy_scale, torques),
        }
        slopes = jnp.concatenate([ravel_pytree(rate)[0], found.accounts.ravel()])
        rest = at["speed"] if self.until_rest else jnp.ones(())
        return slopes, jnp.append(found.events.ravel(), rest), found.force.ravel()

    def towards(self, state, events):
        gas = self.unravel(state[: self.kept])["gas"]
        return jnp.append(jax.vmap(towards)(gas, events[:-1].reshape(-1, EVENTS)).ravel(), True)

    def after(self, angle, event, state, flags, force):
        at, count = self.unravel(state[: self.kept]), self.cases.top.size

        def one(case, place, state, flags, force):
            own = event - EVENTS * place
            code, new = after_event(case, own, state, flags, force)
            return code, jump(case, own, code, state), new

        of_each = at["gas"], _of_cylinders(flags), force.reshape(count, 2)
        code, gas, new = jax.vmap(one)(self.cases, jnp.arange(count), *of_each)
        jumped = ravel_pytree({**at, "gas": gas})[0]
        # the step that ends at the switch has the motor on, the next one has it off
        motor_on = angle < self.off * self.pace * (1 - 1e-12)
        others = jnp.stack([motor_on, event == EVENTS * count]).astype(int)
        flags = jnp.concatenate([new.ravel(), others])
        return jnp.max(code), state.at[: self.kept].set(jumped), flags

    def longest(self, flags):
        return jnp.min(jax.vmap(longest_step)(self.cases, _of_cylinders(flags)))

    def going_on(self, flags):
        return flags[-1] == 0

    def course(self, marched: Stretch, time, at) -> tuple[GasCourse, Float[Array, " n"]]:
        """The gas at instants [s] with these states, and the acceleration of the crank [rad/s^2]."""
        row = jnp.searchsorted(marched.record.angle, time * self.pace, side="right") - 1
        flags = marched.record.flags[jnp.clip(row, 0)]
        cases, some = self.cases, self.shared.cylinder.plenums

        def instant(given):
            at, flags = given
            own = self.compressor.crankshaft.own_angle(at["angle"])
            found, _ = self.gases(at, flags)
            T, rho = jax.vmap(temperature_and_density)(cases, own, at["gas"])
            volume = jax.vmap(lambda case, a: case.volume(a)[0])(cases, own)
            scale = jax.vmap(lambda c: jnp.stack([valve_scales(c, i)[0] for i in (0, 1)]))(cases)
            lift = jnp.maximum(at["gas"][:, jnp.asarray([2, 5])], 0.0) * scale
            flow = found.accounts[:, 1:3] * cases.mass_scale[:, None] * self.pace
            rise, _ = _crank(self.compressor, at, found.pressure, flags[-2] > 0)
            pair = chains(self.shared, at["plenums"]) if some else ()
            of_plenums = jnp.stack([gas.p for one in pair for gas in one.gases]) if some else None
            return (found.pressure, T, rho * volume, lift, flow), of_plenums, rise

        values, of_plenums, rise = jax.lax.map(instant, (at, flags), batch_size=64)
        totals = marched.state[self.kept :].reshape(cases.top.size, -1)
        totals = Accounts(*(totals * jax.vmap(account_scales)(cases)).T)
        made = GasCourse(*(jnp.moveaxis(value, 0, -1) for value in values), totals=totals)
        if some:
            made = dataclasses.replace(made, plenum_pressure=of_plenums.T)
        return made, rise


def march_with_gas(
    compressor: Compressor, options, until_rest: bool, duration, angle, speed, off
) -> tuple[CrankAndGas, Stretch]:
    """March crank and gas from a start with every cylinder at the state of the suction line.

    Args:
        compressor: whose gas is a `Cylinder`, for each of several cylinders.
        options: `TimeIntegration`; tolerance and greatest number of steps.
        until_rest: end where the crank comes to rest.
        duration: [s]
        angle: [rad] at the start.
        speed: [rad/s] at the start.
        off: [s] at which the motor is switched off.
    """
    pace, cases = compressor.motor.speed_guess, _cases(compressor)
    first = {
        "angle": angle,
        "speed": speed / pace,
        "gas": jax.vmap(_at_suction)(cases, compressor.crankshaft.own_angle(angle)),
        "plenums": first_states(jax.tree.map(lambda leaf: leaf[0], cases), rest=True),
    }
    first["work"] = zeros_of(_crank, compressor, first, jnp.zeros(cases.top.size), True)[1]
    start, unravel = ravel_pytree(first)
    energy_scale = instants(_held(compressor), angle).inertia * pace**2
    law = CrankAndGas(compressor, cases, energy_scale, off, until_rest, start.size, unravel)
    signs = jax.vmap(_first_flags)(cases).ravel()
    marched = stretch(
        law,
        jnp.zeros(()),
        duration * pace,
        jnp.concatenate([start, jnp.zeros(cases.top.size * len(Accounts._fields))]),
        jnp.concatenate([signs, jnp.stack([off > 0, False]).astype(int)]),
        jnp.asarray(options.tolerance),
        _LONGEST_TRIES * options.max_steps,
        options.max_steps,
        (off * pace,),
    )
    return law, marched


def _of_cylinders(flags) -> Int[Array, "k 6"]:
    return flags[:-2].reshape(-1, FLAGS)


def _crank(compressor: Compressor, at, pressure, motor_on):
    """Acceleration [rad/s^2], and the torques whose works are counted [N m]."""
    now = at["speed"] * compressor.motor.speed_guess
    motor = jnp.where(motor_on, compressor.motor.torque(now), 0.0)
    held = _held(compressor, pressure)
    rise, conservative, loads = acceleration(held, at["angle"], now, motor)
    return rise, {"motor": motor, "gas": -conservative, "losses": loads.loss_torque}


def _cases(compressor: Compressor) -> Case:
    """The cylinders with their lines, stacked."""
    gas: Any = compressor.gas
    assert isinstance(gas, Cylinder)
    speed = compressor.motor.speed_guess
    count = compressor.crankshaft.count
    each = stacked([of_cylinder(compressor.mechanism, i + 1) for i in range(count)])
    return jax.vmap(lambda one: prepare(gas, one, speed))(each)


def _held(compressor: Compressor, pressure=None) -> Compressor:
    """The compressor with given pressures in its cylinders, (k,); those of the suction line if absent."""
    gas: Any = compressor.gas
    behind = gas.behind_piston
    value = jnp.full(compressor.crankshaft.count, behind) if pressure is None else pressure
    return replaced(compressor, gas=HeldPressure(value, behind))


def _at_suction(case: Case, angle) -> Float[Array, " 8"]:
    """The state of a cylinder full of the gas of the suction line, valves shut."""
    volume, _ = case.volume(angle)
    return jnp.zeros(STATES).at[0].set(volume / case.swept).at[1].set(1.0)


def _first_flags(case: Case) -> Int[Array, " 6"]:
    """Valves shut, and no difference of pressure at the suction valve."""
    high = jnp.where(case.suction.p > case.discharge.p, 1, -1)
    one, none = jnp.ones((), int), jnp.zeros((), int)
    return jnp.stack([none, one, one, none, one, high])
