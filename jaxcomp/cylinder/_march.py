"""Dormand and Prince's method with located events.

A step at whose end an event function is negative is not taken: it is repeated, shorter or longer,
until the function vanishes there; then the state jumps. A step within which a valve turns beyond seat
or stop is repeated up to there. One attempt a pass of the loop, so samples of
a batch whose events differ share it. The steps are kept: `lay_mesh` lays the panels of the collocation
after them. Values only; derivatives come from the collocation.
"""

from abc import abstractmethod
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import clip, max_of, maximum, minimum
from .._core.polynomials import cubic_step

# Dormand, Prince (1980): nodes, stages, and the difference to the embedded method of order 4
_C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
_A = np.zeros((7, 7))
_A[1, :1] = [1 / 5]
_A[2, :2] = [3 / 40, 9 / 40]
_A[3, :3] = [44 / 45, -56 / 15, 32 / 9]
_A[4, :4] = [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]
_A[5, :5] = [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]
_A[6, :6] = [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]
_E = _A[6] - np.array(
    [5179 / 57600, 0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40]
)

_CROSSED = -1e-12  # [-] event function below which an event has happened
_LOCATED = 1e-2  # [-] of the tolerance of a step: event function within which it is located
# [-] The same at most. A plate that bounces with little speed flies 1e-6 of its stop high and less: with
# events located within 3e-7, touch and leaving were one place, and the bounces did not end in 200,000
# steps on 28 of 100 scattered machines. On the others the tries of steps rise by 4 %.
_LOCATED_AT_MOST = 1e-9
# In the record of a march, in place of an event: a step ends at a given angle, where a force bends.
BEND = -2
_AT_KNOT = 1e-9  # [rad] from a given angle within which a step ends there
_NARROW = 1e-14  # [rad] bracket beyond which rounding rules


class Record(NamedTuple):
    """The steps of a march, n of them at most; unused ones have the angle `inf`."""

    angle: Float[Array, " n"]  # [rad] where a step begins
    width: Float[Array, " n"]  # [rad]
    # states; between them the events have not jumped
    begin: Float[Array, "n m"]
    end: Float[Array, "n m"]
    # their rates
    begin_rate: Float[Array, "n m"]
    end_rate: Float[Array, "n m"]
    flags: Int[Array, "n f"]  # branches that hold within the step
    event: Int[Array, " n"]  # at its end, -1 for none, `BEND` at a given angle
    code: Int[Array, " n"]  # of the jump there


class AbstractLaw(eqx.Module):
    """Law of a march: its rates, events and jumps."""

    state_size: eqx.AbstractVar[int]  # how many states the record keeps

    @abstractmethod
    def rates(self, angle, state, flags) -> tuple[Array, Array, Array]:
        """d state/d angle, event functions, and what `after` wants to know."""

    @abstractmethod
    def towards(self, state, events) -> Bool[Array, " e"]:
        """Whether each event may happen there."""

    @abstractmethod
    def after(self, angle, event, state, flags, force) -> tuple[Array, Array, Array]:
        """Code of the jump, state and flags after an event, or after none (-1)."""

    @abstractmethod
    def longest(self, flags) -> Float[Array, ""]:
        """[rad] The longest step."""

    @abstractmethod
    def passed(self, ends, slopes, width, flags, least) -> Float[Array, ""]:
        """Share of a step at which a valve is beyond seat or stop that is not so at its end.

        Args:
            ends, slopes: (m,) states and their rates, each at beginning and end.
            width: [rad] of the step.
            flags: (f,) within it.
            least: [-] how far beyond.

        Returns:
            [-] infinite where no valve is.
        """

    def going_on(self, flags) -> Bool[Array, ""]:
        """Whether the march goes on."""
        del flags
        return jnp.asarray(True)


class Stretch(NamedTuple):
    """Stretch of a march with its record."""

    angle: Float[Array, ""]  # [rad] where it ended
    state: Float[Array, " m"]  # there
    flags: Int[Array, " f"]  # there
    steps: Int[Array, ""]  # taken
    passes: Int[Array, ""]  # tried, those that were rejected or located an event included
    ended: Bool[Array, ""]  # whether the end was reached, or the march was over before
    complete: Bool[Array, ""]  # whether all steps were kept as well
    record: Record  # the steps


