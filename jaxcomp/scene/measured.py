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
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core.errors import BadInput
from ..machine import Machine
from ..study import AbstractMeasurement, ModalTest, Table, Trace, VibrationTest, variable
from ..study._analysis import quantity_named
from ..study._variables import variable_names
from ._columns import Columns
from ._settings import (
    bare_name,
    check_fluid,
    count_setting,
    known_name,
    machine_settings,
    settings_of,
    word_setting,
)
from ._table_text import Head, TableText, read_table_text
from ._text import SceneError, reading
from ._universal import read_universal
from .readings import MAP_HEAD, map_readings, read_readings

_UFF = (".uff", ".unv", ".uf")
_VIBRATION = ("target", "axis", "speed", "amplitude", "phase")
_MOST_MODES = 10_000
# Units of columns in messages.
_EXAMPLES = {"crank_angle": "deg", "frequency": "Hz", "speed": "rpm", "amplitude": "um",
             "phase": "deg"}  # fmt: skip


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
    # behind the sign stands a compressor of the file
    suffix = Path(os.fspath(path).partition("#")[0]).suffix.lower()
    if suffix in _UFF:
        with reading(os.fspath(path)):
            return read_universal(path, name)
    if suffix in (".idf", ".json"):
        return read_readings(path, evaporating, condensing, speed)
    with reading(os.fspath(path)):
        table = read_table_text(path)
        if not table.heads:
            raise SceneError("", "has no line of heads")
        read = _reader_for(table)
        if read is None:
            return map_readings(name, table, evaporating, condensing, speed)
        if not table.rows:
            raise SceneError("", "has no readings")
        return read(name, table, machine)


def _reader_for(
    table: TableText,
) -> Callable[[str, TableText, Machine], AbstractMeasurement] | None:
    """The reader of the kind that the heads of a table tell; `None` for points of a map."""
    names = [bare_name(head.name) for head in table.heads]
    if "evaporating" in names or "condensing" in names or names[0] == "quantity":
        return None
    if "crankangle" in names:
        return _trace
    if "frequency" in names:
        return _modal
    if "target" in names or "amplitude" in names:
        return _vibration
    return _table


def bundled_maps() -> dict[str, Path]:
    """Files of the maps of measured machines that the package has, by name."""
    folder = Path(__file__).parents[1] / "machines" / "maps"
    return {file.stem: file for file in sorted(folder.glob("*.csv"))}


def _trace(name: str, table: TableText, machine: Machine) -> Trace:
    columns = Columns(
        table,
        ("crank_angle", *Trace.MEASURED),
        ("crank_angle",),
        _EXAMPLES,
        deviations=True,
        settings={"independent": str(Trace.INDEPENDENT)},
    )
    settings = settings_of(table.settings, ("independent",), machine)
    check_fluid(settings, machine)
    units = {}
    for quantity, unit in Trace.MEASURED.items():
        if quantity in columns:
            units[quantity] = unit
    if not units:
        raise SceneError("", f"measures nothing; known are {', '.join(Trace.MEASURED)}")
    measured, deviations = _measured(columns, units)
    values = machine_settings(settings, machine, ("independent",))
    return Trace(
        source=name,
        quantities=tuple(units),
        angle=columns.values("crank_angle", "rad", may_be_empty=False),
        measured=measured,
        paths=tuple(values),
        settings=tuple(values.values()),
        sd=deviations,
        independent=count_setting(settings, "independent", Trace.INDEPENDENT),
    )


def _measured(columns: Columns, units: Mapping[str, str]) -> tuple[NDArray, NDArray]:
    """[SI] (quantities, n) readings, and standard deviations; not a number where not given."""
    measured = []
    deviations = []
    for name, unit in units.items():
        values = columns.values(name, unit)
        deviation = columns.deviations(name, unit, values)
        measured.append(values)
        if deviation is None:
            deviation = np.full(values.size, np.nan)
        deviations.append(deviation)
    return np.stack(measured), np.stack(deviations)


def _table(name: str, table: TableText, machine: Machine) -> Table:
    quantities, paths = _quantities_and_paths(table.heads, machine)
    columns = Columns(table, (*quantities, *paths), (), deviations=True)
    settings = settings_of(table.settings, (), machine)
    check_fluid(settings, machine)
    if not quantities:
        raise SceneError("", "measures nothing: no head is a quantity")
    values = machine_settings(settings, machine)
    for path in values:
        if path in paths:
            raise SceneError(path, "is given in a column and above the table; one must go")
    measured, deviations = _measured(columns, quantities)
    conditions = []
    units = []
    for path, unit in paths.items():
        conditions.append(columns.values(path, unit, may_be_empty=False))
        units.append(unit)
    for path, value in values.items():
        conditions.append(np.full(len(columns), value))
        units.append(variable(machine, path).unit)
    settings_by_point = np.zeros((len(columns), 0))
    if conditions:
        settings_by_point = np.stack(conditions, -1)
    return Table(
        source=name,
        quantities=tuple(quantities),
        measured=measured.T,
        paths=(*paths, *values),
        settings=settings_by_point,
        sd=deviations.T,
        units=tuple(units),
    )


