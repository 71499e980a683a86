"""What the valves do: branches and states after an event, and how the march comes upon events."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._core.extremes import clip, maximum, minimum
from .._core.polynomials import cubic_step, quintic_step
from ._cylinder import Case
from ._gas_balance import EVENTS, FREE, SEAT, STATES, STOP, valve_scales

_LONGEST = 0.3  # [rad] step


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
        at_seat = (event == first) & (mode == FREE)
        at_stop = event == first + 1
        lifts = (event == first) & (mode == SEAT)
        shuts = at_seat & rests & pressed
        stays = at_stop & rests & ~pressed
        code = jnp.where(lifts | shuts, 1, code)
        code = jnp.where((at_seat | at_stop) & ~shuts, jnp.where(rests, 2, 3), code)
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
    earliest = jnp.asarray(jnp.inf)
    for which in range(2):
        x, v = 2 + 3 * which, 3 + 3 * which
        # the lift's rate is the velocity but for the unevenness of the crank
        first_rate = slopes[0][x]
        last_rate = slopes[1][x]
        turns = (first_rate * last_rate < 0) & (flags[3 * which] == FREE)
        change = jnp.where(turns, ends[1][v] - ends[0][v], 1.0)
        pace = (last_rate - first_rate) / change
        bends = slopes[0][v] * pace, slopes[1][v] * pace
        t = first_rate / jnp.where(turns, first_rate - last_rate, 1.0)
        for _ in range(
            3
        ):  # secant steps: an error of the instant of reversal counts with its square
            rate = cubic_step(t, width, (first_rate, last_rate), bends)
            t = clip(t + rate / jnp.where(turns, first_rate - last_rate, 1.0), 0.0, 1.0)
        top = quintic_step(t, width, (ends[0][x], ends[1][x]), (first_rate, last_rate), bends)
        excess = jnp.where(first_rate > 0, top - 1, -top)
        beyond = turns & (excess > least)
        # before the valve reverses, where three quarters of the excess are reached on the way there
        bend = jnp.abs((last_rate - first_rate) / width)
        back = jnp.sqrt(jnp.where(beyond, excess, 0.0) / 2 / jnp.where(beyond, bend, 1.0)) / width
        earliest = minimum(earliest, jnp.where(beyond, maximum(t - back, 0.5 * t), jnp.inf))
    return earliest
