"""Rated points of a compressor in CSV files: readings with units, or a maker's polynomials.

Readings have one point a line and units in the heads; lines that begin with `#` hold metadata:

    # fluid = R22
    evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W]
    -5,30,18.3,0,14367,3382

Both temperatures are dew temperatures. The gas is told by `return_gas` or `superheat`, the liquid by
`liquid` or `subcooling`; `useful_superheat [K]` is how much superheat counts as capacity, all if absent.
Conditions that are the same at all points may stand in the metadata (`# return_gas = 18.3 degC`), and an
empty cell was not measured. `sd(power) [W]`, or in `[%]`, has the standard deviations.

Polynomials have a head `quantity,unit,C1,...` with 10, 20 or 30 coefficients and a line a quantity,
with temperatures in degrees Celsius and speeds in 1/s; the forms are those of `terms_of`.
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .._core.words import did_you_mean
from ..study import Identification, Readings, design_rules
from ..study.interface import MEASURED, CommonFactor, list_length, terms_of, varied
from ..study.rating import RATINGS, ZERO, Rating
from ._cells import cell_number, header_cell, lines_of, read_cells
from ._change import with_machine
from ._scene import Scene
from ._text import SceneError, reading
from ._units import factor, scale
from .map_formats import read_energyplus, read_tespy

# Temperatures, and differences of temperatures, which no zero point shifts.
_LEVELS = ("evaporating", "condensing", "return_gas", "liquid")
_DIFFERENCES = ("superheat", "subcooling", "useful_superheat")
_CONDITIONS = (*_LEVELS, *_DIFFERENCES, "speed")
_VALUE = re.compile(r"\s*([-+]?[\d.]+(?:e[-+]?\d+)?)\s*([^\s;,(]*)")
_RANGE = re.compile(r"\s*([-+]?[\d.]+)\s*to\s*([-+]?[\d.]+)\s*([^\s;,(]*)")
_SD = re.compile(r"\s*sd\((\w+)\)\s*\[(.*)\]\s*")
_ALIASES = {"ari": "ahri540", "ahri": "ahri540", "ari540": "ahri540", "en": "en12900"}
# Points of a polynomial by default, and how close condensing may come to evaporating [K].
_GRID, _CLOSEST = (5, 4), 15.0


def read_readings(
    path: str | os.PathLike,
    evaporating: Sequence[float] | None = None,
    condensing: Sequence[float] | None = None,
    speed: float | None = None,
) -> Readings:
    """The points of a file of readings, or of one of polynomials over a grid.

    Args:
        path: of the CSV file.
        evaporating, condensing: [K] grid of a polynomial; over the range in its metadata if absent.
        speed: [rad/s] at which to take a polynomial over the speed.

    Raises:
        SceneError: a file that cannot be read, an unknown head, a missing unit, one of another
            dimension, a condition that is missing or given twice, or a cell that is no number.
    """
    name = os.path.basename(os.fspath(path))
    path, _, machine = os.fspath(path).partition("#")
    over = (evaporating, condensing, speed)
    if path.lower().endswith(".idf"):
        with reading(path):
            return sampled(name, *read_energyplus(path, machine or None), *over)
    if path.lower().endswith(".json"):
        metadata, at = read_tespy(path)
        with reading(path):
            return sampled(name, metadata, at, *over)
    with reading(os.fspath(path)):
        metadata, lines = split_metadata(read_cells(path))
        if not lines:
            raise SceneError("", "has no line of heads")
        if lines[0][0].strip() == "quantity":
            return _polynomial(name, metadata, lines, evaporating, condensing, speed)
        return _table(name, metadata, lines)


def split_metadata(lines) -> tuple[dict[str, str], list[list[str]]]:
    """Metadata of the lines with `#`, and the other lines."""
    metadata, rest = {}, []
    for line in lines:
        if line[0].lstrip().startswith("#"):
            key, _, value = ",".join(line).lstrip("# ").partition("=")
            metadata[key.strip()] = value.strip()
        else:
            rest.append(line)
    return metadata, rest


def _table(name: str, metadata: Mapping[str, str], lines) -> Readings:
    scales: dict[str, tuple[float, float, bool]] = {}
    for cell in lines[0]:
        what, of_unit = _head(cell)
        if what in scales:
            raise SceneError(cell.strip(), "is there twice")
        scales[what] = of_unit
    rows = [
        [
            cell_number(text, f"line {n}.{what}", np.nan)
            for what, text in zip(scales, line, strict=True)
        ]
        for n, line in lines_of(lines[1:], len(scales))
    ]
    if not rows:
        raise SceneError("", "has no points")
    columns = {
        what: np.array(column) * size + zero
        for (what, (size, zero, _)), column in zip(
            scales.items(), zip(*rows, strict=True), strict=True
        )
    }
    values = {what: columns[what] for what in columns if what in MEASURED}
    if not values:
        raise SceneError("", f"measures nothing; known are {', '.join(MEASURED)}")
    deviations = {}
    for what, (_, _, relative) in scales.items():
        if what.startswith("sd "):
            measured = what[3:]
            if measured not in values:
                raise SceneError(f"sd({measured})", f"needs a column {measured}")
            share = np.abs(values[measured]) if relative else 1.0
            deviations[measured] = columns[what] * share
    conditions = {k: columns[k] for k in _CONDITIONS if k in columns}
    return _readings(name, metadata, conditions, len(rows), values, deviations)


def _head(cell: str) -> tuple[str, tuple[float, float, bool]]:
    """Name of a column; size of its unit, its zero, and whether it is relative."""
    if match := _SD.fullmatch(cell):
        what, unit = match[1], match[2].strip()
        if what not in MEASURED:
            near = did_you_mean(what, MEASURED)
            raise SceneError(cell.strip(), f"is of an unknown quantity{near}")
        if unit == "%":
            return f"sd {what}", (0.01, 0.0, True)
        si = MEASURED[what][0]
        return f"sd {what}", (*scale(unit, si, False, f"sd({what})", unit), False)
    known = header_cell(cell)
    what, unit = (known[0], known[1]) if known else (cell.strip(), "")
    if what not in (*_CONDITIONS, *MEASURED):
        near = did_you_mean(what, (*_CONDITIONS, *MEASURED))
        raise SceneError(cell.strip(), f"is an unknown column{near}")
    if not unit:
        raise SceneError(what, f'needs its unit in the head, as in "{what} [{_usual(what)}]"')
    return what, (*_scale(what, unit), False)


def _usual(what: str) -> str:
    if what in _LEVELS or what == "discharge_temperature":
        return "degC"
    return "K" if what in _DIFFERENCES else "rpm" if what == "speed" else MEASURED[what][0]


def _scale(what: str, unit: str) -> tuple[float, float]:
    """Size of a unit in SI, and its zero."""
    level = what in _LEVELS or what == "discharge_temperature"
    if level or what in _DIFFERENCES:
        return scale(unit, "K", level, what, unit)
    if what == "speed":
        turns = unit.lower() in ("hz", "1/s")
        return (2 * np.pi if turns else factor(unit, "rad/s", what, unit)), 0.0
    return factor(unit, MEASURED[what][0], what, unit), 0.0


def _readings(
    name, metadata, conditions: dict[str, Any], count: int, values, deviations, bends=None
) -> Readings:
    """Readings, with the conditions that the metadata has for all."""
    metadata = {**_rated(metadata), **metadata}
    conditions |= _conditions_of(metadata, conditions, count)
    for key in ("evaporating", "condensing"):
        if key not in conditions:
            raise SceneError(key, f'is a missing column; a head is "{key} [degC]"')
    for one, other in (("return_gas", "superheat"), ("liquid", "subcooling")):
        if one in conditions and other in conditions:
            raise SceneError(one, f"contradicts {other}: give one of the two")
        if one not in conditions and other not in conditions:
            problem = f"or {other} must be given: capacity and flow mean nothing without"
            raise SceneError(one, problem)
    S, D = conditions["evaporating"], conditions["condensing"]
    if np.isnan([S, D]).any():
        raise SceneError("evaporating", "and condensing must be given at every point")
    gas = conditions["return_gas"] if "return_gas" in conditions else S + conditions["superheat"]
    liquid = conditions["liquid"] if "liquid" in conditions else D - conditions["subcooling"]
    useful = S + conditions["useful_superheat"] if "useful_superheat" in conditions else gas
    speed = conditions.get("speed", np.full(count, np.nan))
    fluid = metadata.get("fluid", "")
    given = (S, D, gas, liquid, useful, speed, values, deviations)
    made = bends is not None
    return Readings(name, *given, polynomial=made, fluid=fluid, bends=bends or ())


def _conditions_of(
    metadata: Mapping[str, str], columns: Mapping[str, Any], count: int
) -> dict[str, np.ndarray]:
    """[SI] Conditions that the metadata has for all points; a range belongs to a polynomial."""
    found = {}
    for key in _CONDITIONS:
        match = _VALUE.match(metadata.get(key, ""))
        if not match or _RANGE.match(metadata[key]):
            continue
        if key in columns:
            raise SceneError(key, "is given in a column and in the metadata; one must go")
        if not match[2]:
            raise SceneError(key, f'needs its unit, as in "{key} = {match[1]} {_usual(key)}"')
        size, zero = _scale(key, match[2])
        found[key] = np.full(count, float(match[1]) * size + zero)
    return found


def _rated(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return gas and liquid of a rating that the metadata names."""
    if "rating" not in metadata:
        return {}
    name = metadata["rating"].strip().lower()
    name = _ALIASES.get(name, name)
    known = [one for one in RATINGS if one != "file"]
    if name not in known:
        near = did_you_mean(name, known)
        raise SceneError("rating", f"is unknown{near}; known are {', '.join(known)}", name)
    for key in ("return_gas", "superheat", "liquid", "subcooling"):
        if key in metadata:
            raise SceneError(key, f"is given beside rating = {name}, which has it; one must go")
    return metadata_of(RATINGS[name])