def _quantities_and_paths(
    heads: Sequence[Head], machine: Machine
) -> tuple[dict[str, str], dict[str, str]]:
    """SI units of the quantities and of the numbers of the machine that heads name."""
    quantities = {}
    paths = {}
    problems = []
    numbers = variable_names(machine)
    for head in heads:
        if re.match(r"sd\s*\(", head.name, re.IGNORECASE):
            continue
        try:
            name = head.name.lower().replace(" ", "_")
            if not _is_quantity(name):
                name = head.name
            quantities[name] = quantity_named(name).unit
        except BadInput as no_quantity:
            try:
                path = known_name(head.name, numbers) or head.name
                paths[path] = variable(machine, path).unit
            except BadInput as no_number:
                problem = (
                    f"is neither a quantity ({no_quantity}) nor a number of the machine "
                    f"({no_number})"
                )
                problems.append(SceneError(head.name, problem))
    if problems and not quantities and not paths:
        raise _unknown_heads(heads)
    if problems:
        raise problems[0]
    return quantities, paths


def _is_quantity(name: str) -> bool:
    try:
        quantity_named(name)
    except BadInput:
        return False
    return True


def _unknown_heads(heads: Sequence[Head]) -> SceneError:
    """The complaint about a table of which no head is known, with what every kind of table needs."""
    names = ", ".join(head.name for head in heads)
    kinds = (
        ("a map", MAP_HEAD),
        ("readings over a revolution", "crank_angle [deg],pressure [bar]"),
        ("a modal test", "mode,frequency [Hz]"),
        ("vibration", "target,axis,speed [rpm],amplitude [um]"),
        ("any other table", "motor.mean_speed [rpm],motor_power [W]"),
    )
    listed = "; ".join(f'{kind}: "{head}"' for kind, head in kinds)
    return SceneError("heads", f"are those of no kind of table. Kinds are {listed}", names)


def _modal(name: str, table: TableText, machine: Machine) -> ModalTest:
    del machine
    places = []
    for head in table.heads:
        if "." in head.name:
            places.append(head.name)
    columns = Columns(
        table,
        ("frequency", "mode", *places),
        ("frequency",),
        _EXAMPLES,
        deviations=True,
        settings={"support": "held"},
    )
    settings = settings_of(table.settings, ("support",))
    frequency = columns.values("frequency", "rad/s", may_be_empty=False)
    columns.refuse("frequency", ~(frequency > 0), frequency, "above 0")
    support = word_setting(settings, "support").lower() or "free"
    if support not in ("free", "held"):
        raise SceneError("support", 'must be "free" or "held"', support)
    ordered = [place for place in columns.names if place in places]
    nodes, axes = _places(ordered)
    shape = None
    if ordered:
        shape = np.stack([columns.values(place, "") for place in ordered], -1)
    return ModalTest(
        source=name,
        frequency=frequency,
        modes=_mode_numbers(columns),
        free=support == "free",
        nodes=nodes,
        axes=axes,
        shape=shape,
        sd=columns.deviations("frequency", "rad/s", frequency),
    )


def _mode_numbers(columns: Columns) -> tuple[int, ...]:
    """Numbers of the modes, from 1; those of the lines where the table has none."""
    if "mode" not in columns:
        return tuple(range(1, len(columns) + 1))
    numbers = columns.values("mode", "", may_be_empty=False)
    valid = (numbers == np.round(numbers)) & (numbers >= 1) & (numbers <= _MOST_MODES)
    columns.refuse("mode", ~valid, numbers, f"a whole number from 1 to {_MOST_MODES}")
    modes = tuple(map(int, numbers))
    for mode, count in Counter(modes).items():
        if count > 1:
            problem = "is there twice; give each run a file of its own, or the means of all runs"
            raise SceneError("mode", problem, mode)
    return modes


def _places(places: Sequence[str]) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """Nodes and axes of texts as "12.ux"."""
    nodes: list[Any] = []
    axes = []
    for place in places:
        node, _, axis = place.rpartition(".")
        if re.fullmatch("[0-9]{1,9}", node):
            nodes.append(int(node))
        else:
            nodes.append(node)
        axes.append(axis.strip())
    return tuple(nodes), tuple(axes)


def _vibration(name: str, table: TableText, machine: Machine) -> VibrationTest:
    del machine
    columns = Columns(
        table, _VIBRATION, _VIBRATION[:-1], _EXAMPLES, deviations=True, settings={"order": "2"}
    )
    settings = settings_of(table.settings, ("order",))
    speed = columns.values("speed", "rad/s", may_be_empty=False)
    columns.refuse("speed", ~(speed > 0), speed, "above 0")
    order = count_setting(settings, "order", 1)
    size = np.ones(len(columns))
    unit = "m"
    if not columns.has_dimension("amplitude", "m"):  # of a velocity
        size = 1 / (order * speed)
        unit = "m/s"
    amplitude = size * columns.values("amplitude", unit, may_be_empty=False)
    columns.refuse("amplitude", ~(amplitude >= 0), amplitude, ">= 0")
    deviation = columns.deviations("amplitude", unit, amplitude / size)
    if deviation is not None:
        deviation = size * deviation
    phase = np.full(len(columns), np.nan)
    if "phase" in columns:
        phase = columns.values("phase", "rad")
    return VibrationTest(
        source=name,
        targets=columns.words("target"),
        axes=columns.words("axis"),
        speed=speed,
        amplitude=amplitude,
        phase=phase,
        order=order,
        sd=deviation,
    )
