"""What the valves do: branches and states after an event, and how the march comes upon events."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from .._core.extremes import clip, maximum, min_of, minimum
from .._core.polynomials import cubic_step, quintic_step
from ._cylinder import Case
from ._gas_balance import EVENTS, FREE, SEAT, STATES, STOP, valve_scales

_LONGEST = 0.3  # [rad] step
# Towards the instant at which a valve reverses.
_SECANT_STEPS = 3


def jump(case: Case, event: Int[Array, ""], code: Int[Array, ""], state: Float[Array, " 8"]):
    """The state after an event.

    Args:
        case: cylinder and lines.
        event: which; -1 for none.
        code: 0 nothing jumps, 1 onto or off the seat, 2 stops, 3 bounces.
    """
    parts = [state[:2]]
    for which, valve in enumerate(case.cylinder.valves):
        x, v, u = state[2 + 3 * which : 5 + 3 * which]
        is_of_valve = (event >= 4 * which) & (event < 4 * which + 4)
        at = jnp.where(is_of_valve, code, 0)
        bounce = -getattr(valve, "restitution", jnp.zeros(())) * v
        x = jnp.where(at > 0, 1.0 * (event % 4 == 1), x)
        v = jnp.where(at == 3, bounce, jnp.where(at > 0, 0.0, v))
        # the gas in a port begins from rest when its valve lifts, and is idle once it is shut
        parts.append(jnp.stack([x, v, jnp.where(at == 1, 0.0, u)]))
    return jnp.concatenate([*parts, state[STATES:]])


def after_event(case: Case, event, state, flags, force):
    """Code of the jump and flags after an event, from the state before it."""
    code = jnp.zeros((), int)
    new = flags
    for which, valve in enumerate(case.cylinder.valves):
        if valve.oscillator is None:
            continue
        first = 4 * which
        mode, u_sign, p_sign = flags[3 * which : 3 * which + 3]
        scale = valve_scales(case, which)[1]
        plate: Any = valve
        rebound = jnp.abs(plate.restitution * state[3 + 3 * which] * scale)
        rests = rebound < plate.rest_speed(scale)
        pressed = force[which] <= 0
        # a slow valve rests where the force presses it on; where the force pulls it away it sets
        # off again from there, without the last small bounces
        at_seat = (event == first) & (mode == FREE)
        at_stop = event == first + 1
        lifts = (event == first) & (mode == SEAT)
        shuts = at_seat & rests & pressed
        stays = at_stop & rests & ~pressed
        code = jnp.where(lifts | shuts, 1, code)
        code = jnp.where((at_seat | at_stop) & ~shuts, jnp.where(rests, 2, 3), code)
        # that function is a force where the valve rests: its sign ends the rest, at the seat as on
        # the stop
        leaves = (event == first) & (mode != FREE)
        mode = jnp.where(leaves, FREE, jnp.where(shuts, SEAT, jnp.where(stays, STOP, mode)))
        u_sign = jnp.where(lifts, 1, jnp.where(event == first + 2, -u_sign, u_sign))
        p_sign = jnp.where(lifts, 1, jnp.where(event == first + 3, -p_sign, p_sign))
        new = new.at[3 * which : 3 * which + 3].set(jnp.stack([mode, u_sign, p_sign]))
    return code, new


def longest_step(case: Case, flags):
    """[rad] A tenth of the period of a valve that is free: no step dips into the seat and out again."""
    longest = jnp.asarray(_LONGEST)
    for which, valve in enumerate(case.cylinder.valves):
        if valve.oscillator is not None:
            natural_frequency = jnp.sqrt(valve.oscillator.stiffness / valve.oscillator.mass)
            limit = 0.1 * 2 * np.pi * case.speed / maximum(natural_frequency, 1e-9)
            longest = jnp.where(flags[3 * which] == FREE, minimum(longest, limit), longest)
    return longest


def towards(state, events):
    """Whether a valve that is beyond seat or stop moves towards it; others may always cross."""
    free = jnp.ones(EVENTS, bool)
    for which in range(2):
        x, v = state[2 + 3 * which], state[3 + 3 * which]
        # with x at rest on seat or stop these functions are forces, which have no direction
        free = free.at[4 * which].set((v <= 0) | (x > 0)).at[4 * which + 1].set(v >= 0)
    return free


def passed(ends, slopes, width, flags, least):
    """Share of a step at which a free valve is beyond seat or stop and turns; see `AbstractLaw.passed`.

    The turn by the cubic of the velocity, the lift there by the quintic: of a step of a tenth of the
    valve's period that errs by 2e-6 of the amplitude.
    """
    lifts, velocities = _of_valves(ends)
    # the lift's rate is the velocity but for the unevenness of the crank
    rates, accelerations = _of_valves(slopes)
    turns = (rates[0] * rates[1] < 0) & (flags[::3] == FREE)
    drop = jnp.where(turns, rates[0] - rates[1], 1.0)
    pace = (rates[1] - rates[0]) / jnp.where(turns, velocities[1] - velocities[0], 1.0)
    bends = accelerations * pace

    def secant_step(_, t):
        return clip(t + cubic_step(t, width, rates, bends) / drop, 0.0, 1.0)

    # an error of the instant of reversal counts with its square; unrolled, XLA copies the steps into
    # everything that needs their result
    t = lax.fori_loop(0, _SECANT_STEPS, secant_step, rates[0] / drop)
    top = quintic_step(t, width, lifts, rates, bends)
    excess = jnp.where(rates[0] > 0, top - 1, -top)
    beyond = turns & (excess > least)
    # before the valve reverses, where three quarters of the excess are reached on the way there
    bend = jnp.abs((rates[1] - rates[0]) / width)
    back = jnp.sqrt(jnp.where(beyond, excess, 0.0) / 2 / jnp.where(beyond, bend, 1.0)) / width
    return min_of(jnp.where(beyond, maximum(t - back, 0.5 * t), jnp.inf))


def _of_valves(states):
    """Lifts and velocities of both valves at begin and end of a step, or their rates: (2, 2) each."""
    of_valves = jnp.stack(states)[:, 2:STATES].reshape(2, 2, 3)
    return of_valves[:, :, 0], of_valves[:, :, 1]