def stretch(
    law: AbstractLaw,
    start,
    stop,
    state,
    flags,
    tolerance,
    max_passes,
    capacity: int,
    knots: tuple = (),
    watched: tuple = (),
) -> Stretch:
    """March from an angle to another.

    Args:
        law: what is marched.
        start, stop: [rad]
        state: (m,) at the beginning.
        flags: (f,) there.
        tolerance: [-] error of a step, in units of the scales.
        max_passes: tries after which to give up.
        capacity: steps that are kept.
        knots: [rad] angles at which a step ends, which the record marks by `BEND`.
        watched: [rad] the same without a mark: a step that dips beyond an event and out again does not
            pass over them.
    """
    # the floor keeps the search away from the rounding of the event functions
    at_event = clip(_LOCATED * tolerance, 1e-11, _LOCATED_AT_MOST)
    route = _Route(law, stop, tolerance, at_event, capacity, knots, watched)

    def going_on(carry: _Carry):
        return (
            # a sum of widths misses the end by rounding
            (carry.angle < stop - 1e-13) & (carry.passes < max_passes) & law.going_on(carry.flags)
        )

    begin = _beginning(route, start, state, flags)
    end = lax.while_loop(going_on, partial(_advance, route), begin)
    # with no tries counted: a march that was given up after too many of them has not ended
    ended = ~going_on(end._replace(passes=begin.passes))
    return Stretch(
        angle=end.angle,
        state=end.state,
        flags=end.flags,
        steps=end.steps,
        passes=end.passes,
        ended=ended,
        complete=ended & (end.steps <= capacity),
        record=jax.tree.map(lambda rows: rows[:capacity], end.record),
    )


class _Route(NamedTuple):
    """Constants of all steps of a march."""

    law: AbstractLaw
    stop: Float[Array, ""]  # [rad]
    tolerance: Float[Array, ""]  # [-] error of a step
    at_event: Float[Array, ""]  # [-] event function within which an event is located
    capacity: int  # steps that are kept
    knots: tuple  # [rad] angles at which a step ends, and is marked
    watched: tuple  # [rad] angles at which a step ends without a mark

    def ahead(self, angle):
        """[rad] From an angle to the end or to the next angle at which a step ends."""
        distance = self.stop - angle
        for place in (*self.knots, *self.watched):
            # rounding may have left a step just short of a place: it counts as reached, or the
            # next step would have no width
            is_ahead = place > angle + _AT_KNOT
            distance = jnp.where(is_ahead, minimum(distance, place - angle), distance)
        return distance


class _Search(NamedTuple):
    """Where an event is sought: a bracket of step widths with the event functions at its ends."""

    active: Bool[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]
    at_low: Float[Array, " e"]
    at_high: Float[Array, " e"]
    tries: Int[Array, ""]


class _Carry(NamedTuple):
    angle: Float[Array, ""]
    state: Float[Array, " m"]
    flags: Int[Array, " f"]
    events: Float[Array, " e"]
    width: Float[Array, ""]  # of the step that is tried next
    next_width: Float[Array, ""]  # of the one after the event that is sought
    search: _Search
    steps: Int[Array, ""]
    passes: Int[Array, ""]
    record: Record


class _Attempt(NamedTuple):
    """A step that was tried."""

    slopes: Float[Array, "7 m"]  # of the stages
    state: Float[Array, " m"]  # at its end, as the next ones
    events: Float[Array, " e"]
    force: Float[Array, " v"]
    error: Float[Array, ""]  # [-] over the tolerance; infinite where the state is lost


class _Verdict(NamedTuple):
    """Verdict on a step that was tried."""

    accept: Bool[Array, ""]  # taken
    located: Bool[Array, ""]  # an event is at its end
    seeking: Bool[Array, ""]  # repeated for an event within it
    crossed: Bool[Array, ""]  # whether an event function is negative at its end
    # [rad] the width of the next step is at most this: to where a valve turns beyond seat or stop
    turn: Float[Array, ""]


def _beginning(route: _Route, start, state, flags) -> _Carry:
    law = route.law
    _, events, _ = jax.eval_shape(law.rates, start, state, flags)
    # the events are not known yet; at first they are only a guess within the bracket of one
    unknown = jnp.ones(events.shape)
    none = jnp.zeros((), int)
    # one row more than are kept takes what is thrown away
    record = empty_record(route.capacity + 1, law.state_size, flags.size)
    first = minimum(0.02, law.longest(flags))
    if route.knots or route.watched:
        first = minimum(first, route.ahead(start))
    return _Carry(
        start, state, flags, unknown, first, first, _no_search(unknown), none, none, record
    )


