"""The sizes of the cycle's program that designs climb, until each has room for its events.

How many events of the valves a revolution has is known once it has been marched. A single machine, the
designs of a sweep and the points of a map climb alike: those that lack room in one size are tried again,
together, in the next that has room for what was seen of them.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from .._core.extremes import max_of
from .._core.status import Status, raise_at_run_time
from ._cycle import Cycle
from ._cycle_options import CycleOptions, may_lack_room
from ._gas_evidence import gas_evidence
from ._several import SeveralCycles, is_solved, of_each

Answer = TypeVar("Answer")

# In place of a number of events, of a cycle that needs no more room.
_FITS = -1


def events_without_room(cycle: Cycle, status: Status) -> Int[Array, ""]:
    """Events seen in a cycle that may be found in a larger size; -1 where it needs none.

    A cycle that was found may need one all the same: with a light crank, or with suction gas that losses
    warm, it is solved again and again, and few panels resolve it well enough once and not the next time.

    Args:
        cycle: of one cylinder, or with an axis of several, of which the one with most events counts.
        status: of the machine that it belongs to.
    """
    lacks = _may_lack_room(cycle, status)
    return max_of(jnp.where(lacks, cycle.event_count, _FITS))


def _may_lack_room(cycle: Cycle, status: Status) -> Bool[Array, "*n"]:
    """Whether a cycle, or the machine that it belongs to, may be found in a larger size."""
    return may_lack_room(cycle.status) | may_lack_room(status)


class Climb:
    """Designs on their way through the sizes: which of them are to be tried in which size.

    Iterating over it yields the options of a size and the numbers of the designs that are tried in it,
    and `note` wants to know what was seen of these before the next size is asked for.
    """

    def __init__(self, ladder: "Sequence[CycleOptions | None]", count: int = 1):
        """Designs at the foot of a ladder.

        Args:
            ladder: options of every size, see `CycleOptions.ladder`; one that is `None` for designs
                without valves, which need no sizes.
            count: of the designs.
        """
        self._ladder = ladder
        self._rung = np.zeros(count, int)

    def __iter__(self) -> "Iterator[tuple[CycleOptions | None, Int[np.ndarray, ' rows']]]":
        """Options of each size that is asked for, and the designs in it."""
        for rung, options in enumerate(self._ladder):
            rows = np.flatnonzero(self._rung == rung)
            if rows.size:
                yield options, rows

    def note(self, rows: Int[np.ndarray, " rows"], events) -> None:
        """Take down what was seen of designs.

        Args:
            rows: numbers of the designs.
            events: (rows,) of each, as `events_without_room` counts them.
        """
        for row, event_count in zip(rows, np.atleast_1d(np.asarray(events)), strict=True):
            self._rung[row] = self._next_rung(self._rung[row], event_count)

    def _next_rung(self, rung: int, events: int) -> int:
        """The next size that has room for the events; the top for a design that needs none."""
        # one beyond the last size: there a design is not tried any more
        top = len(self._ladder)
        if events == _FITS:
            return top
        for above in range(rung + 1, top):
            options = self._ladder[above]
            assert options is not None
            # the largest size is tried in any case, as nothing but the march stands behind it
            if not options.may_grow or options.has_room(events, 0):
                return above
        return top


def climbed(
    solve: Callable[[CycleOptions], Answer], options: CycleOptions, by_march: bool = True
) -> tuple[Answer, CycleOptions]:
    """A machine in the size that has room for it, and the options of that size.

    Args:
        solve: by options; the answer is a cycle, or has it as `cycle`.
        options: of the first size.
        by_march: whether the march stands behind the largest size.
    """
    answer = solve(options)
    events = _events_of(answer)
    if events == _FITS:
        return answer, options  # as most do, for whom no ladder is put up
    reached = options
    alone = np.zeros(1, int)
    climb = Climb(options.ladder(by_march))
    climb.note(alone, events)
    for size, _ in climb:
        assert size is not None
        larger = solve(size)
        is_march_behind = size.method != options.method
        if is_march_behind and not is_solved(_cycle_of(larger)):
            break  # what collocation found out in the largest size says more
        answer = larger
        reached = size
        climb.note(alone, _events_of(answer))
    return answer, reached


def _events_of(answer) -> int:
    """Events for which a solution that is a cycle or has one had no room; `_FITS` where it had."""
    cycle = _cycle_of(answer)
    # by NumPy, since most have room and need no program to be told so
    if not np.any(_may_lack_room(cycle, answer.status)):
        return _FITS
    return int(events_without_room(cycle, answer.status))


def _cycle_of(answer) -> Cycle:
    """The cycle of a solution that is one or has one, of several with an axis of them."""
    return of_each(getattr(answer, "cycle", answer))


def evidence(cycle: Cycle | SeveralCycles, options: CycleOptions) -> str:
    """Evidence of how far a solution came that was not found, for the message."""
    each = of_each(cycle)
    words = _evidence(options, each.valve_events, each.revolutions, each.residual)
    return "; ".join(filter(None, (gas_evidence(cycle), words)))


def _most_events(valve_events) -> Int[np.ndarray, "2"]:
    """Events of both valves of the cylinder, or design of a batch, that has most of them."""
    each = np.reshape(valve_events, (-1, 2))
    return each[np.argmax(np.sum(each, axis=1))]


def _evidence(options: CycleOptions, valve_events, revolutions, residual) -> str:
    suction, discharge = _most_events(valve_events)
    return (
        f"{suction + discharge} events of the valves in a revolution, {suction} of suction and "
        f"{discharge} of discharge, on {options.panel_count} panels, "
        f"{int(np.max(revolutions))} revolutions marched, last change of the cycle "
        f"{float(np.max(residual)):.2g}"
    )


def _size_with_room(options: CycleOptions, events: int) -> CycleOptions | None:
    """The next size that has room for so many events; `None` where there is none."""
    climb = Climb(options.ladder(by_march=False))
    climb.note(np.zeros(1, int), events)
    return next((size for size, _ in climb), None)


def _evidence_in_program(options: CycleOptions, valve_events, revolutions, residual) -> str:
    message = _evidence(options, valve_events, revolutions, residual)
    larger = _size_with_room(options, int(np.sum(_most_events(valve_events))))
    if larger is not None:
        larger = larger.of_several(1)  # panels and steps are given of each cylinder
        message += (
            "; a compiled program has one size: solve and differentiate outside of `jit`, where the size "
            f"follows from the machine, or give CycleOptions(least_panels={larger.panel_count}, "
            f"capacity={larger.kept_steps}, max_passes={larger.passes_of_revolution})"
        )
    return f"{message}; `throw=False` leaves it to `status`"


def raise_where_unsolved(cycle: Cycle | SeveralCycles, options: CycleOptions) -> None:
    """Let a traced program end with an error where its cycle was not found."""
    each = of_each(cycle)
    words = partial(_evidence_in_program, options)
    numbers = each.valve_events, each.revolutions, each.residual
    raise_at_run_time(each.status, ~is_solved(each), words, *numbers)
