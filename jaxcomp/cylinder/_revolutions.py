"""Revolutions marched one after the other until they repeat."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import max_of, maximum
from .._core.one_by_one import one_by_one
from ._cylinder_system import Cylinders
from ._gas_balance import Accounts
from ._march import AbstractLaw, Record, Stretch, empty_record, stretch

START = -np.pi / 2  # crank angle at which a revolution begins, within the compression
TURN = 2 * np.pi
_ACCOUNTS = len(Accounts._fields)
# Revolutions after which the gas in plenums is exchanged at once. What the cylinders deliver depends on
# it, and the other way round, so that once is not enough; what is left then is for Newton's method.
_SETTLING = 4


class March(NamedTuple):
    """Revolutions until they repeat."""

    state: Float[Array, " n"]  # at the end of the last of them
    flags: Int[Array, " f"]  # there
    totals: Float[Array, "k 12"]  # integrals of the accounts over it
    ended: Bool[Array, ""]  # whether its end was reached
    complete: Bool[Array, ""]  # whether all of its steps are in the record as well
    record: Record  # its steps
    change: Float[Array, ""]  # [-] largest difference between its end and its beginning
    # [-] the same between its end and the beginning of the one before
    change_of_two: Float[Array, ""]
    revolutions: Int[Array, ""]  # how many
    passes: Int[Array, ""]  # tries of steps in all


def march(
    system: Cylinders,
    options,
    tolerance,
    repeat,
    state,
    flags,
    is_marched,
    max_revolutions,
    watched: tuple = (),
    *,
    settles: Bool[Array, ""] | bool = False,
) -> March:
    """Revolutions until the end is the beginning within `repeat`; none if they are not `is_marched`.

    The error is soon one vector that shrinks by a steady factor (about 0.1), so after the second
    revolution the rest of the series is added at once. Samples of a batch are marched one after
    another: each has its own number of steps, and together they would all wait for the slowest.

    Args:
        system: the cylinders.
        options: `CycleOptions`, for how many tries of steps are made and steps kept.
        tolerance: [-] error of a step, in units of the scales.
        repeat: [-] change of a revolution at which to stop.
        state, flags: at the beginning.
        is_marched: whether to march at all.
        max_revolutions: after which to give up.
        watched: [rad] crank angles at which a step ends, where an event is suspected; infinite for none.
        settles: whether the gas in plenums is exchanged at once after each of the first revolutions.
    """
    revolutions = jnp.where(is_marched, max_revolutions, 0)
    settling = jnp.where(settles, _SETTLING, 0)

    def march_sample(system, tolerance, repeat, state, flags, revolutions, watched, settling):
        turn = partial(_revolve, system, options, tolerance, watched)
        capacity = options.kept_steps
        return _repeated(system, turn, repeat, state, flags, revolutions, capacity, settling)

    start = state, flags
    limits = revolutions, watched, settling
    return one_by_one(march_sample, system, tolerance, repeat, *start, *limits)


class _Revolution(AbstractLaw):
    """The gas at the motion of a crank; its states are followed by those of the accounts."""

    system: Cylinders
    state_size: int = eqx.field(static=True)

    def rates(self, angle, state, flags):
        rates = self.system.rates(angle, state[: self.state_size], flags)
        # accounts are integrated as states: a step that is too long for them is rejected as well
        slopes = jnp.concatenate([rates.state, rates.accounts.ravel()])
        return slopes, rates.events, rates.force

    def towards(self, state, events):
        return self.system.towards(state[: self.state_size], events)

    def after(self, angle, event, state, flags, force):
        of_gas = state[: self.state_size]
        code, new_flags = self.system.after(event, of_gas, flags, force)
        jumped = self.system.jump(event, code, of_gas)
        return code, state.at[: self.state_size].set(jumped), new_flags

    def passed(self, ends, slopes, width, flags, least):
        ends = [values[: self.state_size] for values in ends]
        slopes = [values[: self.state_size] for values in slopes]
        return self.system.passed(ends, slopes, width, flags, least)

    def longest(self, flags):
        return self.system.longest(flags)


def _revolve(system: Cylinders, options, tolerance, watched: tuple, state, flags) -> Stretch:
    """March through one revolution from `START`."""
    law = _Revolution(system, state.size)
    begin = jnp.concatenate([state, jnp.zeros(_ACCOUNTS * system.count)])
    end = stretch(
        law,
        jnp.asarray(START),
        START + TURN,
        begin,
        flags,
        tolerance,
        options.passes_of_revolution,
        options.kept_steps,
        _bends(system),
        watched,
    )
    # the wall moves between revolutions, and not with the gas within one
    next_state = system.next_revolution(end.state[: law.state_size])
    return end._replace(state=end.state.at[: law.state_size].set(next_state))


def _bends(system: Cylinders) -> tuple[Float[Array, ""], ...]:
    """[rad] Crank angles of the revolution at which the forces of unloaders begin and cease to change.

    Their third derivatives jump there: within a panel that costs 2e-6 of the work, and 5e-4 of its
    derivative by the angle of release. As edges the angles need not move with the release, since the
    force and its derivative by the release are continuous there.
    """
    unloader = getattr(system.cases.cylinder.suction_valve, "unloader", None)
    if unloader is None or unloader.release is None:
        return ()
    own_angle = unloader.bends().reshape(-1, system.count)
    # from the own angle of each cylinder to that of the crank, within the revolution that is
    # marched
    angle = START + jnp.mod(own_angle - system.phase - START, TURN)
    return tuple(angle.ravel())


def _repeated(
    system: Cylinders, turn, repeat, state, flags, max_revolutions, capacity: int, settling
) -> March:
    totals = jnp.zeros((system.count, _ACCOUNTS))
    has_plenums = bool(system.cases.cylinder.plenums)

    def going_on(carry):
        *_, marched = carry
        moving = marched.change > repeat
        return moving & (marched.revolutions < max_revolutions) & marched.ended

    def advance(carry):
        state, last_change, marched = carry
        new = turn(state, marched.flags)
        end = new.state[: state.size]
        sums = new.state[state.size :].reshape(totals.shape)
        change = end - state
        # by least squares the factor by which the slowest error shrinks; from 0.7 on what the
        # series has left is more than twice the last change, and no more a correction
        share = jnp.sum(change * last_change) / maximum(jnp.sum(last_change**2), 1e-300)
        usable = (marched.revolutions > 0) & (jnp.abs(share) < 0.7)
        extrapolation = jnp.where(usable, share / (1 - jnp.where(usable, share, 0.0)), 0.0)
        next_state = end + extrapolation * change
        # the accelerated state is a guess of mass and temperature; what the valves do is kept
        gas = system.columns(0, 1)
        next_state = end.at[gas].set(maximum(next_state[gas], 0.5 * end[gas]))
        if has_plenums:
            is_early = marched.revolutions < settling
            next_state = jnp.where(is_early, system.settled(end, sums), next_state)
        size = max_of(jnp.abs(change))
        passes = marched.passes + new.passes
        revolutions = marched.revolutions + 1
        longer = March(
            state=end,
            flags=new.flags,
            totals=sums,
            ended=new.ended,
            complete=new.complete,
            record=new.record,
            change=size,
            # of a machine that alternates both changes cancel: its factor is about -1, beyond what
            # is added
            change_of_two=max_of(jnp.abs(change + last_change)),
            revolutions=revolutions,
            passes=passes,
        )
        return next_state, change, longer

    record = empty_record(capacity, state.size, flags.size)
    true = jnp.asarray(True)
    none = jnp.zeros((), int)
    begin = March(
        state=state,
        flags=flags,
        totals=totals,
        ended=true,
        complete=true,
        record=record,
        change=jnp.asarray(jnp.inf),
        change_of_two=jnp.asarray(jnp.inf),
        revolutions=none,
        passes=none,
    )
    return lax.while_loop(going_on, advance, (state, jnp.zeros(state.size), begin))[-1]
