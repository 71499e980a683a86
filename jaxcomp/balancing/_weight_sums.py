"""Sums of weights of a stock at the places of one plane, found by where they lie.

A combination of weights acts by its sum, a point of the complex plane, so that the one nearest to a
wanted correction is found in a tree of points. Where all sums are too many to list, those of half the
weights are, and a sum is a pair of them: 36 places for up to four weights of five sizes make 37 million
sums, but 16 thousand of two.
"""

from itertools import chain
from typing import NamedTuple

import numpy as np

# [-] Over the largest sum: what lies nearer is the same point.
_SAME_POINT = 1e-11


class Choices(NamedTuple):
    """Weights that can be set in one plane, in the order of the places and of the stock within them.

    Attributes:
        unbalance: [kg m] (choices,) of each weight at each place, complex.
        mass: [kg] (choices,)
        place, kind: (choices,) numbers of place and weight.
        per_place: weights that one place takes.
        most_weights: in the plane.
        counts: (kinds,) how many weights of each kind there are; `None` for any number.
    """

    unbalance: np.ndarray
    mass: np.ndarray
    place: np.ndarray
    kind: np.ndarray
    per_place: int
    most_weights: int
    counts: np.ndarray | None


class Candidate(NamedTuple):
    """A combination of weights.

    Attributes:
        distance: [kg m] of its sum from what was wanted.
        mass: [kg] of all its weights.
        sum: [kg m]
        picks: numbers of the choices.
    """

    distance: float
    mass: float
    sum: complex
    picks: tuple[int, ...]


class _Listed(NamedTuple):
    """Sums in a list: (n,) values and masses, (n, most_weights) picks with -1 behind the last."""

    values: np.ndarray
    mass: np.ndarray
    picks: np.ndarray


class WeightSums:
    """All sums of up to a number of weights in one plane.

    Args:
        choices: what can be set.
        limit: sums to list at most.

    Attributes:
        complete: whether all combinations are among them.
        paired: whether a sum is a pair of listed ones.
        size: how many points there are to look at.
    """

    def __init__(self, choices: Choices, limit: int):
        from scipy.spatial import KDTree  # a tenth of a second, for those who choose weights

        self.choices = choices
        listed = _listed(choices, choices.most_weights, limit)
        self.paired = listed is None
        self.complete = True
        if listed is None:
            listed, reach = _largest_half(choices, limit)
            self.complete = 2 * reach >= choices.most_weights
        elif choices.counts is None:
            # Not of halves, of which a heavier one may be the only one that leaves a place free.
            listed = _lightest(listed)
        self._list = listed
        self.size = len(listed.values)
        self._scale = float(np.abs(listed.values).max()) or 1.0
        self._tree = KDTree(_points(listed.values))
        self._number = np.sum(listed.picks >= 0, axis=1)
        self._used = _tally(listed.picks, choices.kind)
        # whole combinations are listed within what a place takes; two halves may crowd it together
        self._load = None
        if self.paired:
            self._load = _tally(listed.picks, choices.place)

    def nearest(self, target: complex, free: np.ndarray | None) -> Candidate | None:
        """The nearest sum, of several the lightest; `None` where the stock has none.

        Args:
            target: [kg m]
            free: (kinds,) how many weights of each kind are left; `None` for any number.
        """
        centres = self._centres(target)
        radius = float(self._tree.query(_points(centres))[0].min())
        reach = float(np.abs(target)) + 2 * self._scale
        while True:
            # The nearest sum may take weights that the stock has no more: further out, by and by.
            radius = radius * (1 + 1e-9) + _SAME_POINT * self._scale
            near = self.within(target, radius, free)
            if near.distance.size:
                closest = near.distance[0] * (1 + 1e-9) + _SAME_POINT * self._scale
                # the lightest, then that of fewest weights: `lexsort` begins with its last key
                ties = np.flatnonzero(near.distance <= closest)
                return self.candidate(
                    near, int(ties[np.lexsort((near.number[ties], near.mass[ties]))[0]])
                )
            if radius > reach:
                return None
            radius *= 1.5

    def within(self, target: complex, radius: float, free: np.ndarray | None) -> "Near":
        """All sums within a distance that the stock allows, the nearest first."""
        listed = self._list
        centres = self._centres(target)
        # No sum is further away, not of pairs either.
        radius = min(radius, 4 * self._scale + abs(target))
        neighbours = self._tree.query_ball_point(_points(centres), radius)
        first = np.repeat(np.arange(len(neighbours)), list(map(len, neighbours)))
        second = np.fromiter(chain.from_iterable(neighbours), int)
        distance = np.abs(centres[first] - listed.values[second])
        mass = listed.mass[second]
        number = self._number[second]
        used = self._used[second]
        allowed = np.ones(second.size, bool)
        if self._load is not None:
            mass = mass + listed.mass[first]
            number = number + self._number[first]
            used = used + self._used[first]
            load = self._load[first] + self._load[second]
            allowed &= (load.max(axis=1, initial=0) <= self.choices.per_place) & (
                number <= self.choices.most_weights
            )
        if free is not None:
            allowed &= np.all(used <= free, axis=1)
        admissible = np.flatnonzero(allowed)
        order = admissible[np.lexsort((mass[admissible], distance[admissible]))]
        return Near(distance[order], mass[order], number[order], first[order], second[order])

    def candidate(self, near: "Near", place: int) -> Candidate:
        """One of the sums that were found, with its weights."""
        numbers = self._list.picks[near.second[place]]
        if self.paired:
            numbers = np.append(numbers, self._list.picks[near.first[place]])
        picks = np.sort(numbers[numbers >= 0])
        total = complex(self.choices.unbalance[picks].sum())
        return Candidate(
            float(near.distance[place]), float(near.mass[place]), total, tuple(picks.tolist())
        )

    def used(self, picks: tuple[int, ...]) -> np.ndarray:
        """(kinds,) Weights of each kind in a combination."""
        return np.bincount(self.choices.kind[list(picks)], minlength=self.choices.kind.max() + 1)

    def _centres(self, target: complex) -> np.ndarray:
        """Points at which the list is looked at: what is wanted, less the first half of a pair."""
        if self.paired:
            return target - self._list.values
        return np.array([target])


