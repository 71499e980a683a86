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
from ._read import selected_class, unwrapped
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
    places = part_places()
    kinds = [part for part in places if places[part].kind == word]
    sections = [part for part in places if places[part].holds(word)]
    parts = kinds or sections
    if not parts:
        raise SceneError(word, f"is no part of a machine file{_suggestion(word)}")
    return tuple(_explained(part, places[part]) for part in parts)


class Places(NamedTuple):
    """Where a part may stand: its kind, the headings, and the last words of their paths."""

    kind: str
    titles: tuple[str, ...]
    sections: frozenset[str]

    def holds(self, word: str) -> bool:
        """Whether a word names one of the sections, by its whole path or the last word of it."""
        paths = (title.strip("[]").lower() for title in self.titles)
        return word in self.sections or word in paths


@cache
def part_places() -> Mapping[type[Part], Places]:
    """Every part that a machine file can describe, in the order of the file."""
    titles_by_part: dict[type[Part], dict[str, str]] = {}
    for title, kind, part in every_place():
        titles_by_part.setdefault(part, {})[title] = kind
    places = {}
    for part, titles in titles_by_part.items():
        words = set()
        for title in titles:
            path = title.strip("[]").removesuffix(".NAME")
            words.add(path.rpartition(".")[2])
        kind = next(iter(titles.values()))
        places[part] = Places(kind, tuple(titles), frozenset(words))
    return places


def _suggestion(word: str) -> str:
    places = part_places()
    words: set[str] = set()
    holders = set()
    for part, where in places.items():
        words |= {where.kind, *where.sections}
        if word in entries(part):
            holders.add(where.kind)
    if holders:
        return f", but an entry of {', '.join(sorted(holders))}"
    near = nearest(word, words)
    if near:
        return f'; did you mean "{near}"?'
    return f"; known are {', '.join(sorted(words))}"


def _explained(part: type[Part], where: Places) -> Explained:
    descriptions = meanings(part)
    several = len(_kinds_under(where.titles[0])) > 1
    table = _from_machines().get(part, {})
    listed = []
    columns = []  # lists that the section needs, which may come from a file
    for name, entry in entries(part).items():
        default = ""
        unit = ""
        if isinstance(entry, Section):
            bound = " or ".join(choices(entry.classes))
            if entry.rows:
                bound = f"rows of {bound}"
            line = _section_example(entry, name, where)
        elif isinstance(entry, Number | Option):
            if not entry.required:
                default = default_text(part, name, entry).replace("...", "")
            bound = expected(entry)
            if isinstance(entry, Number):
                bound = str(entry.bound)
                unit = entry.unit
                if entry.required and entry.shape == (None,):
                    head = f"{name} [{unit}]" if unit else name
                    columns.append(head)
            line = f"{name} = {value_text(_example(part, name, entry, table.get(name)))}"
        else:
            continue
        listed.append(
            ExplainedEntry(
                name=name,
                unit=unit,
                bound=bound,
                required=entry.required,
                default=default,
                doc=descriptions[name],
                example=line,
            )
        )
    lines = [where.titles[0]]
    if several:
        lines.append(f'type = "{where.kind}"')
    lines += map(_example_line, sorted(listed, key=_order_in_section))
    if len(columns) > 1:
        lines.append(f'#csv = "table.csv" instead of the lists; its header: {",".join(columns)}')
    return Explained(
        kind=where.kind,
        summary=summary(part),
        places=where.titles,
        entries=tuple(listed),
        example="\n".join(lines),
    )


def _kinds_under(heading: str) -> set[str]:
    """The kinds of parts that may stand under a heading."""
    kinds = set()
    for title, kind, _ in every_place():
        if title == heading:
            kinds.add(kind)
    return kinds


def _order_in_section(entry: ExplainedEntry) -> tuple[bool, bool]:
    """Sort key: keys stand before sections, those that are needed before the others."""
    return entry.example.startswith("["), not entry.required


