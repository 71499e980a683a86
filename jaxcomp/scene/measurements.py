"""Field balancing: influence coefficients from a table of measured vibration, without any model.

The table is CSV with a header. One line is one reading:

    run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg]
    initial,bearing-1,3000,7.2,238,,
    plane-1,bearing-1,3000,4.9,114,120,0

A trial is mass times radius; with a mass alone (`trial [g]`) the corrections are masses as well, at the
radius where the trial weights were.

`run` is `initial`, or the name of the plane that gets a trial weight. The weight is taken off again
before the next run, unless a column `kept` says `yes` in the lines of its run: then it stays on in all
runs below. The corrections count from the initial run, without any trial weight. The vibration may
have any unit as long as it is one; its name is kept for the tables. `phase` and `angle` count in the
same sense, both with the rotation or both against it; so do the angles of the corrections. A run
`run-out` at low speed, which reads every target once, is taken off all other readings, and a column
`weight` says in the lines of the initial run how much a reading counts. A speed may be in Hz. Semicolons
may stand between the cells, with decimal commas in them.

A column `plane` names the plane of a run, of which a plane may then have several. Without `phase` they
have to be at least two in each plane, at different angles, and all are in one plane if there is no
column `plane`:

    run,target,speed [rpm],amplitude [mil],trial [g],angle [deg]
    initial,bearing,1800,10,,
    first,bearing,1800,7,50,0
    second,bearing,1800,12,50,120
"""

import dataclasses
import os
from collections import Counter
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .._core.display import RPM
from .._core.errors import BadInput
from .._core.words import nearest
from ..balancing import amplitude_influence, trial_influence
from ..balancing._influence import Influence, InfluenceRow, Trials, fitted_influence
from ._settings import known_name, settings_of
from ._table_text import Head, TableText, cell_number, read_table_text
from ._text import SceneError, reading
from ._units import factor

_COLUMNS = ("run", "target", "speed", "amplitude", "phase", "trial", "angle")
_OPTIONAL = ("plane", "kept", "weight")
_UNITS = {"speed": ("rad/s",), "phase": ("rad",), "trial": ("kg m", "kg"), "angle": ("rad",)}
_EXAMPLE = "run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg]"
_INITIAL = "initial"
# A run at low speed, whose readings are of the surface and not of vibration.
_RUN_OUT = "run-out"
# The plane of runs without phase in a table that names none.
_ONE_PLANE = "plane"
_FEW = 8  # runs that a message lists
_KEPT = {"yes": True, "no": False, "": False}
# Bounds of what can be measured in any unit; beyond them squares and quotients leave the numbers.
_SMALLEST = 1e-30
_LARGEST = 1e30


def read_measurements(path: str | os.PathLike) -> Influence:
    """Influence coefficients from a CSV file of an initial run and one run per plane.

    Raises:
        SceneError: a file that cannot be read, a missing or unknown column, a value of another
            dimension, a reading that is missing or given twice. It names file, line and column.
    """
    with reading(os.fspath(path)):
        return _measured(read_table_text(path))


def _measured(text: TableText) -> Influence:
    if not text.heads:
        raise SceneError("", f'is empty; a header is "{_EXAMPLE}"')
    settings_of(text.settings)
    table = _Table(text.heads, _has_phases(text))
    for number, line in text.rows:
        cell = table.cells(number, line)
        table.take_reading(number, cell)
        if cell["run"] not in (_INITIAL, _RUN_OUT):
            table.take_trial(number, cell)
    table.check_runs()
    return table.influence()


