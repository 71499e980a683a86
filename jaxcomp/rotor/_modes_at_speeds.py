"""Modes of a rotor at some speeds with what moves most in each, and its Campbell diagram."""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from .._core.declared import (
    Record,
    computed,
    computed_part,
    computed_word,
    forwarded,
    held,
    part,
    reading,
    records_of,
    word,
)
from .._core.evidence import Check
from .._core.results import Data, Result, columns_of
from ._campbell import CriticalSpeeds
from ._damped import DampedModes
from ._model import RotorModel, subset_names, subsets
from ._modes import magnetic_pull_limit
from ._nodes import node_names


@dataclasses.dataclass(frozen=True)
class ModelSize(Record):
    """Size of a rotor model, as results show it.

    Attributes:
        degrees_of_freedom: of a node.
        subsets: names of the nodes by subset.
        magnetic_pull_limit: [-] of `jaxcomp.rotor.magnetic_pull_limit`; `None` without magnetic pull.
    """

    degrees_of_freedom: int = reading("")
    subsets: dict[str, list[str]] = word()
    magnetic_pull_limit: float | None = reading("")


def size_of(model: RotorModel, free: bool = False) -> ModelSize:
    """Degrees of freedom of a node, the subsets with their nodes, and the limit of the magnetic pull.

    Args:
        model: the model.
        free: hanging free, a rotor has no bearings that could hold it against the magnetic pull.
    """
    nodes_by_subset = {}
    for name, group in zip(subset_names(model), subsets(model), strict=True):
        nodes_by_subset[name] = list(map(str, group))
    limit = None
    if model.magnetic_pulls and not free:
        limit = float(magnetic_pull_limit(model))
    return ModelSize(model.dof, nodes_by_subset, limit)


