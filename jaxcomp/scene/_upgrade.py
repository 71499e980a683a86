"""Machine files of older spellings, rewritten with their comments, sources and order.

Until version 0.2 the crankshaft had no section of its own: its numbers stood in [mechanism], [cylinders]
and [friction]. A bearing whose journal moves had a type of its own, "orbit".
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from .._core.fields import at
from ._text import SceneError, value_text
from ._units import to_si

# Sections and keys that moved as they are; a header's sections move with it.
MOVED = {
    "cylinders": "crankshaft",
    "friction.main_journal": "crankshaft.main_journal",
    "friction.thrust_bearing": "crankshaft.main_journal.thrust_bearing",
    "friction.pump": "crankshaft.main_journal.pump",
    "mechanism.crank_inertia": "crankshaft.inertia",
    "mechanism.crank_mass": "crankshaft.mass",
    "mechanism.crank_unbalance": "crankshaft.unbalance",
    "mechanism.crank_couple": "crankshaft.shaft_couple",
    "mechanism.crank_centre_depth": "crankshaft.mass_centre",
    "mechanism.plane_height": "crankshaft.origin",
    "cylinders.unbalance": "crankshaft.shaft_unbalance",
    "cylinders.couple": "crankshaft.shaft_couple",
    "friction.main_journal.shaft_mass": "crankshaft.mass",
}
# Those whose numbers make others.
_MADE = {
    "mechanism": (
        "crank_eccentricity",
        "crank_unbalance_across",
        "crank_product",
        "crank_product_across",
        "overhang",
        "bearing_span",
    ),
    "friction": ("upper_bearing", "lower_bearing"),
}
_ORBIT = re.compile(r'(\btype\s*=\s*)"orbit"')
_HEADER = re.compile(r"\s*(\[\[?)\s*([^\]#]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"\s*([A-Za-z0-9_-]+)\s*=")


@dataclass
class _Entry:
    """A key with its value, and the comments above it, as they were written."""

    key: str
    lines: list[str]


@dataclass
class _Section:
    """A header with what stands above and below it."""

    above: list[str] = field(default_factory=list)
    row: bool = False
    name: str = ""
    note: str = ""
    entries: list[_Entry] = field(default_factory=list)

    def take(self, key: str) -> list[_Entry]:
        """The entry of a key, which leaves the section; empty where there is none."""
        found = [one for one in self.entries if one.key == key]
        self.entries = [one for one in self.entries if one.key != key]
        return found


def old_paths(document: Mapping[str, Any]) -> list[str]:
    """Paths of the entries of tables that are of an older spelling."""
    made = (f"{section}.{key}" for section, keys in _MADE.items() for key in keys)
    found = []
    for path in (*MOVED, *made):
        with suppress(LookupError):
            at(document, path)
            found.append(path)
    return found + list(_moving(document, ""))


def _moving(node: Any, path: str) -> Iterator[str]:
    """Paths of the types of bearings that are of the older spelling."""
    if isinstance(node, list):
        for entry in node:
            yield from _moving(entry, path)
    elif isinstance(node, Mapping):
        for key, value in node.items():
            here = f"{path}.{key}".lstrip(".")
            if key == "type" and value == "orbit":
                yield here
            yield from _moving(value, here)


def check_spelling(document: Mapping[str, Any], file: str) -> None:
    """That no entry of tables is of an older spelling.

    Raises:
        SceneError: one is; the message names today's, and the command that rewrites a file.
    """
    for path in old_paths(document):
        new = upgraded_path(path)
        today = f", today {new}" if new != path else ", today in [crankshaft]"
        today = ', today "film" with motion = "orbit"' if path.endswith(".type") else today
        raise SceneError(
            path,
            f"is of an older spelling{today}; `jaxcomp upgrade {file or 'FILE'}` rewrites a file "
            "with its comments and sources",
        )


def upgraded(text: str) -> str:
    """The text of a machine file in today's spelling; itself where it has it already.

    Args:
        text: TOML as a user wrote it.

    Raises:
        tomllib.TOMLDecodeError: a text that is no TOML.
        ValueError: an old entry in a place that cannot be rewritten, such as an inline table.
    """
    if not old_paths(tomllib.loads(text)):
        return text
    text = re.sub(rf"(?m)^(\s*){_ORBIT.pattern}", r'\1\2"film"\n\1motion = "orbit"', text)
    text = _ORBIT.sub(r'\1"film", motion = "orbit"', text)
    document = tomllib.loads(text)
    sections = _split(text)
    by_name = {one.name: one for one in sections if not one.row}
    mechanism = by_name.get("mechanism", _Section())
    friction = by_name.get("friction", _Section())
    shaft = by_name.get("cylinders", _Section(above=["\n"], name="crankshaft"))
    support = by_name.get("friction.main_journal", _Section(above=["\n"]))
    first = _crankshaft_entries(document, mechanism, friction, shaft, support)
    shaft.entries = first + shaft.entries
    # a source of the whole section goes along
    if shaft not in sections and first:
        _take_source(mechanism, shaft)
    _take_source(friction, support)
    _move_bearings(document, by_name, friction, support)
    _place(sections, shaft, support)
    for one in sections:
        one.name = upgraded_path(one.name)
    made = "".join(_joined(one) for one in sections)
    if old_paths(tomllib.loads(made)):
        raise ValueError(
            "an old entry stands in an inline table or under a dotted key; write it out"
        )
    return made


def _crankshaft_entries(
    document: Mapping[str, Any],
    mechanism: _Section,
    friction: _Section,
    shaft: _Section,
    support: _Section,
) -> list[_Entry]:
    """Entries of the crankshaft that leave the mechanism, the friction and the main journal."""
    for key in ("unbalance", "couple"):
        shaft.entries += _renamed(shaft.take(key), f"shaft_{key}")
    first: list[_Entry] = []
    for old, new in MOVED.items():
        section, _, key = old.rpartition(".")
        if section == "mechanism":
            first += _renamed(mechanism.take(key), new.rpartition(".")[2])
    mass = _renamed(support.take("shaft_mass"), "mass")
    if not any(one.key == "mass" for one in first):
        first += mass
    return first + _made(document, mechanism) + friction.take("main_journal")


def _take_source(old: _Section, new: _Section) -> None:
    """Copy the source of a whole section to another one that has none."""
    source = [one for one in old.entries if one.key == "source"]
    if source and not any(one.key == "source" for one in new.entries):
        new.entries.insert(0, _Entry("source", source[0].lines[-1:]))


def _move_bearings(
    document: Mapping[str, Any],
    by_name: Mapping[str, _Section],
    friction: _Section,
    support: _Section,
) -> None:
    """Make upper and lower bearing of a slider-link machine those of the main bearings."""
    names = [name for name in _MADE["friction"] if name in document.get("friction", {})]
    if not names:
        return
    rows = [by_name[f"friction.{name}"] for name in names if f"friction.{name}" in by_name]
    taken = [friction.take(name) for name in names]
    support.entries += _support(document, names, rows)
    support.above += [line for (one,) in filter(None, taken) for line in one.lines[:-1]]
    for row in rows:
        row.name = "crankshaft.main_journal.bearings"
        row.row = True


def _place(sections: list[_Section], shaft: _Section, support: _Section) -> None:
    """Put the sections of crankshaft and main bearings among the others, where they are new."""
    if shaft not in sections and shaft.entries:
        sections.insert(_after(sections, "mechanism"), shaft)
    if support not in sections and {one.key for one in support.entries} - {"source"}:
        support.name = "friction.main_journal"
        rows = [
            i for i, one in enumerate(sections) if one.name == "crankshaft.main_journal.bearings"
        ]
        place = rows[0] if rows else _after(sections, "crankshaft")
        sections.insert(place, support)


def upgraded_path(path: str) -> str:
    """Today's path of a number that was named by an old one."""
    for old, new in sorted(MOVED.items(), key=lambda pair: -len(pair[0])):
        if path == old or path.startswith(f"{old}."):
            return new + path[len(old) :]
    return path


