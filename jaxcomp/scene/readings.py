"""Rated points of a compressor in CSV files: readings with units, or a maker's polynomials.

Readings have one point a line and units in the heads; lines that begin with `#` hold metadata:

    # fluid = R22
    evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W]
    -5,30,18.3,0,14367,3382

Both temperatures are dew temperatures, or with `# reference = mean` those in the middle of the glide of
evaporator and condenser. The gas is told by `return_gas` or `superheat`, the liquid by
`liquid` or by `subcooling`, which counts from its bubble temperature; `useful_superheat [K]` is how much
superheat counts as capacity, all if absent. Conditions that are the same at all points may stand in the
metadata (`# return_gas = 18.3 degC`), and an empty cell was not measured. `sd(power) [W]`, or in `[%]`,
has the standard deviations.

Polynomials have a head `quantity,unit,C1,...` with 10, 20 or 30 coefficients and a line a quantity,
with temperatures in degrees Celsius and speeds in 1/s; the forms are those of `terms_of`.
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .._core.words import did_you_mean
from ..fluid import AbstractRealGas
from ..study import Identification, Readings, design_rules
from ..study._variables import list_length
from ..study.identification._common_factor import CommonFactor, varied
from ..study.identification._readings import MEASURED, terms_of
from ..study.rating import RATINGS, ZERO, Rating
from ._change import with_machine
from ._columns import Columns
from ._scene import Scene, scene_of
from ._settings import (
    bare_name,
    known_name,
    measure_setting,
    settings_of,
    span_setting,
    word_setting,
)
from ._table_text import Head, TableText, cell_number, read_table_text
from ._text import SceneError, reading
from ._units import scale
from .map_formats import read_energyplus, read_tespy

# Temperatures, and differences of temperatures, which no zero point shifts.
_LEVELS = ("evaporating", "condensing", "return_gas", "liquid")
_DIFFERENCES = ("superheat", "subcooling", "useful_superheat")
CONDITIONS = (*_LEVELS, *_DIFFERENCES, "speed")
# Settings of files of points and polynomials, beside those of any file.
MAP_SETTINGS = (*CONDITIONS, "rating", "reference")
# SI units of their columns, and those of examples in messages.
_UNITS = dict.fromkeys((*_LEVELS, *_DIFFERENCES), "K") | {"speed": "rad/s"}
_UNITS |= {name: unit for name, (unit, *_) in MEASURED.items()}
_EXAMPLES = _UNITS | dict.fromkeys((*_LEVELS, "discharge_temperature"), "degC") | {"speed": "rpm"}
# Settings as they usually are, for messages.
_USUAL = dict.fromkeys(_LEVELS, "18.3 degC") | {"speed": "1450 rpm"}
# A whole head of a map, for messages.
MAP_HEAD = (
    "evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W]"
)
_ALIASES = {"ari": "ahri540", "ahri": "ahri540", "ari540": "ahri540", "en": "en12900"}
# Points of a polynomial by default, and how close condensing may come to evaporating [K].
_GRID = (5, 4)
_CLOSEST = 15.0
# Conditions of which a polynomial has a range.
_RANGES = ("evaporating", "condensing")
# [K] Beyond them nothing evaporates or condenses in a machine.
_COLDEST = 100.0
_HOTTEST = 700.0


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
        return map_readings(name, read_table_text(path), evaporating, condensing, speed)


def map_readings(
    name: str,
    table: TableText,
    evaporating: Sequence[float] | None = None,
    condensing: Sequence[float] | None = None,
    speed: float | None = None,
) -> Readings:
    """The points of a table of readings, or of one of polynomials; see `read_readings`."""
    if not table.heads:
        raise SceneError("", f'has no line of heads; a map has "{MAP_HEAD}"')
    metadata = settings_of(table.settings, MAP_SETTINGS)
    if bare_name(table.heads[0].name) == "quantity":
        return _polynomial(name, metadata, table, evaporating, condensing, speed)
    return _points(name, metadata, table)


def _points(name: str, metadata: Mapping[str, str], table: TableText) -> Readings:
    allowed = (*CONDITIONS, *MEASURED)
    columns = Columns(table, allowed, (), _EXAMPLES, deviations=True, temperatures=_LEVELS)
    if not len(columns):
        raise SceneError("", "has no points: write a line of numbers below the heads for each")
    numbers = {}
    for quantity, si in _UNITS.items():
        if quantity in columns:
            numbers[quantity] = columns.values(quantity, si)
    values = {}
    for quantity in columns.names:
        if quantity in MEASURED:
            values[quantity] = numbers[quantity]
    if not values:
        raise SceneError("", f"measures nothing; known are {', '.join(MEASURED)}")
    deviations = _deviations(columns, values)
    conditions = {}
    for quantity in CONDITIONS:
        if quantity in columns:
            conditions[quantity] = numbers[quantity]
    return _readings(name, metadata, conditions, len(columns), values, deviations)


def _deviations(columns: Columns, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """[SI] Standard deviations of the measured quantities that have a column of them.

    Raises:
        SceneError: deviations of a quantity that has no column.
    """
    deviations = {}
    for quantity in MEASURED:
        if f"sd({quantity})" in columns and quantity not in values:
            raise SceneError(f"sd({quantity})", f"needs a column {quantity}")
        if quantity in values:
            deviation = columns.deviations(quantity, MEASURED[quantity][0], values[quantity])
            if deviation is not None:
                deviations[quantity] = deviation
    return deviations


def _scale(quantity: str, unit: str) -> tuple[float, float]:
    """Size of a unit in SI, and its zero."""
    if quantity == "speed" and unit.lower() in ("hz", "1/s"):
        return 2 * np.pi, 0.0
    level = quantity in _LEVELS or quantity == "discharge_temperature"
    return scale(unit, _UNITS[quantity], level, quantity, unit)


def _readings(
    name, metadata, conditions: dict[str, Any], count: int, values, deviations, bends=None
) -> Readings:
    """Readings, with the conditions that the metadata has for all."""
    metadata = {**_rated(metadata), **metadata}
    conditions |= _conditions_of(metadata, conditions, count)
    for key in ("evaporating", "condensing"):
        if key not in conditions:
            raise SceneError(key, f'is a missing column; a head is "{key} [degC]"')
    for level, difference in (("return_gas", "superheat"), ("liquid", "subcooling")):
        if level in conditions and difference in conditions:
            raise SceneError(level, f"contradicts {difference}: give one of the two")
        if level not in conditions and difference not in conditions:
            line = f"# {level} = {_USUAL[level]}"
            problem = f'or {difference} must be given, in a column or above the table as "{line}"'
            raise SceneError(level, f"{problem}: capacity and flow mean nothing without")
    for key, column in conditions.items():
        if key != "speed" and np.isnan(column).any():
            raise SceneError(key, "must be given at every point, and has an empty cell")
    S = conditions["evaporating"]
    D = conditions["condensing"]
    superheat = conditions.get("superheat")
    gas = conditions["return_gas"] if superheat is None else S + superheat
    subcooling = conditions.get("subcooling")
    # of a fluid without glide; only the machine's fluid tells the glide of another
    liquid = conditions["liquid"] if subcooling is None else D - subcooling
    useful = gas
    if "useful_superheat" in conditions:
        useful = S + conditions["useful_superheat"]
    speed = conditions.get("speed", np.full(count, np.nan))
    fluid = word_setting(metadata, "fluid")
    reference = word_setting(metadata, "reference").lower() or "dew"
    if reference not in ("dew", "mean"):
        raise SceneError("reference", 'must be "dew" or "mean"', reference)
    return Readings(
        source=name,
        evaporating=S,
        condensing=D,
        gas=gas,
        liquid=liquid,
        useful=useful,
        speed=speed,
        measured=values,
        sd=deviations,
        polynomial=bends is not None,
        fluid=fluid,
        bends=bends or (),
        by_subcooling=subcooling is not None,
        by_superheat=superheat is not None,
        by_useful_superheat="useful_superheat" in conditions or superheat is not None,
        reference=reference,
    )


def _conditions_of(
    metadata: Mapping[str, str], columns: Mapping[str, Any], count: int
) -> dict[str, np.ndarray]:
    """[SI] Conditions that the metadata has for all points; a range belongs to a polynomial."""
    conditions = {}
    for key in CONDITIONS:
        if key not in metadata:
            continue
        if span_setting(metadata, key) is not None:
            if key not in _RANGES:
                raise SceneError(key, "must be one value, and no range", metadata[key])
            continue  # of a polynomial
        number, unit = measure_setting(metadata, key, _USUAL.get(key, "5 K"))
        if key in columns:
            raise SceneError(key, "is given in a column and in the metadata; one must go")
        size, zero = _scale(key, unit)
        conditions[key] = np.full(count, number * size + zero)
    return conditions


def _rated(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return gas and liquid of a rating that the metadata names."""
    if "rating" not in metadata:
        return {}
    name = word_setting(metadata, "rating").lower()
    name = _ALIASES.get(name, name)
    ratings = [rating for rating in RATINGS if rating != "file"]
    if name not in ratings:
        near = did_you_mean(name, ratings)
        raise SceneError("rating", f"is unknown{near}; known are {', '.join(ratings)}", name)
    for key in ("return_gas", "superheat", "liquid", "subcooling"):
        if key in metadata:
            raise SceneError(key, f"is given beside rating = {name}, which has it; one must go")
    return metadata_of(RATINGS[name])


