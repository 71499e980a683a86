"""What a scene says: its values as rows of a table, and those that a machine hardly has.

The usual ranges, which the declarations of numbers have, are wide, a factor of two or more beyond what
reciprocating compressors from the smallest household machine to large process machines have; a value
outside is worth a second look, no more: it may be the slip of a unit or of a decimal point.
"""

import dataclasses
import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .._core.display import shown
from .._core.each import of_cylinder
from .._core.fields import Part, quantities, subparts
from ..compressor import Compressor
from ..film import NamedBearing
from ..gas import PolytropicCycle
from ..mechanism import SliderCrank, SliderLink
from ..motor import ConstantSpeed
from ._read import unwrapped
from ._scene import Scene
from ._schema import NAMED, Number, Option, Section, choices, entries, join, kind_of, meanings


class DescribedValue(NamedTuple):
    """One value of a scene.

    Attributes:
        path: dotted path.
        given: the value as the file gives it, `None` where the default holds.
        value: the value in `unit`, or the word of an option.
        unit: SI unit, empty for a pure number or an option.
        source: where it comes from.
        doc: what it is.
    """

    path: str
    given: Any
    value: Any
    unit: str = ""
    source: str = ""
    doc: str = ""


def describe(scene: Scene) -> tuple[DescribedValue, ...]:
    """Every value of a scene in the order of its parts, with its source.

    Quantities are NumPy arrays in SI units. The word `type` of a section stands before its values.

    Args:
        scene: as `jaxcomp.load` gives it.
    """
    rows: list[DescribedValue] = []
    machine = scene.machine
    if machine.compressor is not None:
        rows += _rows(scene, machine.compressor, scene.document, "")
    for section in NAMED:
        for name, part in getattr(machine, section).items():
            path = f"{section}.{name}"
            table = scene.document[section][name]
            rows += [_type(part, table, path), *_rows(scene, part, table, path)]
    for name, part in machine.parts.items():
        rows += _rows(scene, part, scene.document[name], name)
    return tuple(rows)


def _rows(scene: Scene, part: Part, table: Any, path: str) -> Iterator[DescribedValue]:
    """Values of a part and of the parts inside it, as its table gives them."""
    descriptions = meanings(type(part))
    table = type(part).written(table)
    for name, entry in entries(type(part)).items():
        value = getattr(part, name)
        doc = descriptions[name]
        place = join(path, name)
        if value is None:
            continue
        if isinstance(entry, Section) and entry.rows:
            for number, inner in enumerate(value):
                row = table[name][number]
                yield from _inner_rows(scene, inner, row, f"{place}.{number}", doc, False)
        elif isinstance(entry, Section):
            several = len(choices(entry.classes)) > 1
            yield from _inner_rows(scene, value, table[name], place, doc, several)
        elif isinstance(entry, Number | Option):
            written = None
            if name in table:
                written = _written(table[name], place)
            source = scene.sources.get(place, "default")
            unit = ""
            if isinstance(entry, Number):
                value = np.asarray(value)
                unit = entry.unit
            yield DescribedValue(
                path=place, given=written, value=value, unit=unit, source=source, doc=doc
            )


def _inner_rows(
    scene: Scene, part: Part, table: Any, path: str, doc: str, with_type: bool
) -> Iterator[DescribedValue]:
    """Values of a part inside another one; of a bearing by its name that name alone."""
    if isinstance(part, NamedBearing):
        yield DescribedValue(
            path=path,
            given=_written(table, path),
            value=part.name,
            source=scene.sources.get(path, ""),
            doc=doc,
        )
        return
    if with_type:
        yield _type(part, table, path)
    yield from _rows(scene, part, table, path)


def _type(part: Part, table: Any, path: str) -> DescribedValue:
    return DescribedValue(join(path, "type"), table.get("type"), kind_of(type(part)))


def _written(entry: Any, path: str) -> Any:
    value, unit, _ = unwrapped(entry, path)
    return f"{value} {unit}" if unit else value


class ImplausibleValue(NamedTuple):
    """A value out of the usual range.

    Attributes:
        path: dotted path of the value, or of the part that the ratio belongs to.
        what: what is unusual, with its value.
        usual: the usual range, as text.
    """

    path: str
    what: str
    usual: str


_Ratio = tuple[str, Callable, float, float]
# Of a body as wide and as long as the bore: pistons are hollow and shorter, or double and of iron.
_PISTON: _Ratio = (
    "piston_mass over bore cubed, kg/m^3", lambda m: m.piston_mass / m.bore**3, 100.0, 2e4,
)  # fmt: skip
_SLIDER_LINK: tuple[_Ratio, ...] = (
    ("stroke over bore", lambda m: 2 * m.crank_radius / m.bore, 0.2, 4.0),
    _PISTON,
)
_SLIDER_CRANK: tuple[_Ratio, ...] = (
    *_SLIDER_LINK,
    ("crank radius over rod length", lambda m: m.crank_radius / m.conrod_length, 0.08, 0.5),
    ("conrod_centre over rod length", lambda m: m.conrod_centre / m.conrod_length, 0.05, 0.95),
    (
        "rod's radius of gyration over its length",
        lambda m: np.sqrt(m.conrod_inertia / max(m.conrod_mass, 1e-300)) / m.conrod_length,
        0.1,
        1.0,
    ),
)