def _advance(route: _Route, carry: _Carry) -> _Carry:
    """Try a step: take it, repeat it for an event, or repeat it shorter."""
    law = route.law
    tried = _attempt(route, carry)
    verdict = _judged(route, carry, tried)
    accept = verdict.accept
    search, trial = _sought(route, carry, tried, verdict)

    # what has happened, if anything: of what was negative where the bracket ends, the nearest to zero
    events = tried.events
    which = jnp.argmin(jnp.abs(jnp.where(carry.search.at_high < _CROSSED, events, jnp.inf)))
    event = jnp.where(accept & verdict.located, which, -1)
    end = carry.angle + carry.width
    code, jumped, new_flags = law.after(end, event, tried.state, carry.flags, tried.force)

    angle = jnp.where(accept, end, carry.angle)
    flags = jnp.where(accept, new_flags, carry.flags)
    ahead, proposed = _next_widths(route, carry, tried.error, angle, law.longest(flags))
    # the events are as they are after the step, but for the one that has just happened
    passed = jnp.where(event >= 0, maximum(events, 0.0), events)
    return _Carry(
        angle,
        jnp.where(accept, jumped, carry.state),
        flags,
        jnp.where(accept, passed, carry.events),
        jnp.where(verdict.seeking, trial, minimum(ahead, verdict.turn)),
        proposed,
        search,
        carry.steps + accept,
        carry.passes + 1,
        _recorded(route, carry, tried, accept, _edge(route, event, end), code),
    )


def _edge(route: _Route, event, end):
    """The event at the end of a step, or `BEND` at a given angle where nothing happens."""
    for knot in route.knots:
        event = jnp.where((event < 0) & (jnp.abs(end - knot) < _AT_KNOT), BEND, event)
    return event


def _attempt(route: _Route, carry: _Carry) -> _Attempt:
    """All stages in a loop, so that the law is traced once."""
    law = route.law
    a, c, e = map(jnp.asarray, (_A, _C, _E))

    def stage(i, work):
        slopes, _, _, _ = work
        state = carry.state + carry.width * _weighted(a[i], slopes)
        slope, events, force = law.rates(carry.angle + c[i] * carry.width, state, carry.flags)
        return slopes.at[i].set(slope), state, events, force

    _, _, force = jax.eval_shape(law.rates, carry.angle, carry.state, carry.flags)
    empty = jnp.zeros((7, carry.state.size))
    work = (empty, carry.state, carry.events, jnp.zeros(force.shape))
    # the seventh stage is the end of the step itself: its state is the result, and its slope,
    # event functions and forces are those there
    slopes, state, events, force = lax.fori_loop(0, 7, stage, work)
    # states are over their scales: the error is absolute below one and relative above, as of a
    # light plate's velocity, which may be a thousand
    error = max_of(jnp.abs(carry.width * _weighted(e, slopes)) / (1 + jnp.abs(carry.state)))
    error = jnp.where(jnp.all(jnp.isfinite(state)), error / route.tolerance, jnp.inf)
    return _Attempt(slopes, state, events, force, error)


def _judged(route: _Route, carry: _Carry, tried: _Attempt) -> _Verdict:
    """Whether a step stands, by its error, the events at its end and the valves within it."""
    law = route.law
    search = carry.search
    events = tried.events
    least = route.at_event
    negative = events < minimum(_CROSSED, -0.1 * least)
    crossed = jnp.any(negative & law.towards(tried.state, events))
    # a first event that lies within the step is sought from a step that ends beyond it
    ends = (carry.state, tried.state)
    slopes = (tried.slopes[0], tried.slopes[6])
    share = law.passed(ends, slopes, carry.width, carry.flags, least)
    # a trial within a bracket is shorter than the step that opened it, whose error was small
    small = (tried.error <= 1) | search.active
    returns = small & jnp.isfinite(tried.error) & (share < 1)
    good = small & ~returns

    narrow = search.active & (search.high - search.low < _NARROW)
    near = search.active & jnp.all(events > -least) & jnp.any(jnp.abs(events) < least)
    located = near | (narrow & crossed)
    # while an event is sought, only a step that ends at it stands: a shorter one would move the
    # beginning of the bracket
    accept = good & (~crossed | located) & (~search.active | located)
    seeking = good & ~accept & (crossed | search.active)
    return _Verdict(
        accept, located, seeking, crossed, jnp.where(returns, share * carry.width, jnp.inf)
    )


