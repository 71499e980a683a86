"""What a scene file may say, in words: files to start from, and one kind of part at a time.

All is read off the declarations of the parts, as the checks of a file are, so that the two cannot
differ. A line of a file to start from that begins with `#` and a key, without a space, is an optional
entry with its default: taking the `#` away changes nothing.
"""

import dataclasses
import inspect
import re
import textwrap
import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Literal, NamedTuple, get_args, get_origin

import numpy as np

from .._core.fields import Part
from .._core.words import nearest
from ..compressor import Compressor
from ..film import NamedBearing
from ._read import chosen, is_value, unwrapped
from ._scene import Scene
from ._schema import (
    Entry,
    Number,
    Option,
    Section,
    choices,
    entries,
    every_place,
    expected,
    given_sections,
    join,
    meanings,
    top_sections,
)
from ._text import SceneError, bundled, is_section, key_text, value_text
from ._units import as_text, in_celsius, to_si

_LONGEST = 60  # characters of an example that is taken from a machine
# Values of examples, where no machine has one: a metre or a pascal would be unusual.
_USUAL = {"m": "10 mm", "m^2": "1 cm^2", "Pa": "5 bar", "K": "330 K", "rad/s": "1500 rpm"}
_WIDTH = 100
_COLUMN = 38  # of the comments behind values
_HOW = (
    "A machine for jaxcomp; `jaxcomp check` reads this file and tells all that is wrong with it.",
    'A value is a number, a text with any unit of the dimension in brackets ("50 mm", "1.5 in"), a '
    'list of them, or a table with its source: { value = "50 mm", source = "drawing 17" }.',
    'Lists may come from a file beside this one, csv = "table.csv", with names and units in its header: '
    "angle [deg],cylinder_pressure [bar].",
    "An editor completes and checks this file with `#:schema ./jaxcomp.schema.json` in its first line, "
    "once `jaxcomp schema jaxcomp.schema.json` has written that file beside it.",
    "A key right behind # is optional and has this default; ... stands where there is none. What "
    "appears more than once is explained where it comes first.",
)


def starts() -> dict[str, str]:
    """The machines to start from: kind and what it is."""
    files = _start_files()
    return {
        kind: tomllib.loads(one.read_text("utf-8"))["description"] for kind, one in files.items()
    }


def _start_files() -> dict[str, Any]:
    found = bundled("scene", "starts")
    return {"slider-crank": found.pop("slider-crank"), **found}


def start(kind: str, name: str) -> str:
    """The text of a scene file to start from, one of `starts`.

    Args:
        kind: key of `starts`.
        name: name of the new machine.
    """
    text = _start_files()[kind].read_text("utf-8")
    remarks = " ".join(re.findall(r"\A(?:#.*\n)*", text)[0].replace("\n# ", " ").split()).lstrip(
        "# "
    )
    return annotated({"name": name, **tomllib.loads(text)}, remarks)


def start_from(scene: Scene, name: str) -> str:
    """The text of a machine file to start from, with the numbers of a machine and none of its sources.

    Temperatures are in degrees Celsius.

    Args:
        scene: of `jaxcomp.load`.
        name: name of the new machine.
    """
    tables = {key: one for key, one in scene.document.items() if is_section(one)}
    head = {key: one for key, one in scene.document.items() if key not in tables}
    head |= {
        "name": name,
        "description": f"Started from {scene.name}",
        "source": f"value of {scene.name}, to be replaced",
    }
    return annotated({key: _bare(one, key) for key, one in (head | tables).items()})


def _bare(entry: Any, path: str) -> Any:
    """An entry without sources, with temperatures in degrees Celsius."""
    if isinstance(entry, Mapping) and "value" not in entry:
        return {key: _bare(one, join(path, key)) for key, one in entry.items() if key != "source"}
    if isinstance(entry, list) and any(isinstance(one, Mapping) for one in entry):
        return [_bare(one, f"{path}.{at}") for at, one in enumerate(entry)]
    value, unit, _ = unwrapped(entry, path)
    return in_celsius(_with_unit(value, unit), path)


def _with_unit(value: Any, unit: str | None) -> Any:
    if isinstance(value, list):
        return [_with_unit(one, unit) for one in value]
    return f"{value} {unit}" if unit else value


def annotated(document: Mapping[str, Any], *remarks: str) -> str:
    """TOML of the tables of a valid scene, with comments on every entry they have or could have.

    Args:
        document: the tables.
        remarks: comments for its head.
    """
    lines = [*_comment(*_HOW, *filter(None, remarks)), ""]
    lines += [f"{key} = {value_text(one)}" for key, one in document.items() if isinstance(one, str)]
    told: set[type] = set()
    if any(key in entries(Compressor) for key in document):
        lines += _keys(document, Compressor, only_numbers=True)
    for path, entry, table in given_sections(document):
        lines += _section_lines(table, entry, path, told)
    absent = {name: entry for name, entry in top_sections().items() if name not in document}
    if absent:
        lines += ["", "# Other sections that a file may have:"]
        lines += _comment(*(f"[{name}]: {_choices(one.classes)}" for name, one in absent.items()))
    return "\n".join(lines) + "\n"