def _throw_balance(c: Any) -> float:
    """Largest unbalance of a throw over that of its pistons and rods at the crank pin."""
    m = c.mechanism
    shaft = c.crankshaft
    cylinder_unbalance = (m.piston_mass + m.conrod_mass) * m.crank_radius
    carried = shaft.of_throws(np.broadcast_to(cylinder_unbalance, (shaft.count,)))
    return max(abs(u) / mass for u, mass in zip(shaft.unbalances(m), carried, strict=True))


_CRANKSHAFT: tuple[_Ratio, ...] = (
    ("unbalance of a throw over that of its pistons and rods", _throw_balance, 0.0, 3.0),
)
_JOURNAL: tuple[_Ratio, ...] = (
    ("radial_clearance over radius", lambda j: 2 * j.radial_clearance / j.diameter, 2e-4, 1e-2),
    ("length over diameter", lambda j: j.length / j.diameter, 0.1, 5.0),
)
_CYCLE: tuple[_Ratio, ...] = (
    ("pressure ratio", lambda g: g.discharge_pressure / g.suction_pressure, 1.1, 50.0),
)
_VALVE: tuple[_Ratio, ...] = (
    ("stop over port_diameter", lambda v: v.stop / v.port_diameter, 0.01, 0.5),
    ("preload over stop", lambda v: v.preload / v.stop, 0.0, 3.0),
    # 0.03 where a diameter stands for many small ports together, whose columns of gas are short
    ("port_length over port_diameter", lambda v: (v.port_length or v.port_diameter) / v.port_diameter,
     0.03, 5.0),
    ("natural frequency, Hz",
     lambda v: np.sqrt(v.oscillator.stiffness / v.oscillator.mass) / (2 * np.pi), 10.0, 2000.0),
)  # fmt: skip
_FLOW: tuple[_Ratio, ...] = (
    # below 1 the compression never reaches the discharge pressure, and no gas flows
    (
        "highest pressure without a discharge valve over discharge pressure",
        lambda g: (
            (1 + 1 / max(float(g.clearance_ratio), 1e-300)) ** g.exponent
            * g.suction_pressure
            / g.discharge_pressure
        ),
        1.0,
        np.inf,
    ),
)


def _widest_hole(piping: Any) -> float:
    """Widest sharp hole over the widest pipe at its nodes; 0 where there is none."""
    widest = 0.0
    for orifice in piping.orifices:
        if orifice.diameter is None or orifice.loss_coefficient is not None:
            continue
        pipe_diameter = 0.0
        for duct in piping.ducts:
            ends_of_pipes = tuple(pairwise(duct.nodes))
            diameters = np.broadcast_to(duct.diameter, (len(ends_of_pipes),))
            for ends, diameter in zip(ends_of_pipes, diameters.tolist(), strict=True):
                if set(ends) & set(orifice.nodes):
                    pipe_diameter = max(pipe_diameter, diameter)
        if pipe_diameter:
            widest = max(widest, float(orifice.diameter) / pipe_diameter)
    return widest


# A hole without a loss coefficient that is wider than its pipe has no loss.
_PIPING: tuple[_Ratio, ...] = (
    ("diameter of an orifice over that of the widest pipe beside it", _widest_hole, 0.0, 1.0),
)


def implausible_values(scene: Scene) -> tuple[ImplausibleValue, ...]:
    """Unusual values of a machine file, in the order of its parts.

    The usual range of a number stands in the declaration of its field, those of ratios here.

    Args:
        scene: as `jaxcomp.load` gives it.
    """
    machine = scene.machine
    rows = {row.path: row for row in describe(scene)}
    unusual: list[ImplausibleValue] = []
    roots: dict[str, Any] = {"": machine.compressor}
    for section in NAMED:
        for name, part in getattr(machine, section).items():
            roots[f"{section}.{name}"] = part
    crank = getattr(machine.parts.get("loads"), "crank", None)
    from_crank = crank is not None and machine.compressor is not None
    for root, tree in {**roots, **machine.parts}.items():
        for path, part in subparts(tree):
            where = join(root, path).rstrip(".")
            unusual += _implausible_numbers(where, part, rows)
            unusual += _implausible_ratios(where, part, from_crank, rows)
    return tuple(unusual)


