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
_COMBINED = {
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
        matches = [entry for entry in self.entries if entry.key == key]
        self.entries = [entry for entry in self.entries if entry.key != key]
        return matches


def old_paths(document: Mapping[str, Any]) -> list[str]:
    """Paths of the entries of tables that are of an older spelling."""
    candidates = list(MOVED)
    for section, keys in _COMBINED.items():
        candidates += [f"{section}.{key}" for key in keys]
    paths = []
    for path in candidates:
        with suppress(LookupError):
            at(document, path)
            paths.append(path)
    return paths + list(_orbit_types(document, ""))


def _orbit_types(node: Any, path: str) -> Iterator[str]:
    """Paths of the types of bearings that are of the older spelling."""
    if isinstance(node, list):
        for entry in node:
            yield from _orbit_types(entry, path)
    elif isinstance(node, Mapping):
        for key, value in node.items():
            inner_path = f"{path}.{key}".lstrip(".")
            if key == "type" and value == "orbit":
                yield inner_path
            yield from _orbit_types(value, inner_path)


def check_spelling(document: Mapping[str, Any], file: str) -> None:
    """That no entry of tables is of an older spelling.

    Raises:
        SceneError: one is; the message names today's, and the command that rewrites a file.
    """
    for path in old_paths(document):
        new = upgraded_path(path)
        today = f", today {new}" if new != path else ", today in [crankshaft]"
        if path.endswith(".type"):
            today = ', today "film" with motion = "orbit"'
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
    by_name = {section.name: section for section in sections if not section.row}
    mechanism = by_name.get("mechanism", _Section())
    friction = by_name.get("friction", _Section())
    shaft = by_name.get("cylinders", _Section(above=["\n"], name="crankshaft"))
    support = by_name.get("friction.main_journal", _Section(above=["\n"]))
    moved = _crankshaft_entries(document, mechanism, friction, shaft, support)
    shaft.entries = moved + shaft.entries
    # a source of the whole section goes along
    if shaft not in sections and moved:
        _take_source(mechanism, shaft)
    _take_source(friction, support)
    _move_bearings(document, by_name, friction, support)
    _place(sections, shaft, support)
    for section in sections:
        section.name = upgraded_path(section.name)
    rewritten = "".join(_joined(section) for section in sections)
    if old_paths(tomllib.loads(rewritten)):
        raise ValueError(
            "an old entry stands in an inline table or under a dotted key; write it out"
        )
    return rewritten


def _crankshaft_entries(
    document: Mapping[str, Any],
    mechanism: _Section,
    friction: _Section,
    shaft: _Section,
    support: _Section,
) -> list[_Entry]:
    """Entries of the crankshaft that leave the mechanism, the friction and the main journal."""
    for key in ("unbalance", "couple"):
        shaft.entries += _with_key(shaft.take(key), f"shaft_{key}")
    moved: list[_Entry] = []
    for old, new in MOVED.items():
        section, _, key = old.rpartition(".")
        if section == "mechanism":
            moved += _with_key(mechanism.take(key), new.rpartition(".")[2])
    mass = _with_key(support.take("shaft_mass"), "mass")
    if not any(entry.key == "mass" for entry in moved):
        moved += mass
    return moved + _combined_entries(document, mechanism) + friction.take("main_journal")


def _take_source(old: _Section, new: _Section) -> None:
    """Copy the source of a whole section to another one that has none."""
    source = [entry for entry in old.entries if entry.key == "source"]
    if source and not any(entry.key == "source" for entry in new.entries):
        new.entries.insert(0, _Entry("source", source[0].lines[-1:]))


def _move_bearings(
    document: Mapping[str, Any],
    by_name: Mapping[str, _Section],
    friction: _Section,
    support: _Section,
) -> None:
    """Make upper and lower bearing of a slider-link machine those of the main bearings."""
    names = [name for name in _COMBINED["friction"] if name in document.get("friction", {})]
    if not names:
        return
    rows = [by_name[f"friction.{name}"] for name in names if f"friction.{name}" in by_name]
    for name in names:
        for entry in friction.take(name):
            support.above += entry.lines[:-1]
    support.entries += _support(document, names, rows)
    for row in rows:
        row.name = "crankshaft.main_journal.bearings"
        row.row = True


def _place(sections: list[_Section], shaft: _Section, support: _Section) -> None:
    """Put the sections of crankshaft and main bearings among the others, where they are new."""
    if shaft not in sections and shaft.entries:
        sections.insert(_after(sections, "mechanism"), shaft)
    if support not in sections and {entry.key for entry in support.entries} - {"source"}:
        support.name = "friction.main_journal"
        names = [section.name for section in sections]
        bearings = "crankshaft.main_journal.bearings"
        if bearings in names:
            sections.insert(names.index(bearings), support)
        else:
            sections.insert(_after(sections, "crankshaft"), support)


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
            entry_lines = [line]
            while not _is_complete("".join(entry_lines)):
                entry_lines.append(next(lines))
            sections[-1].entries.append(_Entry(key[1], waiting + entry_lines))
            waiting = []
        else:
            waiting.append(line)
    sections.append(_Section(above=waiting))
    return sections


def _is_complete(text: str) -> bool:
    """Whether an entry ends here, and not within a list or text over several lines."""
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _joined(section: _Section) -> str:
    lines = list(section.above)
    if section.name:
        title = f"[[{section.name}]]" if section.row else f"[{section.name}]"
        if section.note:
            title = f"{title}  {section.note}"
        lines.append(f"{title}\n")
    for entry in section.entries:
        lines += entry.lines
    return "".join(lines)


def _with_key(entries: list[_Entry], key: str) -> list[_Entry]:
    for entry in entries:
        for number, line in enumerate(entry.lines):
            if _KEY.match(line) and line.lstrip().startswith(entry.key):
                entry.lines[number] = line.replace(entry.key, key, 1)
                break
        entry.key = key
    return entries


def _after(sections: list[_Section], name: str) -> int:
    """Behind a section and the sections below it."""
    places = [i for i, section in enumerate(sections) if f"{section.name}.".startswith(f"{name}.")]
    return max(places, default=0) + 1


def _combined_entries(document: Mapping[str, Any], mechanism: _Section) -> list[_Entry]:
    """Entries of the crankshaft that follow from several numbers of a slider-link or slider-crank."""
    table = document.get("mechanism", {})
    ahead = _number(table, "crank_unbalance_across", "kg m")
    product = _number(table, "crank_product", "kg m^2")
    product_across = _number(table, "crank_product_across", "kg m^2")
    eccentricity = _number(table, "crank_eccentricity", "m")
    mass = _number(table, "crank_mass", "kg")
    notes = []
    for key in ("crank_eccentricity", "crank_product", *_COMBINED["mechanism"]):
        for entry in mechanism.take(key):
            notes += entry.lines[:-1]
    rows = []
    if eccentricity:
        rows.append(("unbalance", -(mass or 0.0) * eccentricity, "kg m", "crank_eccentricity"))
    if ahead:
        rows.append(("shaft_unbalance", [0.0, ahead], "kg m", "crank_unbalance_across"))
    if product or product_across:
        source = "crank_product" if product else "crank_product_across"
        couple = [product or 0.0, product_across or 0.0]
        rows.append(("shaft_couple", couple, "kg m^2", source))
    combined = [_entry(key, value, unit, _source(table, old)) for key, value, unit, old in rows]
    if combined:
        combined[0].lines = notes + combined[0].lines
    return combined


def _support(document: Mapping[str, Any], names: list[str], rows: list) -> list[_Entry]:
    """The main bearings of a slider-link machine from its upper and lower bearing."""
    friction = document["friction"]
    mechanism = document.get("mechanism", {})
    bearing_entries = [_Entry("type", ['type = "main_bearings"\n'])]
    if not rows:
        laws = [_value(friction[name]) for name in names]
        bearing_entries.append(_Entry("bearings", [f"bearings = {value_text(laws)}\n"]))
    elif len(rows) < len(names):
        raise ValueError("one of friction.upper_bearing and friction.lower_bearing is a name only")
    else:
        bearing_entries.append(_Entry("names", [f"names = {value_text(names)}\n"]))
    upper = _number(mechanism, "overhang", "m")
    span = _number(mechanism, "bearing_span", "m")
    if upper is not None and span is not None:
        places = [upper, upper + span][: len(names)]
        bearing_entries.append(_entry("position", places, "m", _source(mechanism, "overhang")))
    return bearing_entries


def _number(table: Mapping[str, Any], key: str, unit: str) -> float | None:
    if key not in table:
        return None
    return float(to_si(_value(table[key]), unit, key))


def _value(entry: Any) -> Any:
    """The value of an entry, which may have a source."""
    return entry["value"] if isinstance(entry, Mapping) else entry


def _source(table: Mapping[str, Any], key: str) -> str:
    value = table.get(key)
    return value.get("source", "") if isinstance(value, Mapping) else ""


def _entry(key: str, value: float | list[float], unit: str, source: str) -> _Entry:
    if isinstance(value, list):
        shown: Any = [f"{number:.10g} {unit}" for number in value]
    else:
        shown = f"{value:.10g} {unit}"
    if source:
        shown = {"value": shown, "source": source}
    return _Entry(key, [f"{key} = {value_text(shown)}\n"])