def _example_line(entry: ExplainedEntry) -> str:
    """The example of an entry, behind `#` where the section does not need it."""
    if entry.required:
        return entry.example
    return "#" + entry.example.replace("\n", "\n#")


def _section_example(entry: Section, name: str, where: Places) -> str:
    """A section inside with what it needs, or the name of a bearing where one may stand."""
    parts = choices(entry.classes)
    if NamedBearing in parts.values():
        value = '["NAME"]' if entry.rows else '"NAME"'
        return f"{name} = {value}"
    title = entry.title(join(where.titles[0].strip("[]"), name))
    # rather one that a machine has, of which the values are usual ones
    in_machines = [kind for kind, part in parts.items() if part in _from_machines()]
    kind = [*in_machines, *parts][0]
    inner = _explained(parts[kind], Places(kind, (title,), frozenset())).example
    lines = inner.splitlines()
    if not entry.required:
        lines = [line for line in lines if not line.startswith("#")]
    return "\n".join(lines)


@cache
def _from_machines() -> Mapping[type[Part], dict[str, Any]]:
    """Values of each part in the files to start from and in the bundled machines."""
    files = [*start_files().values(), *bundled("machines").values()]
    values_by_part: dict[type[Part], dict[str, Any]] = {}
    for file in files:
        for path, entry, table in given_sections(tomllib.loads(file.read_text("utf-8"))):
            _collect(table, entry, path, values_by_part)
    return values_by_part


def _collect(
    table: Any, entry: Section, path: str, values_by_part: dict[type[Part], dict[str, Any]]
):
    part = selected_class(table, entry.classes, path)
    table = part.written(table)
    values = values_by_part.setdefault(part, {})
    for name, inner in entries(part).items():
        written = table.get(name)
        if isinstance(inner, Section):
            for row in tables_under(table, name):
                _collect(row, inner, join(path, name), values_by_part)
        elif written is not None:
            value, unit, _ = unwrapped(written, name)
            if unit:
                value = {"value": value, "unit": unit}
            if len(value_text(value)) <= _LONGEST:
                values.setdefault(name, value)


def _example(part: type[Part], name: str, entry: Number | Option, machine_value: Any) -> Any:
    """A value of an entry: that of a machine, otherwise one that is usual and within its bound."""
    if machine_value is not None:
        return machine_value
    if isinstance(entry, Number):
        shape = []
        for length in entry.shape:
            any_length = length in (None, ...)
            shape.append(2 if any_length else length)
        by_name = _BY_NAME.get(f"{kind_of(part)}.{name}") or _BY_NAME.get(name)
        for usual in (by_name, _default_of(part, name, entry), _BY_UNIT.get(entry.unit)):
            if usual is not None and _may_stand(entry, usual, name):
                return np.full(shape, usual).tolist()
        return as_text(np.full(shape, _value_inside(entry)), entry.unit)
    return _option_example(entry.hint, name)


def _value_inside(entry: Number) -> float:
    """A number within the bound: 1 if that is, or the middle of a finite range."""
    low = entry.bound.low
    high = entry.bound.high
    if _inside(entry, 1.0):
        return 1.0
    if np.isfinite(low + high):
        return (low + high) / 2
    return max(low, min(high, 0.0)) + 1.0


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
    above = value > low if low_open else value >= low
    below = value < high if high_open else value <= high
    return bool(above & below)


def _option_example(hint: Any, name: str) -> Any:
    """A value of an option."""
    inner = get_args(hint)
    if get_origin(hint) is Literal:
        return inner[0]
    if get_origin(hint) is tuple:
        if inner[-1] is Ellipsis:
            inner = inner[:1] * 2
        return [_option_example(member, name) for member in inner]
    if inner:
        words = [member for member in inner if member is not type(None)]
        return _option_example(words[0], name)
    return {bool: True, int: 1, str: name.upper()}[hint]
