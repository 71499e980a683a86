r"""Crank and cylinders with valves in time: the equation of motion, and the balances of the gas.

The unknowns are angle, speed and works of the crank, and mass and temperature of the gas with lift,
velocity and port velocity of every valve, for each cylinder, and the states of the plenums, which all
cylinders share. What the valves do and the crank's rest are events: a step
ends there, and the state jumps. The heat transfer takes the mean piston speed from the
speed of the instant. Values only.
"""

import dataclasses
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .._fields import ANY, of_cylinder, quantity, replaced
from ..compressor import Compressor, instants, without_crank
from ..cylinder import Cylinder
from ..cylinder._balance import (
    EVENTS,
    FLAGS,
    STATES,
    Accounts,
    after_event,
    jump,
    rates,
    temperature_and_density,
    valve_scales,
)
from ..cylinder._cylinder import Case, prepare
from ..cylinder._march import Law, Record, longest_step, stretch, towards, within_steps
from ..cylinder._plenum import chain_rates, chains, first_states, valve_sides
from ..cylinder._solve import account_scales
from ..gas import AbstractGas
from ._motion import acceleration

_LONGEST_TRIES = 8  # passes for a step that is kept, on the average, after which to give up


class HeldPressure(AbstractGas):
    """A pressure that something else decides, at one instant.

    Args:
        value: [Pa] in the cylinder, or in each of several.
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
    """The gas in the cylinders over time; with k cylinders every entry has a leading axis of k.

    Attributes:
        pressure: [Pa] (n,)
        temperature: [K] (n,)
        mass: [kg] (n,)
        lift: [m] (2, n) of suction and discharge valve.
        flow: [kg/s] (2, n) through them, forward.
        totals: [kg] and [J] since the start.
        plenum_pressure: [Pa] (p, n) in the plenums before the suction valves and behind the discharge
            valves, which all cylinders share; `None` without any.
    """

    pressure: Float[Array, "*k n"]
    temperature: Float[Array, "*k n"]
    mass: Float[Array, "*k n"]
    lift: Float[Array, "*k 2 n"]
    flow: Float[Array, "*k 2 n"]
    totals: Accounts
    plenum_pressure: Float[Array, "p n"] | None = None


class DenseSteps(eqx.Module):
    """Cubics between the steps of a march.

    Attributes:
        record: the steps, over the time in radians of the mean speed.
        speed: [rad/s] that speed.
        unravel: the state from its vector.
    """

    record: Record
    speed: Float[Array, ""]
    unravel: Any = eqx.field(static=True)

    def evaluate(self, time: Float[Array, ""]):
        """The state at a time [s]."""
        return self.unravel(within_steps(self.record, time * self.speed))


class Marched(NamedTuple):
    """A motion with its gas, marched.

    Attributes:
        end: [s] where it ended.
        stopped: whether the crank came to rest there.
        whole: whether the end, or the rest, was reached.
        steps: of the march.
        dense: the state at any time: angle, speed over that of the motor, works.
        gas: (time, state) to the course of the gas at many instants.
    """

    end: Float[Array, ""]
    stopped: Bool[Array, ""]
    whole: Bool[Array, ""]
    steps: Int[Array, ""]
    dense: DenseSteps
    gas: Any


def march_with_gas(
    compressor: Compressor, options, until_rest: bool, duration, angle, speed, off
) -> Marched:
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
    pace = compressor.motor.speed_guess
    energy_scale = instants(_held(compressor), angle).inertia * pace**2
    cases = _cases(compressor)
    count = cases.top.size
    places = jnp.arange(count)
    shared: Case = jax.tree.map(lambda leaf: leaf[0], cases)  # lines and plenums
    plenums = first_states(shared, rest=True)

    def cut(flags):
        """Those of the cylinders, and that of the motor."""
        return flags[:-2].reshape(count, FLAGS), flags[-2] > 0

    def gases(at, own, now, flags):
        """The rates of all cylinders and of the plenums."""
        of_gas, _ = cut(flags)
        pair = chains(shared, at["plenums"]) if plenums.size else None
        sides = valve_sides(pair) if pair else None

        def one(case, angle, state, flags):
            return rates(case, angle, state, flags, speed=now, sides=sides)

        found = jax.vmap(one)(cases, own, at["gas"], of_gas)
        if not pair:
            return found, jnp.zeros(0)
        totals = jax.vmap(lambda a, case: a * account_scales(case) * pace)(found.accounts, cases)
        totals = Accounts(*jnp.sum(totals, axis=0))
        suction = totals.suction, totals.suction_heat
        discharge = totals.discharge, totals.discharge_heat
        wall = shared.cylinder.wall_temperature
        return found, chain_rates(shared, pair, at["plenums"], suction, discharge, pace, wall)

    def crank(at, pressure, motor_on):
        motor = jnp.where(motor_on, compressor.motor.torque(at["speed"] * pace), 0.0)
        held = _held(compressor, pressure)
        now = at["speed"] * pace
        return motor, *acceleration(held, at["angle"], now, motor)

    def own_angles(crank_angle):
        several = compressor.cylinders
        own = crank_angle[None] if several is None else several.own_angle(crank_angle)
        return jnp.reshape(own, (count,))

    first = {
        "angle": angle,
        "speed": speed / pace,
        "gas": jax.vmap(_at_suction)(cases, own_angles(angle)),
        "plenums": plenums,
    }
    own_work = jax.eval_shape(lambda at: _works(*crank(at, jnp.zeros(count), True)), first)
    first["work"] = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), own_work)
    start, unravel = ravel_pytree(first)
    kept = start.size
    accounts = count * len(Accounts._fields)

    def law(t, y, flags):
        del t
        at = unravel(y[:kept])
        own, now = own_angles(at["angle"]), at["speed"] * pace
        found, of_plenums = gases(at, own, now, flags)
        motor, rise, *torques = crank(at, found.pressure, cut(flags)[1])
        work = jax.tree.map(
            lambda torque: torque * at["speed"] / energy_scale, _works(motor, rise, *torques)
        )
        rate = {
            "angle": at["speed"],
            "speed": rise / pace**2,
            "gas": found.state,
            "plenums": of_plenums,
            "work": work,
        }
        slopes = jnp.concatenate([ravel_pytree(rate)[0], found.accounts.ravel()])
        rest = at["speed"] if until_rest else jnp.ones(())
        return slopes, jnp.append(found.events.ravel(), rest), found.force.ravel()

    def may_happen(y, events):
        each = jax.vmap(towards)(unravel(y[:kept])["gas"], events[:-1].reshape(count, EVENTS))
        return jnp.append(each.ravel(), True)

    def after(t, event, y, flags, force):
        at = unravel(y[:kept])
        of_gas, _ = cut(flags)

        def one(case, place, state, flags, force):
            own = event - EVENTS * place
            code, new = after_event(case, own, state, flags, force)
            return code, jump(case, own, code, state), new

        code, gas, new = jax.vmap(one)(cases, places, at["gas"], of_gas, force.reshape(count, 2))
        jumped = ravel_pytree({**at, "gas": gas})[0]
        # the step that ends at the switch has the motor on, the next one has it off
        motor_on = (t < off * pace * (1 - 1e-12)).astype(int)
        stopped = (event == EVENTS * count).astype(int)
        new_flags = jnp.concatenate([new.ravel(), jnp.stack([motor_on, stopped])])
        return jnp.max(code), y.at[:kept].set(jumped), new_flags

    def longest(flags):
        each = jax.vmap(longest_step)(cases, cut(flags)[0])
        return jnp.min(each)

    signs = jax.vmap(_first_flags)(cases).ravel()
    flags = jnp.concatenate([signs, jnp.stack([off > 0, False]).astype(int)])
    marched = stretch(
        Law(law, may_happen, after, longest, lambda f: f[-1] == 0, EVENTS * count + 1, kept),
        jnp.zeros(()),
        duration * pace,
        jnp.concatenate([start, jnp.zeros(accounts)]),
        flags,
        jnp.asarray(options.tolerance),
        _LONGEST_TRIES * options.max_steps,
        options.max_steps,
        (off * pace,),
    )
    totals = marched.state[kept:].reshape(count, -1)
    totals = totals * jax.vmap(account_scales)(cases)

    def course(time, at) -> tuple[GasCourse, Float[Array, " n"]]:
        """The gas, and the acceleration of the crank [rad/s^2]."""
        row = jnp.searchsorted(marched.record.angle, time * pace, side="right") - 1
        flags = marched.record.flags[jnp.clip(row, 0)]

        def instant(at, flags):
            own, now = own_angles(at["angle"]), at["speed"] * pace
            found, *_ = gases(at, own, now, flags)
            T, rho = jax.vmap(temperature_and_density)(cases, own, at["gas"])
            volume = jax.vmap(lambda case, a: case.volume(a)[0])(cases, own)
            scale = jax.vmap(lambda c: jnp.stack([valve_scales(c, i)[0] for i in (0, 1)]))(cases)
            lift = jnp.maximum(at["gas"][:, jnp.asarray([2, 5])], 0.0) * scale
            flow = found.accounts[:, 1:3] * cases.mass_scale[:, None] * pace
            rise = crank(at, found.pressure, cut(flags)[1])[1]
            pressures = [gas.p for chain in chains(shared, at["plenums"]) for gas in chain.gases]
            of_plenums = jnp.stack(pressures) if plenums.size else None
            return (found.pressure, T, rho * volume, lift, flow), of_plenums, rise

        values, of_plenums, rise = jax.lax.map(
            lambda one: instant(*one), (at, flags), batch_size=64
        )
        turned = [jnp.moveaxis(value, 0, -1) for value in values]
        made = GasCourse(*turned, totals=Accounts(*totals.T))
        if compressor.cylinders is None:
            made = jax.tree.map(lambda leaf: leaf[0], made)
        if plenums.size:
            made = dataclasses.replace(made, plenum_pressure=of_plenums.T)
        return made, rise

    stopped = marched.flags[-1] > 0
    return Marched(
        marched.angle / pace,
        stopped,
        marched.whole,
        marched.steps,
        DenseSteps(marched.record, pace, unravel),
        course,
    )


def _works(motor, rise, conservative, loads):
    """Torques whose works are counted."""
    del rise
    return {"motor": motor, "gas": -conservative, "losses": loads.loss_torque}


def _cases(compressor: Compressor) -> Case:
    """The cylinders with their lines, stacked."""
    gas: Any = compressor.gas
    assert isinstance(gas, Cylinder)
    speed = compressor.motor.speed_guess
    if compressor.cylinders is None:
        return jax.tree.map(lambda leaf: leaf[None], prepare(gas, compressor.mechanism, speed))
    single = without_crank(compressor)
    each = [of_cylinder(single, i + 1) for i in range(compressor.cylinders.count)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)
    return jax.vmap(lambda one: prepare(gas, one, speed))(stacked)


def _held(compressor: Compressor, pressure=None) -> Compressor:
    """The compressor with given pressures in its cylinders, (k,); those of the suction line if absent."""
    gas: Any = compressor.gas
    behind = gas.behind_piston
    count = 1 if compressor.cylinders is None else compressor.cylinders.count
    value = jnp.full(count, behind) if pressure is None else pressure
    value = value if compressor.cylinders is not None else value[0]
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