class _Table:
    """Readings of the lines of a table, by run, target and speed."""

    def __init__(self, heads: Sequence[Head], with_phase: bool):
        self.with_phase = with_phase
        self.units = _header(heads, with_phase)
        if self.units["speed"].lower() in ("hz", "1/s", "s^-1"):  # revolutions a second
            self.units["speed"] = "turn/s"
        self.dimensions: dict[str, str] = {}
        self.scale: dict[str, float] = {}
        for name in _UNITS:
            if name in self.units:
                unit = self.units[name]
                si = _dimension(name, unit)
                self.dimensions[name] = si
                self.scale[name] = factor(unit, si, name, unit)
        self.readings: dict[str, dict[tuple[str, float], complex]] = {}
        self.trials: dict[str, complex] = {}
        self.plane_of: dict[str, str] = {}
        self.kept: dict[str, bool] = {}
        self.weights: dict[tuple[str, float], float] = {}

    def cells(self, number: int, line) -> dict[str, str]:
        """The cells of a line by column."""
        cell = {}
        for column, text in zip(self.units, line, strict=True):
            cell[column] = text.strip()
        for column, text in cell.items():
            if not text.isprintable():
                raise SceneError(f"line {number}.{column}", "must be printable", text)
        for column in ("run", "target"):
            if not cell[column]:
                problem = f"is empty; write the name of the {column} on every line"
                raise SceneError(f"line {number}.{column}", problem)
        cell["run"] = known_name(cell["run"], (_INITIAL, _RUN_OUT)) or cell["run"]
        return cell

    def take_reading(self, number: int, cell: dict[str, str]) -> None:
        """The vibration that a line reads, and of the initial run its weight."""
        run = cell["run"]
        target = cell["target"]
        # speeds of several runs are the same number only once the rounding of units is gone
        key = (target, round(_number(cell, "speed", self.scale, number), 6))
        run_readings = self.readings.setdefault(run, {})
        if key in run_readings:
            raise SceneError(f"line {number}", f"reads {target} a second time in run {run}")
        amplitude = _number(cell, "amplitude", self.scale, number)
        if amplitude < 0:
            problem = "must be >= 0; what is opposite has a phase that differs by 180 deg"
            raise SceneError(f"line {number}.amplitude", problem, amplitude)
        phase = 0.0
        if self.with_phase:
            phase = _number(cell, "phase", self.scale, number)
        run_readings[key] = amplitude * np.exp(1j * phase)
        if run == _INITIAL and cell.get("weight"):
            self.weights[key] = _number(cell, "weight", self.scale, number)
            if self.weights[key] < 0:
                raise SceneError(f"line {number}.weight", "must be >= 0", self.weights[key])

    def take_trial(self, number: int, cell: dict[str, str]) -> None:
        """The trial weight of a line's run, which all lines of the run repeat."""
        run = cell["run"]
        if not cell["trial"]:
            problem = (
                f'is empty: only the run "{_INITIAL}", as the machine is, and "{_RUN_OUT}" have no '
                f'trial weight; write "{_INITIAL}" for "{run}" if it is that one'
            )
            raise SceneError(f"line {number}.trial", problem)
        size = _number(cell, "trial", self.scale, number)
        angle = _number(cell, "angle", self.scale, number)
        trial = size * np.exp(1j * angle)
        if trial == 0:
            raise SceneError(f"line {number}.trial", "must be different from zero", 0)
        if self.trials.setdefault(run, trial) != trial:
            raise SceneError(f"line {number}", f"has another trial weight than run {run} before")
        self._take_plane(number, cell)
        word = cell.get("kept", "").lower()
        if word not in _KEPT:
            raise SceneError(f"line {number}.kept", 'must be "yes" or "no"', cell["kept"])
        if self.kept.setdefault(run, _KEPT[word]) != _KEPT[word]:
            raise SceneError(f"line {number}.kept", f"differs from the lines of run {run} before")

    def _take_plane(self, number: int, cell: dict[str, str]) -> None:
        """The plane of a line's run: its own column, the run's name, or the only one."""
        run = cell["run"]
        usual_plane = run if self.with_phase else _ONE_PLANE
        plane = cell.get("plane", usual_plane)
        if not plane:
            problem = "is empty; write the plane of the trial weight in every line of a run"
            raise SceneError(f"line {number}.plane", problem)
        if self.plane_of.setdefault(run, plane) != plane:
            raise SceneError(f"line {number}.plane", f"differs from the lines of run {run} before")

    def check_runs(self) -> None:
        """Take off the run-out; every run must read what the initial one does."""
        if _INITIAL not in self.readings:
            raise SceneError("run", self._without_initial())
        if not self.trials:
            raise SceneError("run", "has no run with a trial weight")
        if not self.with_phase and _RUN_OUT in self.readings:
            problem = f'"{_RUN_OUT}" needs a column phase: without it nothing can be taken off'
            raise SceneError("run", problem)
        keys = self.readings[_INITIAL].keys()
        targets = {target for target, _ in keys}
        _take_off(self.readings, targets)
        for run in self.trials:
            for target, speed in keys ^ self.readings[run].keys():
                at = f"{target} at {speed * RPM:.6g} rpm"
                raise SceneError("run", f'"{run}" and "{_INITIAL}" must both read {at}')

    def _without_initial(self) -> str:
        """Entries that a table without the first run lacks, in words."""
        runs = ", ".join(list(self.readings)[:_FEW])
        near = nearest(_INITIAL, self.readings)
        meant = ""
        if near:
            meant = f'; write "{_INITIAL}" for "{near}"'
        return (
            f'has no line "{_INITIAL}", which is the reading as the machine is, without any trial '
            f"weight; the runs of the table are {runs or 'none'}{meant}"
        )

    def influence(self) -> Influence:
        """The influence coefficients of the planes."""
        unit = self.units["amplitude"] or "as measured"
        trials = Trials(
            jnp.asarray(list(self.trials.values())),
            tuple(self.trials),
            tuple(self.plane_of.values()),
        )
        system = self._system()
        trial_unit = self.dimensions["trial"]
        alternatives = []
        for other in system.alternatives:
            alternatives.append(dataclasses.replace(other, unit=unit, trial=trial_unit))
        return dataclasses.replace(
            system,
            unit=unit,
            trial=trial_unit,
            trials=trials,
            alternatives=tuple(alternatives),
        )

    def _system(self) -> Influence:
        keys = list(self.readings[_INITIAL])
        initial = self._in_order(_INITIAL, keys)
        readings = np.array([self._in_order(run, keys) for run in self.trials])
        rows = _influence_rows(keys)
        row_weights = self._row_weights(keys)
        planes = list(dict.fromkeys(self.plane_of.values()))
        if self.with_phase and "plane" not in self.units:
            trials = np.array(list(self.trials.values()))
            staying = list(self.kept.values())
            return trial_influence(initial, readings, trials, rows, planes, row_weights, staying)
        weights = self._weights_on(planes)
        if not self.with_phase:
            return self._without_phase(keys, initial, readings, weights, planes)
        try:
            return fitted_influence(initial, readings, weights, rows, planes, row_weights)
        except BadInput:
            problem = f"must act in each plane in a way of its own; {self._runs_by_plane()}"
            raise SceneError("trial", problem) from None

    def _row_weights(self, keys: Sequence[tuple[str, float]]) -> np.ndarray:
        """Weight of every reading of the initial run; 1 where the table has none."""
        weights = [self.weights.get(key, 1.0) for key in keys]
        return np.array(weights)

    def _in_order(self, run: str, keys: Sequence[tuple[str, float]]) -> np.ndarray:
        """Readings of a run in the order of the initial one, which its lines need not have."""
        readings = self.readings[run]
        return np.array([readings[key] for key in keys])

    def _without_phase(self, keys, initial, readings, weights, planes) -> Influence:
        """The system of amplitudes alone."""
        for (target, speed), amplitude in zip(keys, initial, strict=True):
            if amplitude == 0:
                at = f"{target} at {speed * RPM:.6g} rpm"
                problem = f"must be above 0 in the run {_INITIAL}, which reads 0 at {at}"
                raise SceneError("amplitude", problem)
        try:
            return amplitude_influence(
                np.abs(np.vstack([initial, readings])),
                np.vstack([np.zeros(len(planes)), weights]),
                _influence_rows(keys),
                planes,
                self._row_weights(keys),
            )
        except BadInput:
            problem = (
                "must stand at two angles at least in each plane, and better at three, where nothing "
                f"has a phase; {self._runs_by_plane()}"
            )
            raise SceneError("trial", problem) from None

    def _runs_by_plane(self) -> str:
        """Numbers of runs with a trial weight of each plane, in words."""
        counts = []
        for plane, count in Counter(self.plane_of.values()).items():
            counts.append(f"{count} in {plane}")
        return f"runs with a trial weight are {', '.join(counts)}"

    def _weights_on(self, planes: Sequence[str]) -> np.ndarray:
        """[kg m] (runs, planes) All trial weights that are on in each run with one."""
        staying = np.zeros(len(planes), complex)
        rows = []
        for run, trial in self.trials.items():
            on = staying.copy()
            on[planes.index(self.plane_of[run])] += trial
            rows.append(on)
            if self.kept[run]:
                staying = on
        return np.array(rows)


