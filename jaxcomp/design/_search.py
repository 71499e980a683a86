"""A search by several starts: sample, descent, and a second descent from any better sample."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ._goal import Goal, Solved, solved
from ._lane import (
    RUNNING,
    STEP_LIMIT,
    Lane,
    Numbers,
    new_lanes,
    terms_of,
    told,
    trials,
)
from ._methods import Method
from ._transform import Ranges

# [-] a sample counts as better beyond this share of the objective's spread: above the roughness of
# solutions with few panels (2e-5 of the spread for the efficiency over the bore).
BETTER = 1e-4
# [-] of a constraint's spread over the sample.
FEASIBLE = 1e-6
_ROUNDS = 3


@dataclasses.dataclass
class Search:
    """A search under way; what a callback sees, and what can be kept to resume it.

    Attributes:
        stage: "sample" or "descent".
        done, total: solved designs of the sample, or steps of the descent and their limit.
        evaluations: designs solved in the descent.
        sample: [SI] (n, variables) designs of the sample, with `found` on them.
        found: values, ok and slopes of the sample, as far as it was solved.
        lanes: the starts; `None` before the descent.
        begins: [SI] (starts, variables) where each of them began.
        rounds: descents begun; above one if a sample was better than all starts.
        history: by name, one array (starts, ...) for each step.
    """

    stage: str
    done: int
    total: int
    sample: np.ndarray
    found: Solved | None = None
    evaluations: int = 0
    lanes: Lane | None = None
    begins: np.ndarray | None = None
    rounds: int = 0
    history: dict[str, list[np.ndarray]] = dataclasses.field(default_factory=dict)

    def kept(self) -> dict[str, np.ndarray]:
        """Everything as arrays by name, for a file.

        Raises:
            BadInput: a search that is not yet in its descent.
        """
        if self.lanes is None or self.found is None or self.begins is None:
            raise BadInput("search", self.stage, "in its descent to be kept")
        out: dict[str, Any] = {"counts": np.array([self.done, self.evaluations, self.rounds])}
        out |= {"sample": self.sample, "begins": self.begins}
        out |= {f"found.{name}": np.asarray(a) for name, a in self.found._asdict().items()}
        leaves = jax.tree.leaves(eqx.filter(self.lanes, eqx.is_array))
        out |= {f"lanes.{number}": np.asarray(leaf) for number, leaf in enumerate(leaves)}
        return out | {f"history.{name}": np.stack(rows) for name, rows in self.history.items()}


Callback = Callable[[Search], None]


class Frame(NamedTuple):
    """All that a search needs beside its state."""

    goal: Goal
    method: Method
    ranges: Ranges
    numbers: Numbers
    batch: int


def sampled(goal: Goal, points, batch: int, callback: Callback | None) -> Search:
    """Solve the sample, some designs at a time."""
    search = Search("sample", 0, len(points), np.asarray(points))
    parts = []
    for first in range(0, len(points), 4 * batch):
        parts.append(solved(goal.problem, points[first : first + 4 * batch], batch))
        search.done = min(first + 4 * batch, len(points))
        if callback is not None:
            callback(search)
    search.found = Solved(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    return search


def numbers_of(goal: Goal, found: Solved, tolerance: float) -> Numbers:
    """Scales of all quantities from the sample: the spread of those designs that could be solved."""
    good = np.asarray(found.values)[np.asarray(found.ok)]
    spread = good.std(axis=0)
    middle = good.mean(axis=0)
    # A quantity that does not change over the sample has no scale but its size.
    flat = spread <= 1e-12 * np.abs(middle)
    size = np.where(middle != 0, np.abs(middle), 1.0)
    scale = np.where(flat, size, spread)
    targets = jnp.array([value for _, value in goal.targets], float)
    weight = np.zeros(len(scale))
    if goal.objective is not None:
        weight[goal.objective] = goal.sign
    arrays = (jnp.asarray(a, float) for a in (weight, scale, middle))
    return Numbers(*arrays, targets, jnp.asarray(tolerance), jnp.asarray(FEASIBLE))


def begin(frame: Frame, search: Search, starts, bounds=None) -> None:
    """Put the starts (n, variables) into the search; `bounds` (n, limits) if each has its own."""
    goal = frame.goal
    if bounds is None:
        bounds = np.broadcast_to(
            [limit.bound for limit in goal.limits], (len(starts), len(goal.limits))
        )
    free = frame.ranges.free(jnp.asarray(starts))
    quantities = len(goal.problem.quantities)
    lanes = new_lanes(frame.method, terms_of(goal), free, quantities, jnp.asarray(bounds, float))
    search.lanes, search.rounds = lanes, search.rounds + 1
    begins = np.array(frame.ranges.inside(free))  # a copy that can be written
    search.begins = begins if search.begins is None else search.begins
    search.stage = "descent"


def descend(frame: Frame, search: Search, max_steps: int, callback: Callback | None) -> None:
    """Move all starts until each has ended, or for `max_steps` in all."""
    goal, terms = frame.goal, terms_of(frame.goal)
    search.total = max_steps
    scale = np.asarray(frame.numbers.scale)
    lanes = search.lanes
    assert lanes is not None
    # a search that is resumed with a higher limit goes on where it stopped
    lanes = eqx.tree_at(
        lambda l: l.status, lanes, jnp.where(lanes.status == STEP_LIMIT, RUNNING, lanes.status)
    )
    while search.done < max_steps:
        running = np.asarray(lanes.status) == RUNNING
        if not running.any():
            break
        points = np.asarray(trials(frame.method, lanes, frame.ranges))
        found = _spread(solved(goal.problem, points[running], frame.batch), running)
        lanes = told(frame.method, terms, lanes, found, frame.numbers, frame.ranges)
        values, slot = np.asarray(lanes.at.values), np.asarray(lanes.status)
        row = {
            "values": np.asarray(frame.ranges.inside(lanes.free)),
            "objective": goal.value(values, scale),
            "violation": goal.violation(values, scale),
            "stationarity": np.asarray(lanes.stationarity),
            "ok": np.where(running, np.asarray(found.ok), True),
            "status": slot,
        }
        for name, column in row.items():
            search.history.setdefault(name, []).append(column)
        search.done += 1
        search.evaluations += int(running.sum())
        search.lanes = lanes
        if callback is not None:
            callback(search)
    status = jnp.where(lanes.status == RUNNING, STEP_LIMIT, lanes.status)
    search.lanes = eqx.tree_at(lambda l: l.status, lanes, status)


def merit(frame: Frame, values: np.ndarray, ok: np.ndarray) -> np.ndarray:
    """[-] the objective of designs (..), small is good; infinite where one fails or breaks a bound."""
    scale = np.asarray(frame.numbers.scale)
    value = frame.goal.value(values, scale)
    if frame.goal.objective is not None:
        value = frame.goal.sign * value / scale[frame.goal.objective]
    kept = frame.goal.violation(values, scale) <= 10 * FEASIBLE
    return np.where(ok & kept, value, np.inf)


def lane_merit(frame: Frame, search: Search) -> np.ndarray:
    """[-] as `merit`, where the starts stand."""
    assert search.lanes is not None
    return merit(frame, np.asarray(search.lanes.at.values), np.asarray(search.lanes.at.ok))


def search_all(frame: Frame, search: Search, max_steps: int, callback: Callback | None) -> None:
    """Descend; while a sample is better than every start, descend again from such samples."""
    assert search.found is not None
    known = merit(frame, np.asarray(search.found.values), np.asarray(search.found.ok))
    while True:
        descend(frame, search, max_steps, callback)
        reached = lane_merit(frame, search)
        better = np.flatnonzero(known < reached.min() - BETTER)
        if not better.size or search.rounds >= _ROUNDS or search.done >= max_steps:
            break
        assert search.lanes is not None
        order = better[np.argsort(known[better])]
        _restart(frame, search, reached, search.sample[order])


def _restart(frame: Frame, search: Search, reached, samples) -> None:
    """Move all starts but the best one to better samples."""
    old = search.lanes
    assert old is not None
    assert search.begins is not None
    count = len(reached)
    keep = int(np.argmin(reached)) if np.isfinite(reached).any() and count > 1 else -1
    moved = [number for number in range(count) if number != keep]
    starts = np.asarray(frame.ranges.inside(old.free)).copy()
    starts[moved] = samples[np.arange(len(moved)) % len(samples)]
    begin(frame, search, starts)
    chosen = jnp.zeros(count, bool).at[np.array(moved)].set(True)
    shaped = lambda a: chosen.reshape(-1, *[1] * (a.ndim - 1))  # noqa: E731
    search.lanes = jax.tree.map(
        lambda new, was: jnp.where(shaped(new), new, was) if eqx.is_array(new) else new,
        search.lanes, old,
    )  # fmt: skip
    search.begins[moved] = starts[moved]


def found_in(kept: Mapping[str, np.ndarray]) -> Solved:
    """The solved sample of `Search.kept`."""
    return Solved(*(np.asarray(kept[f"found.{name}"]) for name in Solved._fields))


def restored(frame: Frame, kept: Mapping[str, np.ndarray]) -> Search:
    """The search of `Search.kept`.

    Raises:
        BadInput: a search of another problem or method.
    """
    done, evaluations, rounds = (int(n) for n in kept["counts"])
    found = found_in(kept)
    history = {
        name.removeprefix("history."): list(rows)
        for name, rows in kept.items()
        if name.startswith("history.")
    }
    search = Search("descent", done, 0, kept["sample"], found, evaluations, None, None, 0, history)
    begin(frame, search, kept["begins"])
    search.begins, search.rounds = kept["begins"].copy(), rounds
    arrays, rest = eqx.partition(search.lanes, eqx.is_array)
    leaves, shape = jax.tree.flatten(arrays)
    names = [f"lanes.{number}" for number in range(len(leaves))]
    fits = all(
        n in kept and kept[n].shape == leaf.shape for n, leaf in zip(names, leaves, strict=True)
    )
    if not fits or f"lanes.{len(leaves)}" in kept:
        raise BadInput("resume", "of another shape", "a search of the same problem and method")
    new = [jnp.asarray(kept[n], leaf.dtype) for n, leaf in zip(names, leaves, strict=True)]
    search.lanes = eqx.combine(jax.tree.unflatten(shape, new), rest)
    return search


def _spread(found: Solved, places: np.ndarray) -> Solved:
    """Put the solved designs back among those that were not asked for."""
    where = np.cumsum(places) - 1
    return Solved(*(np.asarray(a)[np.clip(where, 0, None)] for a in found))


def agreeing(values: np.ndarray, best: int, ranges: Ranges) -> np.ndarray:
    """(starts,) which ended within a thousandth of each range of the best one."""
    share = (values - values[best]) / np.asarray(ranges.width)
    return np.max(np.abs(share), axis=1) <= 1e-3