class Near(NamedTuple):
    """Sums near a point, each the entry `second` of the list, of a pair with its entry `first`."""

    distance: np.ndarray
    mass: np.ndarray
    number: np.ndarray
    first: np.ndarray
    second: np.ndarray


def _tally(picks: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(n, labels) How often each label is among the choices that are picked."""
    tally = np.zeros((len(picks), int(label.max()) + 1), np.int16)
    for column in picks.T:
        rows = np.flatnonzero(column >= 0)
        tally[rows, label[column[rows]]] += 1
    return tally


def _points(values: np.ndarray) -> np.ndarray:
    return np.stack([np.real(values), np.imag(values)], -1)


def _largest_half(choices: Choices, limit: int) -> tuple[_Listed, int]:
    """The sums of as many weights as can be listed, up to half of all, and how many these are."""
    reach = (choices.most_weights + 1) // 2
    while True:
        half = _listed(choices, reach, limit)
        if half is not None:
            return half, reach
        reach -= 1


def _listed(choices: Choices, count_limit: int, limit: int) -> _Listed | None:
    """All sums of up to `count_limit` weights; `None` if they are more than the limit."""
    values = [np.zeros(1, complex)]
    masses = [np.zeros(1)]
    picks = [np.full((1, count_limit), -1, np.int32)]
    # Each sum grows by choices from its last one on, so that no combination comes twice.
    last_choice = np.full(1, -1)
    at_place = np.zeros(1, int)
    kinds = int(choices.kind.max()) + 1
    used = np.zeros((1, kinds), int)
    count = 1
    for level in range(count_limit):
        # one row for each choice, one column for each sum so far
        allowed = np.array(
            [_growing(choices, number, last_choice, at_place, used)
             for number in range(choices.mass.size)]
        )  # fmt: skip
        count += int(allowed.sum())
        if count > limit and count_limit > 1:
            return None
        numbers, parents = np.nonzero(allowed)
        if not parents.size:
            break
        next_picks = picks[-1][parents].copy()
        next_picks[:, level] = numbers
        # the empty sum has no last choice; the first one stands in for it, and is masked
        same_place = (last_choice[parents] >= 0) & (
            choices.place[numbers] == choices.place[np.maximum(last_choice[parents], 0)]
        )
        values.append(values[-1][parents] + choices.unbalance[numbers])
        masses.append(masses[-1][parents] + choices.mass[numbers])
        picks.append(next_picks)
        at_place = np.where(same_place, at_place[parents] + 1, 1)
        used = used[parents]
        used[np.arange(used.shape[0]), choices.kind[numbers]] += 1
        last_choice = numbers
    return _Listed(np.concatenate(values), np.concatenate(masses), np.concatenate(picks))


def _growing(choices: Choices, number: int, last_choice, at_place, used) -> np.ndarray:
    """Mask of the sums that a choice may join."""
    # only the empty sum is there, which any choice may join
    if last_choice[0] < 0:
        fits = np.ones(last_choice.size, bool)
    else:
        same = choices.place[last_choice] == choices.place[number]
        fits = (last_choice <= number) & (~same | (at_place < choices.per_place))
    if choices.counts is not None:
        kind = choices.kind[number]
        fits &= used[:, kind] < choices.counts[kind]
    return fits


def _lightest(sums: _Listed) -> _Listed:
    """The lightest of combinations with the same sum: opposite weights of equal size do nothing."""
    scale = float(np.abs(sums.values).max()) or 1.0
    # On a grid, where equal sums sort next to each other. Two that fall into neighbouring cells both
    # stay, which costs a point and loses none.
    grid = np.round(_points(sums.values) / scale * 1e10).astype(np.int64)
    order = np.lexsort((sums.mass, grid[:, 1], grid[:, 0]))
    new = np.ones(order.size, bool)
    new[1:] = np.any(grid[order[1:]] != grid[order[:-1]], axis=1)
    first = order[new]
    return _Listed(sums.values[first], sums.mass[first], sums.picks[first])