@dataclasses.dataclass(frozen=True)
class CriticalSpeed(Record):
    """A critical speed of a Campbell diagram.

    Attributes:
        speed: [rad/s]
        growth: [rad/s] real part of the eigenvalue there.
        damping_ratio: [-]
    """

    speed: float = reading("rad/s")
    growth: float = reading("rad/s")
    damping_ratio: float = reading("")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class CampbellDiagram(Result):
    """Modes over the speed, and where they meet the speed itself.

    Attributes:
        speeds: [rad/s] (s,)
        modes: (s, m) in all fields.
        critical: the critical speeds between the first and the last speed; `None` if not looked for.
    """

    speeds: Float[np.ndarray, " s"] = reading("rad/s", "speed")
    modes: DampedModes = held()
    critical: CriticalSpeeds | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("speed", "mode")

    frequency = forwarded(DampedModes, "modes.frequency", dims=table_dims)
    damping_ratio = forwarded(DampedModes, "modes.damping_ratio", dims=table_dims)
    whirl = forwarded(DampedModes, "modes.whirl", dims=table_dims)

    @computed_part(CriticalSpeed)
    def critical_speeds(self) -> tuple[CriticalSpeed, ...]:
        """The critical speeds with their damping; empty where none were looked for."""
        if self.critical is None:
            return ()
        speed, growth = map(np.asarray, (self.critical.speed, self.critical.growth))
        # at order 1 the eigenvalue is a + i W
        damping = -growth / np.hypot(growth, speed)
        return records_of(CriticalSpeed, speed=speed, growth=growth, damping_ratio=damping)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each speed and mode."""
        count = np.shape(self.modes.whirl)[-1]
        yield from self.data_of(speed="speeds")
        yield Data("mode", "", np.arange(1, count + 1), ("mode",))
        yield from self.data_of("frequency", "damping_ratio", "whirl")
        if self.critical is not None:
            yield from self.critical.data_of(critical_speed="speed", dims=("crossing",))


@dataclasses.dataclass(frozen=True)
class RotorMode(Record):
    """A damped mode at a speed.

    Attributes:
        speed: [rad/s] of the rotor.
        frequency: [rad/s]
        damping_ratio: [-]
        whirl: [-] from 1 (forward) to -1 (backward).
        growth: [rad/s] real part of the eigenvalue.
        subset: name of the subset that moves most.
    """

    speed: float = reading("rad/s", table_only=True)
    frequency: float = reading("rad/s")
    damping_ratio: float = reading("")
    whirl: float = reading("")
    growth: float = reading("rad/s")
    subset: str = word()


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RotorModes(Result):
    """Damped modes of a rotor at some speeds.

    Attributes:
        model: the rotor.
        speeds: [rad/s] (s,)
        modes: at each of them; what a model with few modes lacks is not a number.
        free: whether without links and magnetic pull.
        damping: whether with damping.
        campbell: over a range of speeds, where one was asked for.
    """

    model: RotorModel
    speeds: Float[np.ndarray, " s"] = reading("rad/s", "speed")
    modes: tuple[DampedModes, ...] = held()
    free: bool = word()
    damping: bool = word()
    campbell: CampbellDiagram | None = part(CampbellDiagram, optional=True, default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("row",)

    @computed_part(ModelSize, inline=True)
    def size(self) -> ModelSize:
        """Degrees of freedom and subsets of the rotor."""
        return size_of(self.model, self.free)

    @computed_part(RotorMode, key="modes")
    def modes_at_speeds(self) -> tuple[tuple[RotorMode, ...], ...]:
        """The modes at each speed."""
        return tuple(self.listed(place) for place in range(len(self.modes)))

    @computed_word()
    def stable(self) -> list[bool]:
        """Whether the rotor is stable at each speed."""
        return [bool(modes.stable) for modes in self.modes]

    @computed("rad/s", "speed")
    def growth(self) -> list[Any]:
        """[rad/s] (s,) Largest real part of all eigenvalues but rigid motions at each speed."""
        return [modes.growth for modes in self.modes]

    def moves_most(self, place: int) -> list[str]:
        """Name of the subset that moves most in each mode at a speed.

        Args:
            place: of the speed, from 0.
        """
        names = node_names(self.model)
        words = subset_names(self.model)
        groups = [list(map(names.index, group)) for group in subsets(self.model)]
        # of u_x and u_y alone: rotations have another unit and cannot be compared with them
        size = np.abs(np.asarray(self.modes[place].shape))[..., :2].max(-1)
        largest = np.stack([size[:, group].max(-1) for group in groups], -1)
        # what a model with few modes lacks is not a number, and moves nothing
        exists = np.all(np.isfinite(size), -1)
        moving = []
        for number, mode_exists in zip(largest.argmax(-1), exists, strict=True):
            moving.append(words[number] if mode_exists else "")
        return moving

    def listed(self, place: int) -> tuple[RotorMode, ...]:
        """The modes at a speed, each with its subset.

        Args:
            place: of the speed, from 0.
        """
        modes = self.modes[place]
        listed = records_of(
            RotorMode,
            speed=np.full(np.shape(modes.whirl), self.speeds[place]),
            frequency=modes.frequency,
            damping_ratio=modes.damping_ratio,
            whirl=modes.whirl,
            growth=np.real(modes.eigenvalue),
            subset=self.moves_most(place),
        )
        # what a model with few modes lacks is not a number
        return tuple(mode for mode in listed if np.isfinite(mode.frequency))

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Whether the rotor is stable at every speed."""
        del tolerance
        answer = "unstable"
        if all(self.stable):
            answer = "stable"
        return (Check("Stability", answer, answer == "stable", "no mode grows"),)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each speed and mode."""
        rows = []
        numbers = []
        for modes in self.modes_at_speeds:
            rows += modes
            numbers += range(1, len(modes) + 1)
        if not rows:
            return
        speed, frequency, damping_ratio, whirl, *_ = columns_of(rows, *self.table_dims)
        yield speed
        yield Data("mode", "", np.array(numbers), self.table_dims)
        yield from (frequency, damping_ratio, whirl)
