"""Files of measurements of every kind, which `read_measurement` tells apart by their heads.

- `evaporating`, or `quantity,unit,C1,...`, or a map in a text of EnergyPlus or TESPy: rated points, see
  `jaxcomp.scene.readings`.
- `crank_angle`, with `pressure`, `suction_lift`, `discharge_lift`, `speed`: readings over a revolution.
- `frequency`, with `mode` and columns NODE.AXIS of the shapes; or UFF files: modal test, see
  `jaxcomp.scene._universal`.
- `target`, `axis`, `speed`, `amplitude`, perhaps `phase`: vibration.
- Names of quantities (`loss_power.main_journal [W]`) and paths of what was set (`motor.mean_speed
  [rpm]`): a table.

All have units in the heads, `#` lines with metadata, and `sd(NAME) [UNIT]` or `[%]` for standard
deviations. What was set at all points may stand in the metadata: `# motor.mean_speed = 1500 rpm`.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._core.display import is_temperature
from .._core.errors import BadInput
from .._core.words import did_you_mean
from ..machine import Machine
from ..study import AbstractMeasurement, ModalTest, Table, Trace, VibrationTest, variable
from ..study.interface import quantity_named
from ._cells import cell_number, lines_of, read_cells
from ._text import SceneError, reading
from ._units import factor, scale, to_si
from ._universal import read_universal
from .readings import read_readings, split_metadata

_UFF = (".uff", ".unv", ".uf")
_WORDS = (
    "machine",
    "fluid",
    "source",
    "form",
    "licence",
    "support",
    "order",
    "independent",
    "date",
)


def read_measurement(
    path: str | os.PathLike,
    machine: Machine,
    evaporating: Sequence[float] | None = None,
    condensing: Sequence[float] | None = None,
    speed: float | None = None,
) -> AbstractMeasurement:
    """A file of measurements of any kind.

    Args:
        path: of the file, or the name of a map of the package, such as "06dm313_r22".
        machine: whose numbers and quantities the heads may name.
        evaporating, condensing, speed: of points of a polynomial, see `read_readings`.

    Raises:
        SceneError: a file that cannot be read, an unknown head, a missing unit or one of another
            dimension, or a cell that is no number.
    """
    if not os.path.exists(path) and os.fspath(path) in bundled_maps():
        path = bundled_maps()[os.fspath(path)]
    name = os.path.basename(os.fspath(path))
    if Path(path).suffix.lower() in _UFF:
        with reading(os.fspath(path)):
            return read_universal(path, name)
    if Path(path).suffix.lower() in (".idf", ".json"):
        return read_readings(path, evaporating, condensing, speed)
    with reading(os.fspath(path)):
        found = _by_heads(name, *split_metadata(read_cells(path)), machine)
    return read_readings(path, evaporating, condensing, speed) if found is None else found


def _by_heads(name: str, metadata, lines, machine: Machine) -> AbstractMeasurement | None:
    """The measurement of a CSV file; `None` for points of a map."""
    if not lines:
        raise SceneError("", "has no line of heads")
    heads, rows = [_head(cell) for cell in lines[0]], lines[1:]
    names = [head[0] for head in heads]
    if "evaporating" in names or names[0] == "quantity":
        return None
    rows = [line for _, line in lines_of(rows, len(heads))]
    if twice := {one for one in names if names.count(one) > 1}:
        raise SceneError(min(twice), "is there twice")
    if not rows:
        raise SceneError("", "has no readings")
    if "crank_angle" in names:
        return _trace(name, metadata, heads, rows, machine)
    if "frequency" in names:
        return _modal(name, metadata, heads, rows)
    if "target" in names or "amplitude" in names:
        return _vibration(name, metadata, heads, rows)
    return _table(name, metadata, heads, rows, machine)


def bundled_maps() -> dict[str, Path]:
    """Files of the maps of measured machines that the package has, by name."""
    folder = Path(__file__).parents[1] / "machines" / "maps"
    return {file.stem: file for file in sorted(folder.glob("*.csv"))}


def _head(cell: str) -> tuple[str, str]:
    """Name and unit of a column."""
    name, bracket, unit = cell.strip().partition("[")
    return name.strip(), unit.rstrip("] ").strip() if bracket else ""


def _number(text: str, unit: str, si: str, key: str) -> float:
    value = cell_number(text, key, np.nan)
    if si == "rad/s" and unit.lower() in ("hz", "1/s"):
        return value * 2 * np.pi
    size, zero = _scale(unit, si, key, is_temperature(key, si))
    return value * size + zero


def _scale(unit: str, si: str, key: str, level: bool) -> tuple[float, float]:
    if si and not unit:
        raise SceneError(key, f'needs its unit in the head, as in "{key} [{si}]"')
    return scale(unit, si, level, key, unit) if unit else (1.0, 0.0)


def _column(heads, lines, name: str, si: str) -> np.ndarray:
    n = [head for head, _ in heads].index(name)
    unit = heads[n][1]
    if si != "rad/s" or unit.lower() not in ("hz", "1/s"):
        _scale(unit, si, name, is_temperature(name, si))
    rows = enumerate(lines, 2)
    return np.array([_number(line[n], unit, si, f"line {k}.{name}") for k, line in rows])


def _deviation(heads, lines, name: str, si: str, values: np.ndarray) -> np.ndarray | None:
    n = next((n for n, (head, _) in enumerate(heads) if head == f"sd({name})"), None)
    if n is None:
        return None
    cells = np.array(
        [cell_number(line[n], f"line {k}.sd({name})", np.nan) for k, line in enumerate(lines, 2)]
    )
    unit = heads[n][1]
    if unit == "%":
        return cells / 100 * np.abs(values)
    if si == "rad/s" and unit.lower() in ("hz", "1/s"):
        return cells * 2 * np.pi
    return cells * _scale(unit, si, f"sd({name})", False)[0]


def _known(heads, names, needed) -> None:
    for head, _ in heads:
        plain = head[3:-1] if head.startswith("sd(") else head
        if plain not in names:
            near = did_you_mean(plain, names)
            raise SceneError(head, f"is an unknown column{near}")
    for name in needed:
        if name not in [head for head, _ in heads]:
            raise SceneError(name, "is a missing column")


def _settings(metadata: Mapping[str, str], machine: Machine) -> dict[str, float]:
    """[SI] Numbers of the machine that the metadata sets."""
    out = {}
    for key, text in metadata.items():
        if key in _WORDS or not text:
            continue
        try:
            one = variable(machine, key)
        except BadInput as error:
            raise SceneError(key, str(error)) from None
        out[key] = float(to_si(text, one.unit, key))
    return out


def _trace(name, metadata, heads, lines, machine) -> Trace:
    known = ("crank_angle", *Trace.MEASURED)
    _known(heads, known, ("crank_angle",))
    angle = _column(heads, lines, "crank_angle", "rad")
    quantities = tuple(q for q in Trace.MEASURED if q in [head for head, _ in heads])
    if not quantities:
        raise SceneError("", f"measures nothing; known are {', '.join(Trace.MEASURED)}")
    units = [Trace.MEASURED[q] for q in quantities]
    pairs = list(zip(quantities, units, strict=True))
    measured = np.stack([_column(heads, lines, *pair) for pair in pairs])
    sd = [
        _deviation(heads, lines, *pair, values)
        for pair, values in zip(pairs, measured, strict=True)
    ]
    given = _settings(metadata, machine)
    independent = int(float(metadata.get("independent", Trace.INDEPENDENT)))
    return Trace(
        name, quantities, angle, measured, tuple(given), tuple(given.values()),
        np.stack([np.full(angle.size, np.nan) if one is None else one for one in sd]), independent,
    )  # fmt: skip


def _table(name, metadata, heads, lines, machine) -> Table:
    quantities, units, paths = [], [], {}
    for head, _ in heads:
        if head.startswith("sd("):
            continue
        try:
            units.append(quantity_named(head).unit)
            quantities.append(head)
        except BadInput as no_quantity:
            try:
                paths[head] = variable(machine, head).unit
            except BadInput as error:
                both = (
                    f"is neither a quantity ({no_quantity}) nor a number of the machine ({error})"
                )
                raise SceneError(head, both) from None
    _known(heads, (*quantities, *paths), ())
    if not quantities:
        raise SceneError("", "measures nothing: no head is a quantity")
    pairs = list(zip(quantities, units, strict=True))
    measured = np.stack([_column(heads, lines, *pair) for pair in pairs], axis=-1)
    sd = [
        _deviation(heads, lines, *pair, values)
        for pair, values in zip(pairs, measured.T, strict=True)
    ]
    given = _settings(metadata, machine)
    settings = [_column(heads, lines, *pair) for pair in paths.items()]
    settings += [np.full(len(lines), value) for value in given.values()]
    return Table(
        name, tuple(quantities), measured, (*paths, *given),
        np.stack(settings, axis=-1) if settings else np.zeros((len(lines), 0)),
        np.stack([np.full(len(lines), np.nan) if one is None else one for one in sd], axis=-1),
        (*paths.values(), *(variable(machine, key).unit for key in given)),
    )  # fmt: skip


def _modal(name, metadata, heads, lines) -> ModalTest:
    places = [head for head, _ in heads if "." in head]
    _known(heads, ("frequency", "mode", *places), ("frequency",))
    frequency = _column(heads, lines, "frequency", "rad/s")
    if not (frequency > 0).all():
        raise SceneError("frequency", "must be above 0", frequency.min())
    modes = tuple(range(1, len(lines) + 1))
    if "mode" in [head for head, _ in heads]:
        modes = tuple(int(x) for x in _column(heads, lines, "mode", ""))
    if len(set(modes)) < len(modes):
        raise SceneError("mode", "is named twice")
    if min(modes) < 1:
        raise SceneError("mode", "must be a number from 1", min(modes))
    support = metadata.get("support", "free")
    if support not in ("free", "held"):
        raise SceneError("support", 'must be "free" or "held"', support)
    nodes, axes = _places(places)
    shape = np.stack([_column(heads, lines, place, "") for place in places], -1) if places else None
    sd = _deviation(heads, lines, "frequency", "rad/s", frequency)
    return ModalTest(name, frequency, modes, support == "free", nodes, axes, shape, sd)


def _places(places) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """Nodes and axes of texts as "12.ux"."""
    pairs = [place.rpartition(".")[::2] for place in places]
    nodes = tuple(int(node) if node.isdigit() else node for node, _ in pairs)
    return nodes, tuple(axis for _, axis in pairs)


def _vibration(name, metadata, heads, lines) -> VibrationTest:
    known = ("target", "axis", "speed", "amplitude", "phase")
    _known(heads, known, known[:-1])
    names = [head for head, _ in heads]
    targets, axes = (
        tuple(line[names.index(key)].strip() for line in lines) for key in ("target", "axis")
    )
    speed = _column(heads, lines, "speed", "rad/s")
    order = int(float(metadata.get("order", "1")))
    amplitude = _column(heads, lines, "amplitude", "m") if _is(heads, "amplitude", "m") else None
    if amplitude is None:  # of a velocity
        amplitude = _column(heads, lines, "amplitude", "m/s") / (order * speed)
    if not (amplitude >= 0).all():
        raise SceneError("amplitude", "must be >= 0", amplitude.min())
    phase = np.full(speed.size, np.nan)
    if "phase" in names:
        phase = _column(heads, lines, "phase", "rad")
    sd = _deviation(heads, lines, "amplitude", "m", amplitude)
    return VibrationTest(name, targets, axes, speed, amplitude, phase, order, sd)


def _is(heads, name: str, si: str) -> bool:
    """Whether a column has a unit of this dimension."""
    unit = dict(heads)[name]
    try:
        return bool(unit) and factor(unit, si) > 0
    except SceneError:
        return False
