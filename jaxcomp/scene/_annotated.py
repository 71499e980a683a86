"""Machine files to start from, with comments on every entry that they have or could have.

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
from typing import Any, get_args, get_origin

import numpy as np

from .._core.fields import Part
from ..compressor import Compressor
from ._read import is_value, selected_class, unwrapped
from ._scene import Scene
from ._schema import (
    Entry,
    Number,
    Option,
    Section,
    choices,
    entries,
    expected,
    given_sections,
    join,
    kind_of,
    meanings,
    top_sections,
)
from ._text import bundled, is_section, key_text, value_text
from ._units import as_text, in_celsius

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
    descriptions = {}
    for kind, file in start_files().items():
        descriptions[kind] = tomllib.loads(file.read_text("utf-8"))["description"]
    return descriptions


def start_files() -> dict[str, Any]:
    """Files of the machines to start from by kind; the usual one, a slider-crank, comes first."""
    files = bundled("scene", "starts")
    return {"slider-crank": files.pop("slider-crank"), **files}


def start(kind: str, name: str) -> str:
    """The text of a machine file to start from, one of `starts`.

    Args:
        kind: key of `starts`.
        name: name of the new machine.
    """
    text = start_files()[kind].read_text("utf-8")
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
    head: dict[str, Any] = {}
    tables: dict[str, Any] = {}
    for key, entry in scene.document.items():
        content = _without_sources(entry, key)
        if is_section(entry):
            tables[key] = content
        else:
            head[key] = content
    head["name"] = name
    head["description"] = f"Started from {scene.name}"
    head["source"] = f"value of {scene.name}, to be replaced"
    return annotated(head | tables)


def _without_sources(entry: Any, path: str) -> Any:
    """An entry without sources, with temperatures in degrees Celsius."""
    if isinstance(entry, Mapping) and "value" not in entry:
        entries = {}
        for key, child in entry.items():
            if key != "source":
                entries[key] = _without_sources(child, join(path, key))
        return entries
    if isinstance(entry, list) and any(isinstance(child, Mapping) for child in entry):
        return [_without_sources(child, f"{path}.{at}") for at, child in enumerate(entry)]
    value, unit, _ = unwrapped(entry, path)
    return in_celsius(_with_unit(value, unit), path)


def _with_unit(value: Any, unit: str | None) -> Any:
    if isinstance(value, list):
        return [_with_unit(item, unit) for item in value]
    return f"{value} {unit}" if unit else value


def annotated(document: Mapping[str, Any], *remarks: str) -> str:
    """TOML of the tables of a valid scene, with comments on every entry they have or could have.

    Args:
        document: the tables.
        remarks: comments for its head.
    """
    lines = [*_comment(*_HOW, *filter(None, remarks)), ""]
    for key, entry in document.items():
        if isinstance(entry, str):
            lines.append(f"{key} = {value_text(entry)}")
    explained: set[type] = set()
    if any(key in entries(Compressor) for key in document):
        lines += _keys(document, Compressor, only_numbers=True)
    for path, entry, table in given_sections(document):
        lines += _section_lines(table, entry, path, explained)
    absent = []
    for name, section in top_sections().items():
        if name not in document:
            absent.append(f"[{name}]: {_kinds_of(section.classes)}")
    if absent:
        lines += ["", "# Other sections that a file may have:", *_comment(*absent)]
    return "\n".join(lines) + "\n"


def _section_lines(table, entry: Section, path: str, explained: set[type]) -> list[str]:
    """The lines of a section and of those inside it; adds to the classes that are explained."""
    part = selected_class(table, entry.classes, path)
    comments = part not in explained
    explained.add(part)
    lines = [""]
    if comments:
        lines += _comment(summary(part))
        alternatives = dict(choices(entry.classes))
        alternatives.pop(kind_of(part), None)
        if alternatives:
            lines += _comment(f"Other types: {_kinds_in_words(alternatives)}")
    lines.append(entry.title(path))
    for key in ("type", "source"):
        if key in table:
            lines.append(f"{key} = {value_text(table[key])}")
    lines += _keys(table, part, comments=comments)
    for name, inner in entries(part).items():
        if not isinstance(inner, Section):
            continue
        inner_path = join(path, name)
        for row in tables_under(table, name):
            lines += _section_lines(row, inner, inner_path, explained)
        if comments and name not in table:
            lines += [
                "",
                *_comment(f"Optional {inner.title(inner_path)}: {_kinds_of(inner.classes)}"),
            ]
    return lines


def tables_under(table: Mapping[str, Any], name: str) -> list[Any]:
    """The sections under a key; none where names of bearings stand there."""
    entry = table.get(name, [])
    rows = entry if isinstance(entry, list) else [entry]
    return [row for row in rows if not is_value(row)]


def _keys(table, part: type[Part], comments=True, only_numbers=False) -> list[str]:
    """The values of a section, then its optional ones that are not given."""
    value_entries = {}
    for name, entry in entries(part).items():
        if isinstance(entry, Number | Option):
            value_entries[name] = entry
    descriptions = meanings(part)
    lines = []
    for name, entry in value_entries.items():
        if name in table:
            text = f"{key_text(name)} = {value_text(table[name])}"
            if comments:
                lines += _with_comment(text, meaning(entry, descriptions[name]))
            else:
                lines.append(text)
    for name, entry in entries(part).items():
        if isinstance(entry, Section) and name in table and not tables_under(table, name):
            lines.append(f"{key_text(name)} = {value_text(table[name])}")
    for name, entry in value_entries.items():
        if name not in table and comments and (isinstance(entry, Number) or not only_numbers):
            text = f"#{key_text(name)} = {default_text(part, name, entry)}"
            lines += _with_comment(text, meaning(entry, descriptions[name]))
    return lines


def meaning(entry: Entry, description: str) -> str:
    """The comment on an entry: what it must be, and the description of its declaration."""
    example = ""
    if isinstance(entry, Option):
        example = _nodes_example(entry.hint)
    if example and description:
        return f"{example}: {description}"
    text = expected(entry)
    if getattr(entry, "doc", "") or not description:
        return text
    if description.startswith('"'):  # a list of words says it all
        return description
    return f"{text}, {description}"


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
    if inner[-1] is Ellipsis:  # of any length: two show that
        inner = inner[:1] * 2
    shown = [_nodes(member, at) for at, member in enumerate(inner, first)]
    if not all(shown):
        return ""
    return f"[{', '.join(shown)}]"


def default_text(part: type[Part], name: str, entry: Entry) -> str:
    """The default of an entry as it is typed, `...` where there is none."""
    defaults = {field.name: field.default for field in dataclasses.fields(part)}
    value = defaults[name]
    if value is None:
        return "..."
    if isinstance(entry, Number):
        value = as_text(np.asarray(value, float), entry.unit)
    if isinstance(value, tuple):
        value = list(value)
    return value_text(value)


def _with_comment(text: str, comment: str) -> list[str]:
    """A line with its comment, which stands above it where it does not fit behind."""
    line = f"{text.ljust(_COLUMN)} # {comment}"
    if len(line) <= _WIDTH:
        return [line]
    return [*_comment(comment), text]


def _comment(*texts: str) -> list[str]:
    lines = []
    for text in texts:
        # a word that is broken could not be searched for, nor a path be copied
        lines += textwrap.wrap(text, _WIDTH - 2, break_long_words=False, break_on_hyphens=False)
    return [f"# {line}" for line in lines]


def _kinds_of(classes: Iterable[type]) -> str:
    parts = choices(tuple(classes))
    if len(parts) == 1:
        return summary(*parts.values())
    return _kinds_in_words(parts)


def _kinds_in_words(parts: Mapping[str, type]) -> str:
    return "; ".join(f"{kind}: {summary(part)}" for kind, part in parts.items())


def summary(part: type) -> str:
    """The first line of a class's documentation, without formulas."""
    line = (inspect.getdoc(part) or "").partition("\n")[0]
    return re.sub(r",?\s*\$[^$]*\$", "", line).rstrip(".")
