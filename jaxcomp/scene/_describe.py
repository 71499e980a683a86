"""What a scene says: its values as rows of a table, and those that a machine hardly has.

The usual ranges are wide, a factor of two or more beyond what reciprocating compressors from the smallest
household machine to large process machines have; a value outside is worth a second look, no more: it may
be the slip of a unit or of a decimal point.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from .._fields import Part, of_cylinder, subparts
from .._shown import RPM
from ..compressor import Compressor
from ..film import NamedBearing
from ..gas import PolytropicCycle
from ..mechanism import SliderCrank
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
    """
    rows: list[DescribedValue] = []
    machine = scene.machine
    if machine.compressor is not None:
        rows += _rows(scene, machine.compressor, scene.document, "")
    for section in NAMED:
        for name, part in getattr(machine, section).items():
            path, table = f"{section}.{name}", scene.document[section][name]
            rows += [_type(part, table, path), *_rows(scene, part, table, path)]
    for name, part in machine.parts.items():
        rows += _rows(scene, part, scene.document[name], name)
    return tuple(rows)


def _rows(scene: Scene, part: Part, table: Any, path: str) -> Iterator[DescribedValue]:
    told = meanings(type(part))
    for name, entry in entries(type(part)).items():
        value, here = getattr(part, name), join(path, name)
        if value is None:
            continue
        if isinstance(entry, Section):
            several = len(choices(entry.classes)) > 1 and not entry.rows
            parts, tables = (value, table.get(name)) if entry.rows else ([value], [table[name]])
            for place, one in enumerate(parts):
                given, at = tables[place], f"{here}.{place}" if entry.rows else here
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
                value, unit = np.asarray(value), entry.unit
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


# SI, by the last name of the path. Zero is left alone: it switches an effect off.
_RPM = 1 / RPM
_VALUES: dict[str, tuple[float, float, str]] = {
    "bore": (5e-3, 1.0, "5 mm to 1 m"),
    "crank_radius": (1e-3, 0.5, "1 mm to 0.5 m"),
    "conrod_length": (5e-3, 3.0, "5 mm to 3 m"),
    "mean_speed": (60 * _RPM, 3e4 * _RPM, "60 to 30,000 rpm"),
    "synchronous_speed": (60 * _RPM, 3e4 * _RPM, "60 to 30,000 rpm"),
    "suction_pressure": (1e3, 2e7, "0.01 to 200 bar"),
    "discharge_pressure": (1e4, 1e8, "0.1 to 1000 bar"),
    "clearance_ratio": (1e-3, 0.3, "0.1 to 30 %"),
    "coefficient": (5e-4, 0.5, "0.0005 to 0.5"),
    "dynamic_viscosity": (1e-4, 2.0, "0.1 mPa s to 2 Pa s"),
    "radial_clearance": (1e-6, 1e-3, "1 um to 1 mm"),
    "young_modulus": (1e9, 1e12, "1 to 1000 GPa"),
    "density": (500.0, 25e3, "500 to 25,000 kg/m^3"),
}
_Ratio = tuple[str, Callable, float, float]
_SLIDER_CRANK: tuple[_Ratio, ...] = (
    ("stroke over bore", lambda m: 2 * m.crank_radius / m.bore, 0.2, 4.0),
    ("crank radius over rod length", lambda m: m.crank_radius / m.conrod_length, 0.08, 0.5),
    ("conrod_centre over rod length", lambda m: m.conrod_centre / m.conrod_length, 0.05, 0.95),
    (
        "rod's radius of gyration over its length",
        lambda m: np.sqrt(m.conrod_inertia / max(m.conrod_mass, 1e-300)) / m.conrod_length,
        0.1,
        1.0,
    ),
)
_CRANKSHAFT: tuple[_Ratio, ...] = (
    (
        "unbalance of a throw over that of its pistons and rods at the crank pin",
        lambda c: (
            max(abs(u) for u in c.crankshaft.unbalances(c.mechanism))
            / np.max((c.mechanism.piston_mass + c.mechanism.conrod_mass) * c.mechanism.crank_radius)
        ),
        0.0,
        3.0,
    ),
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
    """What is unusual in a scene, in the order of its parts."""
    machine = scene.machine
    found = [one for row in describe(scene) for one in _of_value(row)]
    roots: dict[str, Any] = {"": machine.compressor}
    roots |= {f"bearings.{name}": part for name, part in machine.bearings.items()}
    crank = getattr(machine.parts.get("loads"), "crank", None)
    from_crank = crank is not None and machine.compressor is not None
    for root, tree in {**roots, **machine.parts}.items():
        for path, part in subparts(tree):
            found += _of_part(join(root, path).rstrip("."), part, from_crank)
    return tuple(found)


def _of_value(row: DescribedValue) -> Iterator[ImplausibleValue]:
    key = row.path.split(".")[-1]
    if key not in _VALUES or (not row.unit and key not in ("clearance_ratio", "coefficient")):
        return
    low, high, usual = _VALUES[key]
    sizes = np.abs(np.asarray(row.value, float))
    if np.any((sizes > 0) & ((sizes < low) | (sizes > high))):
        given = row.given if row.given is not None else f"{row.value} {row.unit}"
        yield ImplausibleValue(row.path, f"{given}", usual)


def _of_part(path: str, part: Part, from_crank: bool) -> Iterator[ImplausibleValue]:
    ratios: tuple[_Ratio, ...] = ()
    if isinstance(part, Compressor) and isinstance(part.mechanism, SliderCrank):
        ratios = _CRANKSHAFT
    elif isinstance(part, SliderCrank):
        ratios = _SLIDER_CRANK
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
        value = float(ratio(of_cylinder(part)))
        if value != 0 and not low <= abs(value) <= high:
            yield ImplausibleValue(path, f"{what} is {value:.3g}", f"{low:g} to {high:g}")