def metadata_of(rating: Rating) -> dict[str, str]:
    """Return gas and liquid as metadata."""
    out = {}
    for key, value in rating._asdict().items():
        if key in _CONDITIONS:
            level = key in _LEVELS
            if value is not None:
                shown = float(value) - ZERO * level
                out[key] = f"{shown:.10g} {'degC' if level else 'K'}"
    return out


def _polynomial(name, metadata, lines, evaporating, condensing, speed) -> Readings:
    count = len(lines[0]) - 2
    rows = {}
    for number, line in lines_of(lines[1:], count + 2):
        what, unit = line[0].strip(), line[1].strip()
        if what not in MEASURED:
            near = did_you_mean(what, MEASURED)
            raise SceneError(f"line {number}.quantity", f'"{what}" is unknown{near}')
        row = [cell_number(text, f"line {number}.{what}", np.nan) for text in line[2:]]
        if count not in (10, 20, 30) or np.isnan(row).any():
            raise SceneError(f"line {number}", "must have 10, 20 or 30 coefficients", count)
        size, zero = _scale(what, unit)
        rows[what] = np.array(row) * size
        rows[what][0] += zero  # the constant comes first in all forms
    return sampled(name, metadata, rows, evaporating, condensing, speed)


def sampled(
    name: str,
    metadata: Mapping[str, str],
    rows: Mapping[str, Any] | Callable[..., Mapping[str, Any]],
    evaporating: Sequence[float] | None = None,
    condensing: Sequence[float] | None = None,
    speed: float | None = None,
) -> Readings:
    """Points of polynomials.

    Args:
        name: of the source.
        metadata: of the file: fluid, rating, ranges.
        rows: [SI] coefficients by quantity, 10, 20 or 30 as `terms_of` orders them; or what
            gives the quantities of points [K].
        evaporating, condensing, speed: as in `read_readings`.

    Raises:
        SceneError: as `read_readings`.
    """
    count = 10 if callable(rows) else len(next(iter(rows.values())))
    S, D = _grid(metadata, evaporating, condensing)
    if count > 10 and speed is None:
        raise SceneError("speed", f"must be given for a polynomial of {count} coefficients")
    turns = 0.0 if speed is None else speed / (2 * np.pi)

    def at(S, D) -> Mapping[str, Any]:
        if callable(rows):
            return rows(S, D)
        return {what: terms_of(count, S, D, turns) @ row for what, row in rows.items()}

    step = 0.1  # K
    values, warmer, hotter = dict(at(S, D)), at(S + step, D), at(S, D + step)
    bends = []
    for what, value in values.items():
        if not (value > 0).all():
            raise SceneError(what, "is not positive over the points; take fewer", value.min())
        if what in ("capacity", "mass_flow"):
            bends += _bends(what, value, warmer[what], hotter[what], S, D)
    conditions = {"evaporating": S, "condensing": D}
    if speed is not None:
        conditions["speed"] = np.full(S.size, speed)
    return _readings(name, metadata, conditions, S.size, values, {}, tuple(bends))