def _section_lines(table, entry: Section, path: str, told: set[type]) -> list[str]:
    """The lines of a section and of those inside it; adds to the classes that are explained."""
    part = chosen(table, entry.classes, path)
    comments = part not in told
    told.add(part)
    lines = [""]
    if comments:
        others = {kind: one for kind, one in choices(entry.classes).items() if one is not part}
        lines += _comment(summary(part))
        lines += _comment(f"Other types: {_listed(others)}") if others else []
    lines.append(entry.title(path))
    lines += [f"{key} = {value_text(table[key])}" for key in ("type", "source") if key in table]
    lines += _keys(table, part, comments=comments)
    for name, inner in entries(part).items():
        if not isinstance(inner, Section):
            continue
        here = join(path, name)
        for row in _tables(table, name):
            lines += _section_lines(row, inner, here, told)
        if comments and name not in table:
            lines += ["", *_comment(f"Optional {inner.title(here)}: {_choices(inner.classes)}")]
    return lines


def _tables(table: Mapping[str, Any], name: str) -> list[Any]:
    """The sections under a key; none where names of bearings stand there."""
    given = table.get(name, [])
    return [row for row in (given if isinstance(given, list) else [given]) if not is_value(row)]


def _keys(table, part: type[Part], comments=True, only_numbers=False) -> list[str]:
    """The values of a section, then its optional ones that are not given."""
    known = {n: e for n, e in entries(part).items() if isinstance(e, Number | Option)}
    told = meanings(part)
    lines = []
    for name, entry in known.items():
        if name in table:
            text = f"{key_text(name)} = {value_text(table[name])}"
            lines += _beside(text, meaning(entry, told[name])) if comments else [text]
    for name, entry in entries(part).items():
        if isinstance(entry, Section) and name in table and not _tables(table, name):
            lines.append(f"{key_text(name)} = {value_text(table[name])}")
    for name, entry in known.items():
        if name not in table and comments and (isinstance(entry, Number) or not only_numbers):
            text = f"#{key_text(name)} = {_default_text(part, name, entry)}"
            lines += _beside(text, meaning(entry, told[name]))
    return lines


def meaning(entry: Entry, told: str) -> str:
    example = _nodes_example(entry.hint) if isinstance(entry, Option) else ""
    if example and told:
        return f"{example}: {told}"
    text = expected(entry)
    if getattr(entry, "doc", "") or not told:
        return text
    return told if told.startswith('"') else f"{text}, {told}"  # a list of words says it all


def _nodes_example(hint: Any) -> str:
    """Names or numbers of nodes as they may stand in a file, such as `[1, 2]`; empty for all else."""
    alternatives = [_nodes(member) for member in (hint, *get_args(hint))]
    if int in get_args(hint) and str in get_args(hint):
        return '1 or "name"'
    if get_origin(hint) is tuple:
        return alternatives[0]
    return " or ".join(filter(None, alternatives))


def _nodes(hint: Any, first: int = 1) -> str:
    """A list of nodes, or one; empty for what holds none."""
    if int in get_args(hint) and str in get_args(hint):
        return str(first)
    if get_origin(hint) is not tuple:
        return ""
    inner = get_args(hint)
    inner = inner[:1] * 2 if inner[-1] is Ellipsis else inner
    shown = [_nodes(one, at) for at, one in enumerate(inner, first)]
    return f"[{', '.join(shown)}]" if all(shown) else ""


def _default_text(part: type[Part], name: str, entry: Entry) -> str:
    """The default of an entry as it is typed, `...` where there is none."""
    value = next(f.default for f in dataclasses.fields(part) if f.name == name)
    if value is None:
        return "..."
    if isinstance(entry, Number):
        value = as_text(np.asarray(value, float), entry.unit)
    return value_text(list(value) if isinstance(value, tuple) else value)


def _beside(text: str, comment: str) -> list[str]:
    """A line with its comment, which stands above it where it does not fit behind."""
    line = f"{text.ljust(_COLUMN)} # {comment}"
    return [line] if len(line) <= _WIDTH else [*_comment(comment), text]


def _comment(*texts: str) -> list[str]:
    return [
        f"# {line}"
        for text in texts
        for line in textwrap.wrap(text, _WIDTH - 2, break_long_words=False, break_on_hyphens=False)
    ]


def _choices(classes: Iterable[type]) -> str:
    known = choices(tuple(classes))
    if len(known) == 1:
        return summary(*known.values())
    return _listed(known)


def _listed(known: Mapping[str, type]) -> str:
    return "; ".join(f"{kind}: {summary(part)}" for kind, part in known.items())


def summary(part: type) -> str:
    """The first line of a class's documentation, without formulas."""
    line = (inspect.getdoc(part) or "").partition("\n")[0]
    return re.sub(r",?\s*\$[^$]*\$", "", line).rstrip(".")


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
        name: _example(entry, table.get(name), name)
        for name, entry in entries(part).items()
        if isinstance(entry, Number | Option)
    }
    listed = []
    for name, entry in entries(part).items():
        default, unit = "", ""
        if isinstance(entry, Section):
            bound = ("rows of " if entry.rows else "") + " or ".join(choices(entry.classes))
            line = _section_example(entry, name, where)
        elif isinstance(entry, Number | Option):
            default = "" if entry.required else _default_text(part, name, entry).replace("...", "")
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
    files = [*_start_files().values(), *bundled("machines").values()]
    found: dict[type[Part], dict[str, Any]] = {}
    for file in files:
        for path, entry, table in given_sections(tomllib.loads(file.read_text("utf-8"))):
            _collect(table, entry, path, found)
    return found


def _collect(table: Any, entry: Section, path: str, found: dict[type[Part], dict[str, Any]]):
    part = chosen(table, entry.classes, path)
    values = found.setdefault(part, {})
    for name, inner in entries(part).items():
        given = table.get(name)
        if isinstance(inner, Section):
            for row in _tables(table, name):
                _collect(row, inner, join(path, name), found)
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
        return as_text(np.full(shape, value), entry.unit)
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