def _influence_rows(keys: Sequence[tuple[str, float]]) -> list[InfluenceRow]:
    return [InfluenceRow(target, "measured", speed) for target, speed in keys]


def _take_off(readings, targets) -> None:
    """Subtract the readings of the run-out, which are the same at every speed."""
    surface = readings.pop(_RUN_OUT, None)
    if surface is None:
        return
    by_target = {}
    for (target, _), reading_value in surface.items():
        by_target[target] = reading_value
    if len(by_target) < len(surface):
        raise SceneError("run", f'"{_RUN_OUT}" must read every target once, at one low speed')
    for target in targets - set(by_target):
        raise SceneError("run", f'"{_RUN_OUT}" must read {target}')
    for run_readings in readings.values():
        for key in run_readings:
            run_readings[key] -= by_target.get(key[0], 0.0)


def _has_phases(text: TableText) -> bool:
    """Whether a table has phases: a column of them, with a cell that is not empty."""
    names = [known_name(head.name, _COLUMNS) for head in text.heads]
    if "phase" not in names:
        return False
    place = names.index("phase")
    return not text.rows or any(row.cells[place].strip() for row in text.rows)


def _header(heads: Sequence[Head], with_phase: bool) -> dict[str, str]:
    """Units of the columns by their names."""
    units = {}
    for head in heads:
        name = known_name(head.name, (*_COLUMNS, *_OPTIONAL))
        if name is None:
            problem = f'is an unknown column; known are those of "{_EXAMPLE}"'
            raise SceneError(head.name, problem)
        if name in units:
            raise SceneError(name, "is there twice")
        units[name] = head.unit
    for name in _COLUMNS:
        if name == "phase" and not with_phase:
            continue
        if name not in units:
            raise SceneError(name, f'is a missing column; a header is "{_EXAMPLE}"')
        if name in _UNITS and not units[name]:
            raise SceneError(name, f'needs its unit in the header, as in "{_EXAMPLE}"')
    return units


def _dimension(column: str, unit: str) -> str:
    """The SI unit of a column, of those allowed the one that its own fits; the first if none does."""
    for allowed in _UNITS[column]:
        try:
            factor(unit, allowed)
        except SceneError:
            continue
        return allowed
    return _UNITS[column][0]


def _number(cell, column, scale, line) -> float:
    key = f"line {line}.{column}"
    value = cell_number(cell[column], key)
    if value and not _SMALLEST <= abs(value) <= _LARGEST:
        bounds = f"{_SMALLEST:g} to {_LARGEST:g}"
        raise SceneError(key, f"must be 0, or in size {bounds}", value)
    return value * scale.get(column, 1.0)
