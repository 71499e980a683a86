"""Options of the solver of the cycle, and the sizes of its program, which a machine climbs as it needs.

A program has a fixed number of panels, on which the events of the valves and the course between them are
laid, and a record of the march with a fixed number of steps. Most machines need few of both; how many a
machine needs is known after it has been marched. So there are a few sizes: the first one is tried, and
what does not fit goes on in the next that has room, see `_climb`.
"""

import dataclasses
from typing import Literal, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import maximum
from .._core.status import Status, ended_in


class Size(NamedTuple):
    """Numbers that are fixed in a program of the cycle."""

    growth: float  # panels over those of the first size
    capacity: int  # steps of a revolution that are kept
    max_passes: int  # tries of steps in a revolution
    max_revolutions: int  # marched at a stretch


# Each is tried where the one before has too little room. Of 100 scattered machines (300 to 6,000 rpm,
# springs of 60 to 8,000 N/m) half have more than 28 events in a revolution and 5 more than 137; a
# revolution takes 300 to 12,000 tries of steps.
SIZES = (
    Size(growth=1.0, capacity=768, max_passes=4_000, max_revolutions=30),
    Size(growth=8 / 3, capacity=4_096, max_passes=20_000, max_revolutions=30),
    Size(growth=20 / 3, capacity=16_384, max_passes=200_000, max_revolutions=60),
    Size(growth=16.0, capacity=65_536, max_passes=1_000_000, max_revolutions=200),
)
# Panels for every stretch between two events, so that the course between them is resolved. On 48 panels
# 9 of 100 scattered machines, all with 25 events and more, were off by 1e-5 to 9e-5.
_PANELS_PER_STRETCH = 2.5
# Gauss nodes on a panel, of which so many panels lie between two events.
_NODES = 6
# Tolerance of the first march over that of the smallest size. With sixty events a march to 3e-5 misses
# one in five times out of six, which costs another round of Newton's method: a design took 88 ms with it,
# 51 ms with 3e-7, of which the finer march is 3 ms.
_FINER_MARCH = 0.01
# Share of the tolerance beyond which no march before the collocation is finer: Newton's method closes the
# rest, and where that does not hold, the march by `value_tolerance` stands.
_FINEST_MARCH = 1e-3
# Panels of the smallest size behind pipes, whose pressure swings within the stretches between events: on
# 48 the derivative of the work by the length of a pipe was off by 7e-4, on 64 by 1e-5.
_LEAST_BEHIND_PIPES = 64
# [-] Resolution beyond which more panels are taken: such cycles were off by 1e-5 and more.
COARSE = 3e-3


