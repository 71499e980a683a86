"""One kind of part of a machine file at a time: where it may stand and what its section holds."""

import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any, Literal, NamedTuple, get_args, get_origin

import numpy as np

from .._fields import Part
from .._words import nearest
from ..compressor import Compressor
from ..film import NamedBearing
from ._annotate import default_text, start_files, summary, with_unit
from ._dump import value_text
from ._errors import SceneError
from ._read import chosen, is_value, unwrapped
from ._scene import NAMED, SECTIONS, imported
from ._schema import Entry, Number, Option, PartTable, SubPart, choices, entries, expected, meanings
from ._units import to_si

_LONGEST = 60  # characters of an example that is taken from a machine
# Values of examples, where no machine has one: a metre or a pascal would be unusual.
_USUAL = {"m": "10 mm", "m^2": "1 cm^2", "Pa": "5 bar", "K": "330 K", "rad/s": "1500 rpm"}


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
    found: dict[type[Part], tuple[str, list[str]]] = {}
    for title, kind, part in _every_place():
        titles = found.setdefault(part, (kind, []))[1]
        if title not in titles:
            titles.append(title)
    return {
        part: Places(kind, tuple(titles), frozenset(_section_word(title) for title in titles))
        for part, (kind, titles) in found.items()
    }


def _section_word(title: str) -> str:
    path = title.strip("[]").removesuffix(".NAME")
    return path.rpartition(".")[2]


def _every_place() -> Iterator[tuple[str, str, type[Part]]]:
    top: dict[str, Entry] = dict(entries(Compressor))
    top |= {name: SubPart((imported(part),), False, True) for name, part in SECTIONS.items()}
    top |= {f"{name}.NAME": SubPart((part,), False, True) for name, part in NAMED.items()}
    yield from _places_in(top, "", ())


def _places_in(known: Mapping[str, Entry], above: str, inside: tuple[type, ...]):
    for name, entry in known.items():
        if not isinstance(entry, SubPart | PartTable):
            continue
        path = f"{above}.{name}" if above else name
        title = f"[[{path}]]" if isinstance(entry, PartTable) else f"[{path}]"
        for kind, part in choices(entry.classes).items():
            if part is NamedBearing and path.endswith(".NAME"):
                continue  # a description is no name
            yield title, kind, part
            if part not in inside:
                yield from _places_in(entries(part), path, (*inside, part))


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
    several = len(_alternatives(where.titles[0])) > 1
    table = _from_machines().get(part, {})
    given = {
        name: _example(entry, table.get(name), name)
        for name, entry in entries(part).items()
        if isinstance(entry, Number | Option)
    }
    listed = []
    for name, entry in entries(part).items():
        default, unit = "", ""
        if isinstance(entry, SubPart | PartTable):
            bound, line = expected_section(entry), _section(entry, name, where)
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


def _section(entry: SubPart | PartTable, name: str, where: Places) -> str:
    """A section inside with what it needs, or the name of a bearing where one may stand."""
    known = choices(entry.classes)
    if NamedBearing in known.values():
        return f'{name} = ["NAME"]' if isinstance(entry, PartTable) else f'{name} = "NAME"'
    path = f"{where.titles[0].strip('[]')}.{name}"
    title = f"[[{path}]]" if isinstance(entry, PartTable) else f"[{path}]"
    # rather one that a machine has
    kind = next(
        (kind for kind, part in known.items() if part in _from_machines()), next(iter(known))
    )
    inner = _explained(known[kind], Places(kind, (title,), frozenset())).example
    lines = inner.splitlines()
    return "\n".join(line for line in lines if entry.required or not line.startswith("#"))


def expected_section(entry: SubPart | PartTable) -> str:
    """Which kinds of parts may stand in a section."""
    rows = "rows of " if isinstance(entry, PartTable) else ""
    return rows + " or ".join(choices(entry.classes))


@cache
def _alternatives(title: str) -> frozenset[str]:
    return frozenset(kind for other, kind, _ in _every_place() if other == title)


@cache
def _from_machines() -> Mapping[type[Part], dict[str, Any]]:
    """Values of each part in the files to start from and in the bundled machines."""
    files = [*start_files().values()]
    folder = resources.files("jaxcomp") / "machines"
    files += sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    top: dict[str, tuple[type, ...]] = {
        name: entry.classes
        for name, entry in entries(Compressor).items()
        if isinstance(entry, SubPart)
    }
    top |= {name: (imported(part),) for name, part in SECTIONS.items()}
    found: dict[type[Part], dict[str, Any]] = {}
    for file in files:
        document = tomllib.loads(file.read_text("utf-8"))
        for name, classes in top.items():
            _collect(document.get(name), classes, found)
        for name, part in NAMED.items():
            for table in document.get(name, {}).values():
                _collect(table, (part,), found)
    return found


def _collect(table: Any, classes: tuple[type, ...], found: dict[type[Part], dict[str, Any]]):
    if not isinstance(table, Mapping) or is_value(table):
        return
    part = chosen(table, classes, "")
    values = found.setdefault(part, {})
    for name, entry in entries(part).items():
        given = table.get(name)
        if isinstance(entry, SubPart | PartTable):
            for row in given if isinstance(given, list) else [given]:
                _collect(row, entry.classes, found)
        elif given is not None:
            value, unit, _ = unwrapped(given, name)
            value = {"value": value, "unit": unit} if unit else value
            if len(value_text(value)) <= _LONGEST:
                values.setdefault(name, value)


def _example(entry: Number | Option, given: Any, name: str) -> Any:
    """A value of an entry: of a machine that has one, otherwise one within its bound."""
    if given is not None:
        return given
    if isinstance(entry, Number):
        shape = tuple(2 if n in (None, ...) else n for n in entry.shape)
        usual = _USUAL.get(entry.unit)
        if usual is not None and _inside(entry, to_si(usual, entry.unit, name)):
            return np.full(shape, usual).tolist()
        low, high = entry.bound.low, entry.bound.high
        inside = (low + high) / 2 if np.isfinite(low + high) else max(low, min(high, 0.0)) + 1.0
        value = 1.0 if _inside(entry, 1.0) else inside
        return with_unit(np.full(shape, value), entry.unit)
    return _word(entry.hint, name)


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
