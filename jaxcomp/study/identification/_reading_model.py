"""What a machine says of all readings of several measurements, and its slopes over the constants."""

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._core.exported import kept_optimised_jit
from .._variables import changed
from ._measurement import Entries


@kept_optimised_jit
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
        self.variables = tuple(variable.without_range for variable in variables)
        self.design = design
        self.measurements = measurements
        self.programs = [measurement.without_data for measurement in measurements]
        parts = [measurement.entries(sd) for measurement in measurements]
        self.points = []
        sizes = []
        for measurement in measurements:
            points = measurement.points(design)
            self.points.append(points)
            sizes.append(len(jax.tree.leaves(points)[0]))
        # number of the first point of each measurement, and of all points
        self.first = np.concatenate([[0], np.cumsum(sizes)])
        self.nuisances = []
        # columns of the slopes over the constants of each measurement itself
        self.nuisance_columns = []
        for measurement in measurements:
            begin = len(variables) + len(self.nuisances)
            for parameter in measurement.nuisances:
                name = f"{measurement.source}: {parameter.name}"
                self.nuisances.append(parameter._replace(name=name))
            self.nuisance_columns.append(slice(begin, begin + len(measurement.nuisances)))
        self.block = np.repeat(np.arange(len(parts)), [part.measured.size for part in parts])
        self.entries = _joined(parts, self.first[:-1])

    @property
    def source(self) -> str:
        """Names of all files."""
        return ", ".join(dict.fromkeys(measurement.source for measurement in self.measurements))

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.first[-1])

    def warnings(self, used: Sequence[int]) -> list[str]:
        """Warnings about points held out."""
        used_points = []
        for n in range(len(self.measurements)):
            begin, end = self.first[n : n + 2]
            used_of_measurement = []
            for point in used:
                if begin <= point < end:
                    used_of_measurement.append(int(point - begin))
            used_points.append(used_of_measurement)
        pairs = list(zip(self.measurements, used_points, strict=True))
        warnings = {}
        for n, (measurement, points) in enumerate(pairs):
            remaining = pairs[:n] + pairs[n + 1 :]
            same_kind = [pair for pair in remaining if type(pair[0]) is type(measurement)]
            warnings |= dict.fromkeys(measurement.warnings(points, same_kind))
        return list(warnings)

    def __call__(self, p: NDArray, points: Sequence[int]) -> tuple[NDArray, NDArray]:
        """(m,) and (m, p); not a number at points that fail or are not wanted."""
        entries = self.entries
        value = np.full(entries.measured.size, np.nan)
        slope = np.full((value.size, len(self.variables) + len(self.nuisances)), np.nan)
        for number, (n, values, slopes, ok) in self._solved(p, points):
            if not ok:
                continue
            rows = (entries.point == number) & (self.block == n)
            columns = entries.column[rows]
            value[rows] = values[columns]
            # Constants of other measurements do not move these readings.
            slope[rows] = 0.0
            slope[rows, : len(self.variables)] = slopes[columns, : len(self.variables)]
            slope[rows, self.nuisance_columns[n]] = slopes[columns, len(self.variables) :]
        return value, slope

    def _solved(self, p: NDArray, points: Sequence[int]) -> Iterator[tuple[int, tuple]]:
        """Points by number, each with that of its measurement, values, slopes, and whether they hold."""
        shared = jnp.asarray(p[: len(self.variables)])

        def at(number: int):
            n = self._measurement(number)
            point = jax.tree.map(lambda a: jnp.asarray(a[number - self.first[n]]), self.points[n])
            nuisances = jnp.asarray(p[self.nuisance_columns[n]])
            solution = _solve(
                self.programs[n], self.design, self.variables, shared, nuisances, point
            )
            return n, *map(np.asarray, solution)

        # the first of each measurement compiles it, not every thread
        compiled = set()
        fresh = []
        later = []
        for number in points:
            measurement = self._measurement(number)
            if measurement in compiled:
                later.append(number)
            else:
                compiled.add(measurement)
                fresh.append(number)
        yield from zip(fresh, map(at, fresh), strict=True)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            yield from zip(later, pool.map(at, later), strict=True)

    def _measurement(self, number: int) -> int:
        """Number of the measurement of a point, which counts over all measurements."""
        return int(np.searchsorted(self.first, number, side="right")) - 1


def _joined(parts: Sequence[Entries], first: NDArray) -> Entries:
    """The readings of several measurements, whose points count from a first number each."""
    quantity = []
    names = []
    kinds = {}
    units = {}
    names_of_conditions = {}
    for part in parts:
        quantity += part.quantity
        names += part.names
        kinds |= part.kinds
        units |= part.units
        names_of_conditions |= dict.fromkeys(part.conditions)
    conditions = {}
    for name in names_of_conditions:
        columns = []
        for part in parts:
            absent = np.full(part.measured.size, np.nan)
            columns.append(part.conditions.get(name, absent))
        conditions[name] = np.concatenate(columns)
    points = []
    for part, begin in zip(parts, first, strict=True):
        points.append(part.point + begin)
    return Entries(
        quantity=tuple(quantity),
        kinds=kinds,
        point=np.concatenate(points),
        column=np.concatenate([part.column for part in parts]),
        measured=np.concatenate([part.measured for part in parts]),
        sd=np.concatenate([part.sd for part in parts]),
        names=tuple(names),
        conditions=conditions,
        units=units,
    )