def _grid(metadata: Mapping[str, str], evaporating, condensing) -> tuple[np.ndarray, np.ndarray]:
    """[K] Evaporating and condensing temperatures, of which pairs too close together are left out."""
    axes = []
    sides = (("evaporating", evaporating, _GRID[0]), ("condensing", condensing, _GRID[1]))
    for key, given, points in sides:
        if given is None:
            match = _RANGE.match(metadata.get(key, ""))
            if match is None:
                raise SceneError(key, "has no range in the metadata; give the temperatures to take")
            size, zero = _scale(key, match[3] or "degC")
            ends = (float(match[1]) * size + zero, float(match[2]) * size + zero)
            given = np.linspace(*ends, points)
        axes.append(np.asarray(given, float))
    S, D = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    apart = D - S > _CLOSEST
    return S[apart], D[apart]


def _bends(what: str, value, warmer, hotter, S, D) -> Iterator[str]:
    """Where a polynomial of capacity or flow falls or rises against physics, in words."""
    for wrong, text in (
        (warmer - value <= 0, "falls with the evaporating temperature"),
        (hotter - value > 1e-4 * value, "rises with the condensing temperature"),
    ):
        if wrong.any():
            places = ", ".join(
                f"{s - ZERO:.4g}/{d - ZERO:.4g} C" for s, d in zip(S[wrong], D[wrong], strict=True)
            )
            yield f"the polynomial of {what} {text} at {places}: it bends the wrong way"


def identified_scene(scene: Scene, found: Identification) -> Scene:
    """The scene with the identified values; each says where it comes from and how sure it is.

    Args:
        scene: that was identified.
        found: the result.
    """
    for n, name in enumerate(found.parameters[: found.constants]):
        value, error = float(found.estimate[n]), float(found.standard_error[n])
        one = varied(scene.machine, name)
        # a rule or a common factor stands behind several numbers, which say so
        several = (
            isinstance(one, CommonFactor)
            or name in design_rules
            or list_length(scene.machine, name) > 0
        )
        label = f"{name} " if several else ""
        source = f"identified from {found.source}, {label}{value:.5g} +- {error:.2g}"
        source = f"{source} {found.units[n]}".strip() + " (standard error)"
        if float(found.prior_share[n]) > 0.9:
            source = f"prior, of which {found.source} says nothing"
        scene = with_machine(scene, one.apply(scene.machine, found.estimate[n]), source)
    return scene