def _split(text: str) -> list[_Section]:
    sections = [_Section()]
    waiting = []
    lines = iter(text.splitlines(keepends=True))
    for line in lines:
        header = _HEADER.match(line)
        key = _KEY.match(line)
        if header:
            sections.append(_Section(waiting, header[1] == "[[", header[2], header[3] or ""))
            waiting = []
        elif key:
            own = [line]
            while not _whole("".join(own)):
                own.append(next(lines))
            sections[-1].entries.append(_Entry(key[1], waiting + own))
            waiting = []
        else:
            waiting.append(line)
    sections.append(_Section(above=waiting))
    return sections


def _whole(text: str) -> bool:
    """Whether an entry ends here, and not within a list or text over several lines."""
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _joined(section: _Section) -> str:
    lines = list(section.above)
    if section.name:
        ends = ("[[", "]]") if section.row else ("[", "]")
        note = f"  {section.note}" if section.note else ""
        lines.append(f"{ends[0]}{section.name}{ends[1]}{note}\n")
    return "".join(lines + [line for one in section.entries for line in one.lines])


def _renamed(entries: list[_Entry], key: str) -> list[_Entry]:
    for one in entries:
        for number, line in enumerate(one.lines):
            if _KEY.match(line) and line.lstrip().startswith(one.key):
                one.lines[number] = line.replace(one.key, key, 1)
                break
        one.key = key
    return entries


