"""What a scene says: its values as rows of a table, and those that a machine hardly has.

The usual ranges, which the declarations of numbers have, are wide, a factor of two or more beyond what
reciprocating compressors from the smallest household machine to large process machines have; a value
outside is worth a second look, no more: it may be the slip of a unit or of a decimal point.
"""

import dataclasses
import re
from collections.abc import Callable, Iterator
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
    told = meanings(type(part))
    table = type(part).written(table)
    for name, entry in entries(type(part)).items():
        value = getattr(part, name)
        here = join(path, name)
        if value is None:
            continue
        if isinstance(entry, Section):
            several = len(choices(entry.classes)) > 1 and not entry.rows
            parts, tables = (value, table.get(name)) if entry.rows else ([value], [table[name]])
            for place, one in enumerate(parts):
                given = tables[place]
                at = f"{here}.{place}" if entry.rows else here
                if isinstance(one, NamedBearing):
                    source = scene.sources.get(at, "")
                    yield DescribedValue(at, _written(given, at), one.name, "", source, told[name])
                    continue
                if several:
                    yield _type(one, given, at)
                yield from _rows(scene, one, given, at)
        elif isinstance(entry, Number | Option):
            given = _written(table[name], here) if name in table else None
            source = scene.sources.get(here, "default")
            unit = ""
            if isinstance(entry, Number):
                value = np.asarray(value)
                unit = entry.unit
            yield DescribedValue(here, given, value, unit, source, told[name])


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
    one = (m.piston_mass + m.conrod_mass) * m.crank_radius
    carried = shaft.of_throws(np.broadcast_to(one, (shaft.count,)))
    return max(abs(u) / all_ for u, all_ in zip(shaft.unbalances(m), carried, strict=True))


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
    ("port_length over port_diameter", lambda v: (v.port_length or v.port_diameter) / v.port_diameter,
     0.1, 5.0),
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


def implausible_values(scene: Scene) -> tuple[ImplausibleValue, ...]:
    """Unusual values of a machine file, in the order of its parts.

    The usual range of a number stands in the declaration of its field, those of ratios here.

    Args:
        scene: as `jaxcomp.load` gives it.
    """
    machine = scene.machine
    rows = {row.path: row for row in describe(scene)}
    found: list[ImplausibleValue] = []
    roots: dict[str, Any] = {"": machine.compressor}
    for section in NAMED:
        roots |= {f"{section}.{name}": part for name, part in getattr(machine, section).items()}
    crank = getattr(machine.parts.get("loads"), "crank", None)
    from_crank = crank is not None and machine.compressor is not None
    for root, tree in {**roots, **machine.parts}.items():
        for path, part in subparts(tree):
            where = join(root, path).rstrip(".")
            found += _of_numbers(where, part, rows)
            found += _of_part(where, part, from_crank, rows)
    return tuple(found)


def _of_numbers(
    where: str, part: Part, rows: dict[str, DescribedValue]
) -> Iterator[ImplausibleValue]:
    for name, field in quantities(part):
        path = join(where, name)
        usual = field.metadata["usual"]
        if usual is None or path not in rows:  # such as a bearing that a joint names
            continue
        sizes = np.abs(np.asarray(rows[path].value, float))
        if np.any((sizes > 0) & ((sizes < usual[0]) | (sizes > usual[1]))):
            given = rows[path].given
            unit = field.metadata["unit"]
            what = f"{rows[path].value} {unit}".rstrip() if given is None else f"{given}"
            low, high = (shown(name, unit, end).text(end) for end in usual)
            yield ImplausibleValue(path, what, f"{low} to {high}" if usual[0] else f"up to {high}")


def _of_part(
    path: str, part: Part, from_crank: bool, rows: dict[str, DescribedValue]
) -> Iterator[ImplausibleValue]:
    ratios: tuple[_Ratio, ...] = ()
    if isinstance(part, Compressor) and isinstance(part.mechanism, SliderCrank):
        ratios = _CRANKSHAFT
    elif isinstance(part, SliderCrank):
        ratios = _SLIDER_CRANK
    elif isinstance(part, SliderLink):
        ratios = _SLIDER_LINK
    elif all(hasattr(part, name) for name in ("radial_clearance", "diameter", "length")):
        ratios = _JOURNAL
    elif all(hasattr(part, name) for name in ("suction_pressure", "discharge_pressure")):
        ratios = _CYCLE + (_FLOW if isinstance(part, PolytropicCycle) else ())
    elif getattr(part, "oscillator", None) is not None:
        ratios = _VALVE
    # the film of a rotor's link, by its kind: a compressor alone does not import the rotor
    if getattr(part, "kind", "") == "film" and getattr(part, "load", 0) is None and not from_crank:
        yield ImplausibleValue(
            join(path, "load"), "absent, without a crank to take it from", '["80 N", "0 N"]'
        )
    for what, ratio, low, high in ratios:
        value = float(ratio(part if ratios is _CRANKSHAFT else of_cylinder(part)))
        if value != 0 and not low <= abs(value) <= high:
            where = "crankshaft" if ratios is _CRANKSHAFT else path
            words = re.findall(r"\w+", what)
            given = [f"{w} = {rows[join(path, w)].given}" for w in words if join(path, w) in rows]
            shown_given = f" ({', '.join(given)})" if given else ""
            what = f"{what} is {value:.3g}{shown_given}"
            yield ImplausibleValue(where, what, f"{low:g} to {high:g}")


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
        given = [name for name in _WHOLE if getattr(compressor, name, None) is not None]
        out += [f"{_WHOLE[name]} [{name}]" for name in ("gas", "friction") if name not in given]
        if "friction" in given:
            out += [
                f"friction of {what} [friction.{key}]" for what, key in _ideal(compressor.friction)
            ]
        if compressor.crankshaft.main_journal is None:
            out.append("friction of the shaft [crankshaft.main_journal]")
        if isinstance(compressor.motor, ConstantSpeed):
            out.append("fluctuation of the speed [motor]")
        if "gravity" not in given:
            out.append(f"{_WHOLE['gravity']} (gravity)")
    absent = (name for name in ("rotor", "suspension", "torsion") if name not in scene.parts)
    return (*out, *(f"{_WHOLE[name]} [{name}]" for name in absent))


def _ideal(friction: Any) -> Iterator[tuple[str, str]]:
    """Joints without a law of friction: their names in words, and their keys."""
    joints = {field.name: getattr(friction, field.name) for field in dataclasses.fields(friction)}
    if joints.pop("piston_film", None) is not None:
        joints.pop("wall", None)  # which has either
    for name, law in joints.items():
        if law is None and name not in _RARE:
            yield ("piston" if name == "wall" else name.replace("_", " ")), name