def _sought(
    route: _Route, carry: _Carry, tried: _Attempt, verdict: _Verdict
) -> tuple[_Search, Array]:
    """The bracket of an event, closer by the step that was tried, and the width to try next [rad]."""
    search = carry.search
    crossed = verdict.crossed
    events = tried.events
    high = jnp.where(crossed, carry.width, search.high)
    at_high = jnp.where(crossed, events, search.at_high)
    lower = search.active & ~crossed
    low = jnp.where(lower, carry.width, jnp.where(search.active, search.low, 0.0))
    at_low = jnp.where(search.active, jnp.where(crossed, search.at_low, events), carry.events)
    # by the straight line to the first of the events, every third time by halves: the false position
    # alone may creep up from one side
    first, fraction = _first(at_low, at_high)
    halve = (search.tries % 3 == 2) | (at_low[first] <= route.at_event)
    fraction = jnp.where(halve, 0.5, clip(fraction, 0.001, 0.999))
    closer = _Search(jnp.asarray(True), low, high, at_low, at_high, search.tries + 1)
    following = jax.tree.map(partial(jnp.where, verdict.seeking), closer, _no_search(events))
    return following, low + fraction * (high - low)


def _next_widths(route: _Route, carry: _Carry, error, angle, longest):
    """[rad] Of the next step from an angle, and what is proposed for the one after an event."""
    seeks = carry.search.active
    # the difference to the embedded method of order 4 goes with the fifth power of the width
    factor = clip(0.9 * maximum(error, 1e-10) ** -0.2, 0.2, 5.0)
    factor = jnp.where(jnp.isfinite(error), factor, 0.2)
    # the width of a step that ends at an event says nothing of the error
    proposed = jnp.where(seeks, carry.next_width, carry.width * factor)
    proposed = minimum(proposed, longest)
    distance = route.ahead(angle)
    ahead = minimum(proposed, distance)
    # a step that leaves a sliver would end in one of no width
    return jnp.where((distance - ahead < 1e-9) & (distance - ahead > 0), distance, ahead), proposed


def _recorded(route: _Route, carry: _Carry, tried: _Attempt, accept, event, code) -> Record:
    """The record with a step that was taken; others go into the row that is thrown away."""
    recorded_states = route.law.state_size
    slopes = tried.slopes
    states = (carry.state, tried.state)
    rates = (slopes[0], slopes[6])
    entry = Record(
        carry.angle,
        carry.width,
        *(values[:recorded_states] for values in (*states, *rates)),
        carry.flags,
        event,
        code,
    )
    row = jnp.where(accept, minimum(carry.steps, route.capacity), route.capacity)
    return jax.tree.map(lambda rows, new: rows.at[row].set(new), carry.record, entry)


def _no_search(events) -> _Search:
    none = jnp.zeros(())
    return _Search(jnp.asarray(False), none, none, events, events, jnp.zeros((), int))


def empty_record(rows: int, states: int, count: int) -> Record:
    table = jnp.zeros((rows, states))
    row = jnp.zeros(rows)
    flat = jnp.full(rows, -1)
    flags = jnp.zeros((rows, count), int)
    return Record(jnp.full(rows, jnp.inf), row, table, table, table, table, flags, flat, flat)


def within_steps(record: Record, angle, row=None):
    """The states that were kept at an angle [rad], by the cubics between the steps."""
    if row is None:
        row = clip(
            jnp.searchsorted(record.angle, angle, side="right") - 1, 0, record.angle.size - 1
        )
    # double where: rows of no width, as those between two events at one place, have no share
    width = record.width[row]
    t = jnp.where(width > 0, (angle - record.angle[row]) / jnp.where(width > 0, width, 1.0), 0.0)
    ends = record.begin[row], record.end[row]
    return cubic_step(t, width, ends, (record.begin_rate[row], record.end_rate[row]))


def _weighted(weights, slopes):
    """Sum of the slopes with their weights; a matrix product would end XLA's one kernel for the loop."""
    return jnp.sum(weights[:, None] * slopes, axis=0)


def _first(at_low, at_high):
    """The event that comes first between two ends, and where, by straight lines."""
    crossing = at_high < _CROSSED
    # what is negative at the lower end already has happened first of all: its share is zero
    drop = jnp.where(crossing, at_low - at_high, 1.0)
    fraction = jnp.where(crossing, maximum(at_low, 0.0) / maximum(drop, 1e-300), jnp.inf)
    which = jnp.argmin(fraction)
    return which, fraction[which]