def _after(sections: list[_Section], name: str) -> int:
    """Behind a section and the sections below it."""
    places = [i for i, one in enumerate(sections) if f"{one.name}.".startswith(f"{name}.")]
    return max(places, default=0) + 1


def _made(document: Mapping[str, Any], mechanism: _Section) -> list[_Entry]:
    """Entries of the crankshaft that follow from several numbers of a slider-link or slider-crank."""
    given = document.get("mechanism", {})
    ahead, product, tilted = (
        _number(given, key, unit)
        for key, unit in (
            ("crank_unbalance_across", "kg m"),
            ("crank_product", "kg m^2"),
            ("crank_product_across", "kg m^2"),
        )
    )
    notes = []
    for key in ("crank_eccentricity", "crank_product", *_MADE["mechanism"]):
        notes += [line for one in mechanism.take(key) for line in one.lines[:-1]]
    eccentricity, mass = (
        _number(given, key, unit)
        for key, unit in (("crank_eccentricity", "m"), ("crank_mass", "kg"))
    )
    rows = []
    if eccentricity:
        rows.append(("unbalance", -(mass or 0.0) * eccentricity, "kg m", "crank_eccentricity"))
    if ahead:
        rows.append(("shaft_unbalance", [0.0, ahead], "kg m", "crank_unbalance_across"))
    if product or tilted:
        source = "crank_product" if product else "crank_product_across"
        rows.append(("shaft_couple", [product or 0.0, tilted or 0.0], "kg m^2", source))
    made = [_entry(key, value, unit, _source(given, old)) for key, value, unit, old in rows]
    if made:
        made[0].lines = notes + made[0].lines
    return made


def _support(document: Mapping[str, Any], names: list[str], rows: list) -> list[_Entry]:
    """The main bearings of a slider-link machine from its upper and lower bearing."""
    friction = document["friction"]
    given = document.get("mechanism", {})
    made = [_Entry("type", ['type = "main_bearings"\n'])]
    if not rows:
        laws = [friction[name] for name in names]
        laws = [law["value"] if isinstance(law, Mapping) else law for law in laws]
        made.append(_Entry("bearings", [f"bearings = {value_text(laws)}\n"]))
    elif len(rows) < len(names):
        raise ValueError("one of friction.upper_bearing and friction.lower_bearing is a name only")
    else:
        made.append(_Entry("names", [f"names = {value_text(names)}\n"]))
    upper, span = (_number(given, key, "m") for key in ("overhang", "bearing_span"))
    if upper is not None and span is not None:
        places = [upper, upper + span][: len(names)]
        made.append(_entry("position", places, "m", _source(given, "overhang")))
    return made


def _number(given: Mapping[str, Any], key: str, unit: str) -> float | None:
    if key not in given:
        return None
    value = given[key]
    value = value["value"] if isinstance(value, Mapping) else value
    return float(to_si(value, unit, key))


def _source(given: Mapping[str, Any], key: str) -> str:
    value = given.get(key)
    return value.get("source", "") if isinstance(value, Mapping) else ""


def _entry(key: str, value: float | list[float], unit: str, source: str) -> _Entry:
    texts = [f"{one:.10g} {unit}" for one in (value if isinstance(value, list) else [value])]
    shown: Any = texts if isinstance(value, list) else texts[0]
    shown = {"value": shown, "source": source} if source else shown
    return _Entry(key, [f"{key} = {value_text(shown)}\n"])
