"""Modes of a rotor at some speeds with what moves most in each, and its Campbell diagram."""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from .._core.nested import fields_of, records
from .._core.results import Data, Result
from ._campbell import CriticalSpeeds
from ._damped import DampedModes
from ._model import RotorModel, subset_names, subsets
from ._modes import magnetic_pull_limit
from ._nodes import node_names

# Units of `size_of`.
SIZE = "degrees_of_freedom, magnetic_pull_limit"


def size_of(model: RotorModel, free: bool = False) -> dict[str, Any]:
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
    return {
        "degrees_of_freedom": model.dof,
        "subsets": nodes_by_subset,
        "magnetic_pull_limit": limit,
    }


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class CampbellDiagram(Result):
    """Modes over the speed, and where they meet the speed itself.

    Attributes:
        speeds: [rad/s] (s,)
        modes: (s, m) in all fields.
        critical: the critical speeds between the first and the last speed; `None` if not looked for.
    """

    speeds: Float[np.ndarray, " s"]
    modes: DampedModes
    critical: CriticalSpeeds | None = None

    table_dims: ClassVar[tuple[str, ...]] = ("speed", "mode")
    nested_units: ClassVar[str] = """
        speeds, frequency [rad/s]; damping_ratio, whirl
        critical_speeds: speed, growth [rad/s]; damping_ratio
    """

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each speed and mode."""
        count = np.shape(self.modes.whirl)[-1]
        yield Data("speed", "rad/s", self.speeds, ("speed",))
        yield Data("mode", "", np.arange(1, count + 1), ("mode",))
        yield Data("frequency", "rad/s", self.modes.frequency, self.table_dims)
        yield Data("damping_ratio", "", self.modes.damping_ratio, self.table_dims)
        yield Data("whirl", "", self.modes.whirl, self.table_dims, "1 forward, -1 backward")
        if self.critical is not None:
            yield Data("critical_speed", "rad/s", self.critical.speed, ("crossing",))

    def nested(self) -> dict[str, Any]:
        """Speeds with the modes at each, and the critical speeds."""
        critical = []
        if self.critical is not None:
            speed, growth = map(np.asarray, (self.critical.speed, self.critical.growth))
            # at order 1 the eigenvalue is a + i W
            damping = -growth / np.hypot(growth, speed)
            critical = records(speed=speed, growth=growth, damping_ratio=damping)
        modes = fields_of(self.modes, "frequency", "damping_ratio", "whirl")
        return {"speeds": self.speeds, **modes, "critical_speeds": critical}


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
    speeds: Float[np.ndarray, " s"]
    modes: tuple[DampedModes, ...]
    free: bool
    damping: bool
    campbell: CampbellDiagram | None = None

    table_dims: ClassVar[tuple[str, ...]] = ("row",)
    nested_units: ClassVar[str] = f"""{SIZE}
        speeds, growth [rad/s]
        modes: frequency, growth [rad/s]; damping_ratio, whirl
    """

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

    def listed(self, place: int) -> list[dict[str, Any]]:
        """The modes at a speed, each with its subset, in SI units.

        Args:
            place: of the speed, from 0.
        """
        modes = self.modes[place]
        rows = records(
            frequency=modes.frequency,
            damping_ratio=modes.damping_ratio,
            growth=np.real(modes.eigenvalue),
            whirl=modes.whirl,
            subset=self.moves_most(place),
        )
        return [row for row in rows if np.isfinite(row["frequency"])]

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each speed and mode."""
        units = {"frequency": "rad/s", "damping_ratio": "", "whirl": ""}
        rows = []
        for place, speed in enumerate(np.asarray(self.speeds).tolist()):
            for number, mode in enumerate(self.listed(place), 1):
                rows.append((speed, number, *map(mode.get, units)))
        units = {"speed": "rad/s", "mode": "", **units}
        columns = [*zip(*rows, strict=True)] or [()] * len(units)
        for (name, unit), column in zip(units.items(), columns, strict=True):
            yield Data(name, unit, np.array(column), self.table_dims)

    def nested(self) -> dict[str, Any]:
        """Modes at each speed, whether they are stable, and the Campbell diagram."""
        listed = []
        stable = []
        growth = []
        for place, modes in enumerate(self.modes):
            listed.append(self.listed(place))
            stable.append(bool(modes.stable))
            growth.append(modes.growth)
        entries = {
            **size_of(self.model, self.free),
            **fields_of(self, "speeds", "free", "damping"),
            "modes": listed,
            "stable": stable,
            "growth": growth,
        }
        if self.campbell is not None:
            entries["campbell"] = self.campbell
        return entries