def _implausible_numbers(
    where: str, part: Part, rows: dict[str, DescribedValue]
) -> Iterator[ImplausibleValue]:
    for name, field in quantities(part):
        path = join(where, name)
        usual = field.metadata["usual"]
        if usual is None or path not in rows:  # such as a bearing that a joint names
            continue
        sizes = np.abs(np.asarray(rows[path].value, float))
        lowest, highest = usual
        if np.any((sizes > 0) & ((sizes < lowest) | (sizes > highest))):
            written = rows[path].given
            unit = field.metadata["unit"]
            what = f"{written}"
            if written is None:
                what = f"{rows[path].value} {unit}".rstrip()
            low = shown(name, unit, lowest).text(lowest)
            high = shown(name, unit, highest).text(highest)
            text = f"{low} to {high}" if lowest else f"up to {high}"
            yield ImplausibleValue(path, what, text)


def _implausible_ratios(
    path: str, part: Part, from_crank: bool, rows: dict[str, DescribedValue]
) -> Iterator[ImplausibleValue]:
    # the film of a rotor's link, by its kind: a compressor alone does not import the rotor
    if getattr(part, "kind", "") == "film" and getattr(part, "load", 0) is None and not from_crank:
        yield ImplausibleValue(
            join(path, "load"), "absent, without a crank to take it from", '["80 N", "0 N"]'
        )
    ratios = _ratios_of(part)
    where = path
    single: Any = of_cylinder(part)
    if ratios is _CRANKSHAFT:  # whose throws carry all cylinders
        where = "crankshaft"
        single = part
    for what, ratio, low, high in ratios:
        value = float(ratio(single))
        if value != 0 and not low <= abs(value) <= high:
            written = _written_in(what, path, rows)
            yield ImplausibleValue(where, f"{what} is {value:.3g}{written}", f"{low:g} to {high:g}")


def _ratios_of(part: Part) -> tuple[_Ratio, ...]:
    """The ratios that a part of this kind is judged by."""
    if isinstance(part, Compressor) and isinstance(part.mechanism, SliderCrank):
        return _CRANKSHAFT
    if isinstance(part, SliderCrank):
        return _SLIDER_CRANK
    if isinstance(part, SliderLink):
        return _SLIDER_LINK
    if all(hasattr(part, name) for name in ("radial_clearance", "diameter", "length")):
        return _JOURNAL
    if isinstance(part, PolytropicCycle):
        return _CYCLE + _FLOW
    if all(hasattr(part, name) for name in ("suction_pressure", "discharge_pressure")):
        return _CYCLE
    if getattr(part, "oscillator", None) is not None:
        return _VALVE
    if getattr(part, "kind", "") == "piping":
        return _PIPING
    return ()


def _written_in(ratio: str, path: str, rows: dict[str, DescribedValue]) -> str:
    """The values that a ratio names, as the file gives them, in brackets; empty where it names none."""
    values = []
    for word in re.findall(r"\w+", ratio):
        row = rows.get(join(path, word))
        if row is not None:
            values.append(f"{word} = {row.given}")
    if not values:
        return ""
    return f" ({', '.join(values)})"


# Joints that a machine may well be without, and sections of whole parts, in words.
_RARE = ("packing", "thrust_bearing", "pump")
_WHOLE = {
    "gas": "forces of the gas", "friction": "friction of all joints", "gravity": "weights",
    "rotor": "bending of the shaft", "suspension": "springs under the block",
    "torsion": "twist of the shaft",
}  # fmt: skip


def left_out(scene: Scene) -> tuple[str, ...]:
    """Parts that a machine file does not describe, and so is computed without, each in words with its
    key.
    """
    compressor = scene.machine.compressor
    out = []
    if compressor is None:
        out.append("the crank drive [mechanism]")
    else:
        out += _left_out_of_crank_drive(compressor)
    for name in ("rotor", "suspension", "torsion"):
        if name not in scene.parts:
            out.append(f"{_WHOLE[name]} [{name}]")
    return tuple(out)


def _left_out_of_crank_drive(compressor: Compressor) -> Iterator[str]:
    """Parts of the crank drive and of its gas that a machine file does not describe, in words."""
    described = [name for name in _WHOLE if getattr(compressor, name, None) is not None]
    for name in ("gas", "friction"):
        if name not in described:
            yield f"{_WHOLE[name]} [{name}]"
    if "friction" in described:
        for joint, key in _frictionless_joints(compressor.friction):
            yield f"friction of {joint} [friction.{key}]"
    if compressor.crankshaft.main_journal is None:
        yield "friction of the shaft [crankshaft.main_journal]"
    if isinstance(compressor.motor, ConstantSpeed):
        yield "fluctuation of the speed [motor]"
    if "gravity" not in described:
        yield f"{_WHOLE['gravity']} (gravity)"


def _frictionless_joints(friction: Any) -> Iterator[tuple[str, str]]:
    """Joints without a law of friction: their names in words, and their keys."""
    joints = {field.name: getattr(friction, field.name) for field in dataclasses.fields(friction)}
    if joints.pop("piston_film", None) is not None:
        joints.pop("wall", None)  # which has either
    for name, law in joints.items():
        if law is None and name not in _RARE:
            joint = name.replace("_", " ")
            if name == "wall":
                joint = "piston"
            yield joint, name