def metadata_of(rating: Rating) -> dict[str, str]:
    """Return gas and liquid as metadata."""
    out = {}
    for key, value in rating._asdict().items():
        if key in CONDITIONS:
            level = key in _LEVELS
            if value is not None:
                if level:
                    out[key] = f"{float(value) - ZERO:.10g} degC"
                else:
                    out[key] = f"{float(value):.10g} K"
    return out


def _polynomial(name, metadata, table: TableText, evaporating, condensing, speed) -> Readings:
    count = len(table.heads) - 2
    if count not in (10, 20, 30):
        raise SceneError("quantity", "must have 10, 20 or 30 coefficients behind it", max(count, 0))
    _check_order(table.heads[2:])
    if not table.rows:
        problem = f"has no line below the heads; write one for each of {', '.join(MEASURED)}"
        raise SceneError("quantity", f"{problem} that was measured")
    rows = {}
    for number, line in table.rows:
        word = line[0].strip()
        unit = line[1].strip()
        quantity = known_name(word, MEASURED)
        if quantity is None:
            near = did_you_mean(word, MEASURED)
            raise SceneError(f"line {number}.quantity", f'"{word}" is unknown{near}')
        if quantity in rows:
            raise SceneError(f"line {number}.quantity", f"{quantity} is there twice")
        if not unit:
            raise SceneError(
                f"line {number}.unit", f"must be a unit, such as {_EXAMPLES[quantity]}"
            )
        key = f"line {number}.{quantity}"
        coefficients = [cell_number(text, key) for text in line[2:]]
        size, zero = _scale(quantity, unit)
        rows[quantity] = np.array(coefficients) * size
        rows[quantity][0] += zero  # the constant comes first in all forms
    return sampled(name, metadata, rows, evaporating, condensing, speed)


