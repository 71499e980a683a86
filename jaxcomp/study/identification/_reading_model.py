"""What a machine says of all readings of several measurements, and its slopes over the constants."""

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._core.exported import kept_jit
from .._variables import changed
from ._measurement import Entries


@kept_jit
def _solve(measurement, design, variables, parameters, nuisances, point):
    """Values, slopes and status at one point; `measurement` and `variables` are static."""

    def build(p):
        return changed(design, variables, p)

    return measurement.values(build, parameters, nuisances, point)


class ReadingModel:
    """All readings of several measurements as one model of the constants.

    Args:
        design: the machine.
        variables: its numbers that are constants of the model.
        measurements: of one kind or several; their points are counted one after the other.
        sd: standard deviations by quantity instead of the usual ones.
    """

    def __init__(self, design, variables, measurements, sd: Mapping[str, float]):
        # without their ranges, which are no part of the program
        self.variables = tuple(one.bare for one in variables)
        self.design = design
        self.measurements = measurements
        self.programs = [one.bare for one in measurements]
        parts = [one.entries(sd) for one in measurements]
        self.points = [one.points(design) for one in measurements]
        sizes = [len(jax.tree.leaves(one)[0]) for one in self.points]
        self.first = np.concatenate([[0], np.cumsum(sizes)])
        self.nuisances = []
        self.own = []
        for one in measurements:
            begin = len(variables) + len(self.nuisances)
            self.nuisances += [
                each._replace(name=f"{one.source}: {each.name}") for each in one.nuisances
            ]
            self.own.append(slice(begin, begin + len(one.nuisances)))
        self.block = np.repeat(np.arange(len(parts)), [part.measured.size for part in parts])
        names = list(dict.fromkeys(name for part in parts for name in part.conditions))

        def condition(part: Entries, name: str):
            return part.conditions.get(name, np.full(part.measured.size, np.nan))

        def whole(field: str):
            return np.concatenate([getattr(part, field) for part in parts])

        self.entries = Entries(
            tuple(name for part in parts for name in part.quantity),
            {k: v for part in parts for k, v in part.kinds.items()},
            np.concatenate([p.point + n for p, n in zip(parts, self.first[:-1], strict=True)]),
            *map(whole, ("column", "measured", "sd")),
            tuple(name for part in parts for name in part.names),
            {name: np.concatenate([condition(part, name) for part in parts]) for name in names},
            {k: v for part in parts for k, v in part.units.items()},
        )

    @property
    def source(self) -> str:
        """Names of all files."""
        return ", ".join(dict.fromkeys(one.source for one in self.measurements))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.first[-1])

    def warnings(self, used: Sequence[int]) -> list[str]:
        """Warnings about points held out."""
        seen = []
        for n, one in enumerate(self.measurements):
            begin, end = self.first[n : n + 2]
            seen.append((one, [int(p - begin) for p in used if begin <= p < end]))
        out = []
        for n, (one, own) in enumerate(seen):
            beside = [pair for k, pair in enumerate(seen) if k != n and type(pair[0]) is type(one)]
            out += one.warnings(own, beside)
        return list(dict.fromkeys(out))

    def __call__(self, p: NDArray, wanted: Sequence[int]) -> tuple[NDArray, NDArray]:
        """(m,) and (m, p); not a number at points that fail or are not wanted."""
        entries = self.entries
        value = np.full(entries.measured.size, np.nan)
        slope = np.full((value.size, len(self.variables) + len(self.nuisances)), np.nan)
        for number, (n, values, slopes, ok) in self._solved(p, wanted):
            if not ok:
                continue
            mine = (entries.point == number) & (self.block == n)
            columns = entries.column[mine]
            value[mine] = values[columns]
            slope[mine] = 0.0
            slope[mine, : len(self.variables)] = slopes[columns, : len(self.variables)]
            slope[mine, self.own[n]] = slopes[columns, len(self.variables) :]
        return value, slope

    def _solved(self, p: NDArray, wanted: Sequence[int]) -> Iterator[tuple[int, tuple]]:
        """Points by number, each with that of its measurement, values, slopes, and whether they hold."""
        shared = jnp.asarray(p[: len(self.variables)])

        def at(number: int):
            n = self._measurement(number)
            point = jax.tree.map(lambda a: jnp.asarray(a[number - self.first[n]]), self.points[n])
            own = jnp.asarray(p[self.own[n]])
            found = _solve(self.programs[n], self.design, self.variables, shared, own, point)
            return n, *map(np.asarray, found)

        # the first of each measurement compiles it, not every thread
        first = {self._measurement(number): number for number in reversed(wanted)}
        fresh = [number for number in wanted if number in first.values()]
        later = [number for number in wanted if number not in first.values()]
        yield from zip(fresh, map(at, fresh), strict=True)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            yield from zip(later, pool.map(at, later), strict=True)

    def _measurement(self, number: int) -> int:
        """Number of the measurement of a point, which counts over all measurements."""
        return int(np.searchsorted(self.first, number, side="right")) - 1
