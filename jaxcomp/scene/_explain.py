"""What a kind of part may say in a machine file, read off the declarations of the parts."""

import tomllib
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, NamedTuple, get_args, get_origin

import numpy as np

from .._core.fields import Part
from .._core.words import nearest
from ..film import NamedBearing
from ._annotated import default_text, start_files, summary, tables_under
from ._read import chosen, unwrapped
from ._schema import (
    Number,
    Option,
    Section,
    choices,
    entries,
    every_place,
    expected,
    given_sections,
    join,
    kind_of,
    meanings,
)
from ._text import SceneError, bundled, value_text
from ._units import as_text, to_si

_LONGEST = 60  # characters of an example that is taken from a machine
# Values of examples, where no machine has one: a metre or a pascal would be unusual.
_BY_NAME = {
    "roughness": "0.3 um", "thin_film": "2 um", "taper": "10 um", "radial_clearance": "20 um",
    "axial_clearance": "50 um", "transition_speed": "10 mm/s", "transition_rate": "1 rpm",
    "sticking_speed": "0.1 m/s", "dynamic_viscosity": "10 mPa s", "outer_radius": "20 mm",
    "inner_radius": "12 mm", "bending_stiffness": "2 kN m^2", "stop": "2 mm", "preload": "0.2 mm",
    "lift_table": "1 mm", "gas_constant": "287 J/(kg K)", "neck_length": "40 mm", "offset": "2 mm",
    "arm": "100 mm", "slope": "5 N m s", "level": "20 N m", "eccentricity": "50 %",
    "rod_diameter": "20 mm", "seat_diameter": "14 mm", "thickness": "0.2 mm", "width": "5 mm",
    "seat_width": "1 mm", "port_distance": "15 mm", "coefficient": 0.1, "modulus": "115 GPa",
    "elastic_modulus": "193 GPa", "oil_film.viscosity": "10 mPa s", "oil_film.thickness": "20 um",
    "mixed.length": "60 mm", "mixed.width": "40 mm", "reed_beam.damping": "0.1 N s/m",
}  # fmt: skip
_BY_UNIT = {
    "m": "10 mm", "m^2": "1 cm^2", "m^3": "100 cm^3", "Pa": "5 bar", "K": "330 K",
    "rad/s": "1500 rpm", "kg": "0.2 kg", "kg m": "200 g mm", "kg m^2": "2e-3 kg m^2", "N": "200 N",
    "N m": "5 N m", "N/m": "1e7 N/m", "N s/m": "100 N s/m", "Pa s": "2e-5 Pa s",
    "W/(m K)": "0.02 W/(m K)", "kg/m^3": "7800 kg/m^3", "W/K": "1 W/K",
}  # fmt: skip


class ExplainedEntry(NamedTuple):
    """An entry of a section.

    Attributes:
        name: its key.
        unit: SI unit, empty for a pure number or for what is no quantity.
        bound: what it must be.
        required: whether the section needs it.
        default: as it would be typed; empty if it is required, or absent where it is left out.
        doc: what it is.
        example: line as typed in a file.
    """

    name: str
    unit: str
    bound: str
    required: bool
    default: str
    doc: str
    example: str


class Explained(NamedTuple):
    """A kind of part.

    Attributes:
        kind: the word that selects it.
        summary: what it is.
        places: headings of the sections that may hold it.
        entries: what its section may hold.
        example: a section of it as typed in a file; lines behind `#` are optional.
    """

    kind: str
    summary: str
    places: tuple[str, ...]
    entries: tuple[ExplainedEntry, ...]
    example: str


def explained(word: str) -> tuple[Explained, ...]:
    """The parts that a word stands for: a kind, or a section, which holds one of several kinds.

    Args:
        word: such as `kloss`, `slider-crank` or `suction_valve`.

    Raises:
        SceneError: an unknown word, with those that are near.
    """
    word = word.strip().strip("[]").replace("-", "_").lower()
    known = part_places()
    kinds = [part for part in known if known[part].kind == word]
    sections = [
        part
        for part, where in known.items()
        if word in where.sections
        or any(word == title.strip("[]").lower() for title in where.titles)
    ]
    parts = kinds or sections
    if not parts:
        raise SceneError(word, f"is no part of a machine file{_near(word)}")
    return tuple(_explained(part, known[part]) for part in parts)


class Places(NamedTuple):
    """Where a part may stand: its kind, the headings, and the last words of their paths."""

    kind: str
    titles: tuple[str, ...]
    sections: frozenset[str]


@cache
def part_places() -> Mapping[type[Part], Places]:
    """Every part that a machine file can describe, in the order of the file."""
    found: dict[type[Part], dict[str, str]] = {}
    for title, kind, part in every_place():
        found.setdefault(part, {})[title] = kind
    places = {}
    for part, titles in found.items():
        paths = (title.strip("[]").removesuffix(".NAME") for title in titles)
        words = frozenset(path.rpartition(".")[2] for path in paths)
        places[part] = Places(next(iter(titles.values())), tuple(titles), words)
    return places


def _near(word: str) -> str:
    known = part_places()
    words = {where.kind for where in known.values()}
    words |= {section for where in known.values() for section in where.sections}
    holders = sorted({where.kind for part, where in known.items() if word in entries(part)})
    if holders:
        return f", but an entry of {', '.join(holders)}"
    near = nearest(word, words)
    return f'; did you mean "{near}"?' if near else f"; known are {', '.join(sorted(words))}"