def _check_order(heads: Sequence[Head]) -> None:
    """Refuse coefficients in another order than that of their numbers, as C1 to C10 or c0 to c9.

    Raises:
        SceneError: their heads do not end in numbers that rise by one.
    """
    expected = None
    for head in heads:
        match = re.search(r"\d+$", head.name)
        if match is None:
            raise SceneError(head.name, "must be a coefficient with its number, such as C1")
        number = int(match[0])
        if expected is not None and number != expected:
            problem = f"stands where C{expected} must: coefficients are read in their order"
            raise SceneError(head.name, problem)
        expected = number + 1


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
    count = 10
    if not callable(rows):
        count = len(next(iter(rows.values())))
    S, D = _grid(metadata, evaporating, condensing)
    if count > 10 and speed is None:
        raise SceneError("speed", f"must be given for a polynomial of {count} coefficients")
    turns = 0.0 if speed is None else speed / (2 * np.pi)

    def at(S, D) -> Mapping[str, Any]:
        if callable(rows):
            return rows(S, D)
        quantities = {}
        for quantity, row in rows.items():
            quantities[quantity] = terms_of(count, S, D, turns) @ row
        return quantities

    # [K] of the differences by which the sense of a slope is judged
    step = 0.1
    values = dict(at(S, D))
    warmer = at(S + step, D)
    hotter = at(S, D + step)
    bends = []
    for quantity, value in values.items():
        if not (value > 0).all():
            raise SceneError(quantity, "is not positive over the points; take fewer", value.min())
        if quantity in ("capacity", "mass_flow"):
            bends += _bends(quantity, value, warmer[quantity], hotter[quantity], S, D)
    conditions = {"evaporating": S, "condensing": D}
    if speed is not None:
        conditions["speed"] = np.full(S.size, speed)
    return _readings(name, metadata, conditions, S.size, values, {}, tuple(bends))


