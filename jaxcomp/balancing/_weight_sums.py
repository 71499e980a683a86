"""Sums of weights of a stock at the places of one plane, found by where they lie.

A combination of weights acts by its sum, a point of the complex plane, so that the one nearest to a
wanted correction is found in a tree of points. Where all sums are too many to list, those of half the
weights are, and a sum is a pair of them: 36 places for up to four weights of five sizes make 37 million
sums, but 16 thousand of two.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

# [-] Over the largest sum: what lies nearer is the same point.
_SAME_POINT = 1e-11


class Choices(NamedTuple):
    """Weights that can be set in one plane, in the order of the places and of the stock within them.

    Attributes:
        unbalance: [kg m] (choices,) of each weight at each place, complex.
        mass: [kg] (choices,)
        place, kind: (choices,) numbers of place and weight.
        per_place: weights that one place takes.
        most: weights in the plane.
        counts: (kinds,) how many weights of each kind there are; `None` for any number.
    """

    unbalance: np.ndarray
    mass: np.ndarray
    place: np.ndarray
    kind: np.ndarray
    per_place: int
    most: int
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
    """Sums in a list: (n,) values and masses, (n, most) picks with -1 behind the last."""

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
        self.choices = choices
        whole = _listed(choices, choices.most, limit)
        self.paired = whole is None
        self.complete = True
        if whole is None:
            whole, reach = _largest_half(choices, limit)
            self.complete = 2 * reach >= choices.most
        elif choices.counts is None:
            # Not of halves, of which a heavier one may be the only one that leaves a place free.
            whole = _lightest(whole)
        self._list = whole
        self.size = len(whole.values)
        self._scale = float(np.abs(whole.values).max()) or 1.0
        self._tree = KDTree(_points(whole.values))

    def nearest(self, wanted: complex, free: np.ndarray | None) -> Candidate | None:
        """The nearest sum, of several the lightest; `None` where the stock has none.

        Args:
            wanted: [kg m]
            free: (kinds,) how many weights of each kind are left; `None` for any number.
        """
        centres = self._centres(wanted)
        radius = float(self._tree.query(_points(centres))[0].min())
        reach = float(np.abs(wanted)) + 2 * self._scale
        while True:
            # The nearest sum may take weights that the stock has no more: further out, by and by.
            radius = radius * (1 + 1e-9) + _SAME_POINT * self._scale
            candidates = self.within(wanted, radius, free)
            if candidates:
                closest = candidates[0].distance * (1 + 1e-9) + _SAME_POINT * self._scale
                ties = [each for each in candidates if each.distance <= closest]
                return min(ties, key=lambda each: (each.mass, len(each.picks)))
            if radius > reach:
                return None
            radius *= 1.5

    def within(self, wanted: complex, radius: float, free: np.ndarray | None) -> list[Candidate]:
        """All sums within a distance that the stock allows, the nearest first."""
        centres = self._centres(wanted)
        radius = min(radius, 4 * self._scale + abs(wanted))
        found = self._tree.query_ball_point(_points(centres), radius)
        candidates: dict[tuple[int, ...], Candidate] = {}
        for first, seconds in enumerate(found):
            for second in seconds:
                picks = self._picks(first, second)
                if picks not in candidates and self._allowed(picks, free):
                    candidates[picks] = self._candidate(picks, wanted)
        return sorted(candidates.values(), key=lambda each: (each.distance, each.mass))

    def _centres(self, wanted: complex) -> np.ndarray:
        """Where the list is looked at: what is wanted, less the first half of a pair."""
        return wanted - self._list.values if self.paired else np.array([wanted])

    def _picks(self, first: int, second: int) -> tuple[int, ...]:
        numbers = self._list.picks[second].tolist()
        if self.paired:
            numbers = numbers + self._list.picks[first].tolist()
        return tuple(sorted(number for number in numbers if number >= 0))

    def _allowed(self, picks: tuple[int, ...], free: np.ndarray | None) -> bool:
        choices = self.choices
        if len(picks) > choices.most:
            return False
        numbers = list(picks)
        if self.paired and np.bincount(choices.place[numbers]).max(initial=0) > choices.per_place:
            return False
        return free is None or bool(np.all(self.used(picks) <= free))

    def used(self, picks: tuple[int, ...]) -> np.ndarray:
        """(kinds,) Weights of each kind in a combination."""
        return np.bincount(self.choices.kind[list(picks)], minlength=self.choices.kind.max() + 1)

    def _candidate(self, picks: tuple[int, ...], wanted: complex) -> Candidate:
        numbers = list(picks)
        total = complex(self.choices.unbalance[numbers].sum())
        mass = float(self.choices.mass[numbers].sum())
        return Candidate(abs(total - wanted), mass, total, picks)


def _points(values: np.ndarray) -> np.ndarray:
    return np.stack([np.real(values), np.imag(values)], -1)


def _largest_half(choices: Choices, limit: int) -> tuple[_Listed, int]:
    """The sums of as many weights as can be listed, up to half of all, and how many these are."""
    reach = (choices.most + 1) // 2
    while True:
        half = _listed(choices, reach, limit)
        if half is not None:
            return half, reach
        reach -= 1


def _listed(choices: Choices, most: int, limit: int) -> _Listed | None:
    """All sums of up to `most` weights; `None` if they are more than the limit."""
    values = [np.zeros(1, complex)]
    masses = [np.zeros(1)]
    picks = [np.full((1, most), -1, np.int32)]
    # Each sum grows by choices from its last one on, so that no combination comes twice.
    last, here = np.full(1, -1), np.zeros(1, int)
    kinds = int(choices.kind.max()) + 1
    used = np.zeros((1, kinds), int)
    count = 1
    for level in range(most):
        allowed = [
            _growing(choices, number, last, here, used) for number in range(choices.mass.size)
        ]
        count += sum(int(mask.sum()) for mask in allowed)
        if count > limit and most > 1:
            return None
        grown = [np.flatnonzero(mask) for mask in allowed]
        parents = np.concatenate(grown)
        if not parents.size:
            break
        numbers = np.repeat(np.arange(choices.mass.size), [each.size for each in grown])
        next_picks = picks[-1][parents].copy()
        next_picks[:, level] = numbers
        same_place = (last[parents] >= 0) & (
            choices.place[numbers] == choices.place[np.maximum(last[parents], 0)]
        )
        values.append(values[-1][parents] + choices.unbalance[numbers])
        masses.append(masses[-1][parents] + choices.mass[numbers])
        picks.append(next_picks)
        here = np.where(same_place, here[parents] + 1, 1)
        used = used[parents]
        used[np.arange(used.shape[0]), choices.kind[numbers]] += 1
        last = numbers
    return _Listed(np.concatenate(values), np.concatenate(masses), np.concatenate(picks))


def _growing(choices: Choices, number: int, last, here, used) -> np.ndarray:
    """Which sums a choice may join."""
    if last[0] < 0:
        fits = np.ones(last.size, bool)
    else:
        same = choices.place[last] == choices.place[number]
        fits = (last <= number) & (~same | (here < choices.per_place))
    if choices.counts is not None:
        kind = choices.kind[number]
        fits &= used[:, kind] < choices.counts[kind]
    return fits


def _lightest(sums: _Listed) -> _Listed:
    """Of combinations with the same sum the lightest: opposite weights of equal size do nothing."""
    scale = float(np.abs(sums.values).max()) or 1.0
    grid = np.round(_points(sums.values) / scale * 1e10).astype(np.int64)
    order = np.lexsort((sums.mass, grid[:, 1], grid[:, 0]))
    new = np.ones(order.size, bool)
    new[1:] = np.any(grid[order[1:]] != grid[order[:-1]], axis=1)
    first = order[new]
    return _Listed(sums.values[first], sums.mass[first], sums.picks[first])