def _explained(part: type[Part], where: Places) -> Explained:
    told = meanings(part)
    several = len({kind for title, kind, _ in every_place() if title == where.titles[0]}) > 1
    table = _from_machines().get(part, {})
    given = {
        name: _example(part, name, entry, table.get(name))
        for name, entry in entries(part).items()
        if isinstance(entry, Number | Option)
    }
    listed = []
    for name, entry in entries(part).items():
        default = ""
        unit = ""
        if isinstance(entry, Section):
            bound = ("rows of " if entry.rows else "") + " or ".join(choices(entry.classes))
            line = _section_example(entry, name, where)
        elif isinstance(entry, Number | Option):
            default = "" if entry.required else default_text(part, name, entry).replace("...", "")
            bound = expected(entry) if isinstance(entry, Option) else str(entry.bound)
            unit = getattr(entry, "unit", "")
            line = f"{name} = {value_text(given[name])}"
        else:
            continue
        listed.append(ExplainedEntry(name, unit, bound, entry.required, default, told[name], line))
    kind = [f'type = "{where.kind}"'] if several else []
    # keys stand before sections, those that are needed before the others
    ordered = sorted(listed, key=lambda one: (one.example.startswith("["), not one.required))
    lines = [
        one.example if one.required else "#" + one.example.replace("\n", "\n#") for one in ordered
    ]
    columns = [
        f"{name} [{entry.unit}]" if entry.unit else name
        for name, entry in entries(part).items()
        if isinstance(entry, Number) and entry.shape == (None,) and entry.required
    ]
    if len(columns) > 1:
        lines.append(f'#csv = "table.csv" instead of the lists; its header: {",".join(columns)}')
    text = "\n".join([where.titles[0], *kind, *lines])
    return Explained(where.kind, summary(part), where.titles, tuple(listed), text)


def _section_example(entry: Section, name: str, where: Places) -> str:
    """A section inside with what it needs, or the name of a bearing where one may stand."""
    known = choices(entry.classes)
    if NamedBearing in known.values():
        return f'{name} = ["NAME"]' if entry.rows else f'{name} = "NAME"'
    title = entry.title(join(where.titles[0].strip("[]"), name))
    # rather one that a machine has
    kind = next((one for one, part in known.items() if part in _from_machines()), next(iter(known)))
    inner = _explained(known[kind], Places(kind, (title,), frozenset())).example
    lines = inner.splitlines()
    return "\n".join(line for line in lines if entry.required or not line.startswith("#"))


@cache
def _from_machines() -> Mapping[type[Part], dict[str, Any]]:
    """Values of each part in the files to start from and in the bundled machines."""
    files = [*start_files().values(), *bundled("machines").values()]
    found: dict[type[Part], dict[str, Any]] = {}
    for file in files:
        for path, entry, table in given_sections(tomllib.loads(file.read_text("utf-8"))):
            _collect(table, entry, path, found)
    return found


def _collect(table: Any, entry: Section, path: str, found: dict[type[Part], dict[str, Any]]):
    part = chosen(table, entry.classes, path)
    table = part.written(table)
    values = found.setdefault(part, {})
    for name, inner in entries(part).items():
        given = table.get(name)
        if isinstance(inner, Section):
            for row in tables_under(table, name):
                _collect(row, inner, join(path, name), found)
        elif given is not None:
            value, unit, _ = unwrapped(given, name)
            value = {"value": value, "unit": unit} if unit else value
            if len(value_text(value)) <= _LONGEST:
                values.setdefault(name, value)


def _example(part: type[Part], name: str, entry: Number | Option, given: Any) -> Any:
    """A value of an entry: that of a machine, otherwise one that is usual and within its bound."""
    if given is not None:
        return given
    if isinstance(entry, Number):
        shape = tuple(2 if n in (None, ...) else n for n in entry.shape)
        by_name = _BY_NAME.get(f"{kind_of(part)}.{name}") or _BY_NAME.get(name)
        for usual in (by_name, _default_of(part, name, entry), _BY_UNIT.get(entry.unit)):
            if usual is not None and _may_stand(entry, usual, name):
                return np.full(shape, usual).tolist()
        low = entry.bound.low
        high = entry.bound.high
        inside = (low + high) / 2 if np.isfinite(low + high) else max(low, min(high, 0.0)) + 1.0
        value = 1.0 if _inside(entry, 1.0) else inside
        return as_text(np.full(shape, value), entry.unit)
    return _word(entry.hint, name)


def _default_of(part: type[Part], name: str, entry: Number | Option) -> Any:
    """The default of a number, as far as it says what is usual; `None` for a zero and for lists."""
    if not isinstance(entry, Number) or entry.required or entry.shape:
        return None
    text = default_text(part, name, entry).strip('"')
    try:
        value = float(to_si(text, entry.unit, name))
        if value == 0:
            return None
        return text if entry.unit else value
    except (SceneError, TypeError):  # absent, or no single number
        return None


def _may_stand(entry: Number, usual: Any, name: str) -> bool:
    """Whether a number or text is a value of an entry: of its dimension, within its bound."""
    try:
        return _inside(entry, to_si(usual, entry.unit, name))
    except SceneError:  # the same name with another dimension
        return False


def _inside(entry: Number, value: Any) -> bool:
    """`Bound.holds` without JAX, which would compile something for it."""
    low, high, low_open, high_open = entry.bound
    return bool(
        (value > low if low_open else value >= low) & (value < high if high_open else value <= high)
    )


def _word(hint: Any, name: str) -> Any:
    """A value of an option."""
    inner = get_args(hint)
    if get_origin(hint) is Literal:
        return inner[0]
    if get_origin(hint) is tuple:
        inner = inner[:1] * 2 if inner[-1] is Ellipsis else inner
        return [_word(one, name) for one in inner]
    if inner:
        return _word(next(one for one in inner if one is not type(None)), name)
    return {bool: True, int: 1, str: name.upper()}[hint]