def _grid(metadata: Mapping[str, str], evaporating, condensing) -> tuple[np.ndarray, np.ndarray]:
    """[K] Evaporating and condensing temperatures, of which pairs too close together are left out."""
    axes = []
    sides = (("evaporating", evaporating, _GRID[0]), ("condensing", condensing, _GRID[1]))
    for key, temperatures, points in sides:
        if temperatures is None:
            temperatures = np.linspace(*_ends(metadata, key), points)
        axes.append(np.asarray(temperatures, float))
    S, D = np.meshgrid(*axes, indexing="ij")
    S = S.ravel()
    D = D.ravel()
    apart = D - S > _CLOSEST
    if not apart.any():
        problem = f"and condensing leave no point {_CLOSEST:g} K apart; give other temperatures"
        raise SceneError("evaporating", problem)
    return S[apart], D[apart]


def _ends(metadata: Mapping[str, str], key: str) -> tuple[float, float]:
    """[K] Range of a temperature in the metadata."""
    span = span_setting(metadata, key)
    if span is None:
        line = f"# {key} = -15 to 10 degC"
        problem = f'has no range in the metadata, as "{line}"; give the temperatures to take'
        raise SceneError(key, problem, metadata.get(key))
    size, zero = _scale(key, span.unit or "degC")
    low = span.low * size + zero
    high = span.high * size + zero
    if not low < high:
        raise SceneError(key, "must be a range that rises", metadata[key])
    if not (low > _COLDEST and high < _HOTTEST):
        bound = f"must lie within {_COLDEST - ZERO:g} and {_HOTTEST - ZERO:g} degC"
        raise SceneError(key, bound, metadata[key])
    return low, high


def _bends(quantity: str, value, warmer, hotter, S, D) -> Iterator[str]:
    """Where a polynomial of capacity or flow falls or rises against physics, in words."""
    for wrong, text in (
        (warmer - value <= 0, "falls with the evaporating temperature"),
        (hotter - value > 1e-4 * value, "rises with the condensing temperature"),
    ):
        if wrong.any():
            places = []
            for s, d in zip(S[wrong], D[wrong], strict=True):
                places.append(f"{s - ZERO:.4g}/{d - ZERO:.4g} C")
            listed = ", ".join(places)
            yield f"the polynomial of {quantity} {text} at {listed}: it bends the wrong way"


def identified_scene(scene: Scene, found: Identification) -> Scene:
    """The scene with the identified values; each says where it comes from and how sure it is.

    Its description says what it was identified from and what that began with.

    Args:
        scene: that was identified.
        found: the result.
    """
    for n, name in enumerate(found.parameters[: found.constants]):
        value = float(found.estimate[n])
        error = float(found.standard_error[n])
        parameter = varied(scene.machine, name)
        # a rule or a common factor stands behind several numbers, which say so
        several = (
            isinstance(parameter, CommonFactor)
            or name in design_rules
            or list_length(scene.machine, name) > 0
        )
        label = f"{name} " if several else ""
        source = f"identified from {found.source}, {label}{value:.5g} +- {error:.2g}"
        source = f"{source} {found.units[n]}".strip() + " (standard error)"
        if float(found.prior_share[n]) > 0.9:
            source = f"prior, of which {found.source} says nothing"
        scene = with_machine(scene, parameter.apply(scene.machine, found.estimate[n]), source)
    # the description of the file that it began with holds no longer
    words = f"Identified from {found.source}, beginning with {scene.name}"
    gas = getattr(scene.machine.compressor, "gas", None)
    fluid = getattr(gas, "fluid", None)
    if isinstance(fluid, AbstractRealGas):
        words += f", with {fluid.name}"
    document = scene.document | {"description": words}
    corrections = scene.machine.corrections
    return scene_of(document, scene.file, text=scene.text, corrections=corrections)