class CycleOptions(eqx.Module):
    """Options of the solver of the cycle.

    What is `None` follows from what the machine needs.

    Attributes:
        method: "collocation" marches until the sequence of events stands and then solves for the
            whole revolution by Newton's method; "march" goes on marching. With quasi-steady ports
            the march is all there is, and derivatives are refused.
        nodes: Gauss nodes on every panel; six if absent, and `first_nodes` in the first size.
        panels: into which the revolution is cut; one more than events are needed at least.
        tolerance: [-] last step of Newton's method.
        march_tolerance: [-] error of a step of the march before the collocation, in the smallest size; a
            hundredth of it in larger sizes, a tenth of what it was in every further round. Where a port
            chokes, derivatives are off by what the march misses of the angle at which it begins to.
        value_tolerance: [-] the same where the march gives the values.
        max_newton: steps.
        max_revolutions: marched at a stretch.
        max_rounds: of march and Newton's method.
        max_passes: tries of steps in a revolution.
        capacity: steps of a revolution that are kept.
        least_panels: of the smallest size.
        first_nodes: on every panel of the smallest size, whose panels are wider than those of others.
        size: of `SIZES`, with which a solution begins.
        cylinders: that are solved together; panels and steps are those of each.
    """

    method: Literal["collocation", "march"] = eqx.field(static=True, default="collocation")
    nodes: int | None = eqx.field(static=True, default=None)
    panels: int | None = eqx.field(static=True, default=None)
    tolerance: float | Float[Array, ""] = 1e-11
    march_tolerance: float | Float[Array, ""] = 3e-5
    value_tolerance: float | Float[Array, ""] = 1e-8
    max_newton: int = eqx.field(static=True, default=8)
    max_revolutions: int | None = eqx.field(static=True, default=None)
    max_rounds: int = eqx.field(static=True, default=4)
    max_passes: int | None = eqx.field(static=True, default=None)
    capacity: int | None = eqx.field(static=True, default=None)
    least_panels: int = eqx.field(static=True, default=48)
    first_nodes: int = eqx.field(static=True, default=_NODES)
    size: int = eqx.field(static=True, default=0)
    cylinders: int = eqx.field(static=True, default=1)

    @property
    def panel_count(self) -> int:
        """Panels of the program."""
        of_each = self.panels or round(self.least_panels * SIZES[self.size].growth)
        return self.cylinders * of_each

    @property
    def panel_nodes(self) -> int:
        """Gauss nodes on every panel of the program."""
        if self.nodes is not None:
            return self.nodes
        return self.first_nodes if self.size == 0 else _NODES

    @property
    def kept_steps(self) -> int:
        """Steps of a revolution that are kept."""
        return self.cylinders * (self.capacity or SIZES[self.size].capacity)

    @property
    def passes_of_revolution(self) -> int:
        """Tries of steps in a revolution, at most."""
        return self.cylinders * (self.max_passes or SIZES[self.size].max_passes)

    def march_tolerance_of(self, number: Int[Array, ""]) -> Float[Array, ""]:
        """[-] Error of a step of the march of a round.

        Args:
            number: of the round; that of the first is 0, and -1 of what begins with a start.
        """
        first = 1.0 if self.size == 0 else _FINER_MARCH
        # where a branch was left, a coarser march has missed an event
        share = first * 0.1 ** maximum(number, 0)
        return maximum(share, _FINEST_MARCH) * self.march_tolerance

    @property
    def revolutions_at_most(self) -> int:
        """Marched at a stretch."""
        return self.max_revolutions or SIZES[self.size].max_revolutions

    @property
    def may_grow(self) -> bool:
        """Whether there is a larger size."""
        # what a user has fixed does not grow, but there is another size as long as one of the
        # numbers is free
        return self.size + 1 < len(SIZES) and None in (self.panels, self.capacity, self.max_passes)

    @property
    def may_march(self) -> bool:
        """Whether the march may stand where Newton's method does not hold: not with given numbers."""
        return not self.may_grow and (self.panels, self.capacity, self.max_passes) == (None,) * 3

    def has_room(self, events: Int[Array, ""], steps: Int[Array, ""]) -> Bool[Array, ""]:
        """Whether a revolution is resolved in this size; in the largest, whether it fits at all.

        Args:
            events: of the revolution.
            steps: of its march.
        """
        # room for the course between the events decides as long as there are larger sizes; in the
        # last one an edge for every event has to do
        fits = steps <= self.kept_steps
        if self.panels is not None or not self.may_grow:
            return fits & (events < self.panel_count)
        return fits & (_PANELS_PER_STRETCH * (events + 1) <= self.panel_count)

    def grown(self) -> "CycleOptions | None":
        """The options in the next size, if there is one."""
        if not self.may_grow:
            return None
        return dataclasses.replace(self, size=self.size + 1)

    def ladder(self, by_march: bool = True) -> tuple["CycleOptions", ...]:
        """The options in this size and in all larger ones, the smallest first.

        Args:
            by_march: whether the march stands behind the largest size, where it may.
        """
        sizes = [self]
        while (larger := sizes[-1].grown()) is not None:
            sizes.append(larger)
        # behind all sizes of the collocation: its values stand, but have no derivatives
        march = sizes[-1].by_march()
        if by_march and march is not None:
            sizes.append(march)
        return tuple(sizes)

    def by_march(self) -> "CycleOptions | None":
        """The march, which stands behind the largest size; `None` where it may not."""
        if self.method == "march" or not self.may_march:
            return None
        return dataclasses.replace(self, method="march", size=len(SIZES) - 1)

    def behind_pipes(self) -> "CycleOptions":
        """The options where lines are networks of pipes."""
        least_panels = max(self.least_panels, _LEAST_BEHIND_PIPES)
        return dataclasses.replace(self, least_panels=least_panels, first_nodes=_NODES)

    def of_several(self, count: int) -> "CycleOptions":
        """The options where cylinders are solved together: panels and steps are those of each."""
        return dataclasses.replace(self, cylinders=count)


def may_lack_room(status: Status) -> Bool[Array, "*n"]:
    """Whether a cycle that ended so may be found in a larger size."""
    return ended_in(status, Status.too_many_events, Status.not_converged)
