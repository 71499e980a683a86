"""Scene files to start from, with what every entry means written beside it.

The comments are read off the declarations of the parts, as the checks of a file are, so that the two
cannot differ. A line that begins with `#` and a key, without a space, is an optional entry with its
default: taking the `#` away changes nothing.
"""

import dataclasses
import inspect
import re
import textwrap
import tomllib
import typing
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

import numpy as np

from .._fields import Part
from ..compressor import Compressor
from ._dump import key_text, value_text
from ._read import chosen, is_value
from ._scene import NAMED, SECTIONS, imported
from ._schema import Entry, Number, Option, PartTable, SubPart, choices, entries, expected, meanings
from ._units import as_text

_WIDTH = 100
_COLUMN = 38  # of the comments behind values
_HOW = (
    "A machine for jaxcomp; `jaxcomp check` reads this file and tells all that is wrong with it.",
    'A value is a number, a text with any unit of the dimension in brackets ("50 mm", "1.5 in"), a '
    'list of them, or a table with its source: { value = "50 mm", source = "drawing 17" }.',
    'Lists may come from a file beside this one, csv = "table.csv", with names and units in its header: '
    "angle [deg],cylinder_pressure [bar].",
    "A key right behind # is optional and has this default; ... stands where there is none. What "
    "appears more than once is explained where it comes first.",
)


def starts() -> dict[str, str]:
    """The machines to start from: kind and what it is."""
    return {
        kind: tomllib.loads(file.read_text("utf-8"))["description"]
        for kind, file in start_files().items()
    }


def start(kind: str, name: str) -> str:
    """The text of a scene file to start from, one of `starts`.

    Args:
        kind: key of `starts`.
        name: name of the new machine.
    """
    document = tomllib.loads(start_files()[kind].read_text("utf-8"))
    return annotated({"name": name, **document})


def annotated(document: Mapping[str, Any]) -> str:
    """TOML of the tables of a valid scene, with comments on every entry they have or could have."""
    header = [f"{key} = {value_text(document[key])}" for key in document if _is_text(document[key])]
    lines = [*_comment(*_HOW), "", *header]
    told: set[type] = set()
    parts: dict[str, SubPart] = {
        name: entry for name, entry in entries(Compressor).items() if isinstance(entry, SubPart)
    }
    parts |= {name: SubPart((imported(part),), False, True) for name, part in SECTIONS.items()}
    if any(key in entries(Compressor) for key in document):
        lines += _keys(document, Compressor, only_numbers=True)
    for name, entry in parts.items():
        if name in document:
            lines += _section(document[name], entry.classes, name, f"[{name}]", told)
    for section, part in NAMED.items():
        for name, table in document.get(section, {}).items():
            path = f"{section}.{name}"
            lines += _section(table, (part,), path, f"[{path}]", told)
    absent = {name: entry for name, entry in parts.items() if name not in document}
    if absent:
        lines += ["", "# Other sections that a file may have:"]
        lines += _comment(
            *(f"[{name}]: {_choices(entry.classes)}" for name, entry in absent.items())
        )
    return "\n".join(lines) + "\n"


def _section(table, classes, path: str, title: str, told: set[type]) -> list[str]:
    """The lines of a section and of those inside it; adds to the classes that are explained."""
    part = chosen(table, classes, path)
    comments = part not in told
    told.add(part)
    lines = [""]
    if comments:
        others = {kind: other for kind, other in choices(classes).items() if other is not part}
        lines += _comment(summary(part))
        lines += _comment(f"Other types: {_listed(others)}") if others else []
    lines.append(title)
    lines += [f"{key} = {value_text(table[key])}" for key in ("type", "source") if key in table]
    lines += _keys(table, part, comments=comments)
    for name, entry in entries(part).items():
        here = f"{path}.{name}"
        if isinstance(entry, SubPart) and name in table and not is_value(table[name]):
            lines += _section(table[name], entry.classes, here, f"[{here}]", told)
        elif isinstance(entry, PartTable):
            for row in (row for row in table.get(name, ()) if not is_value(row)):
                lines += _section(row, entry.classes, here, f"[[{here}]]", told)
        if comments and isinstance(entry, SubPart | PartTable) and name not in table:
            brackets = f"[[{here}]]" if isinstance(entry, PartTable) else f"[{here}]"
            lines += ["", *_comment(f"Optional {brackets}: {_choices(entry.classes)}")]
    return lines


def _keys(table, part: type[Part], comments=True, only_numbers=False) -> list[str]:
    """The values of a section, then its optional ones that are not given."""
    known = {n: e for n, e in entries(part).items() if isinstance(e, Number | Option)}
    told = meanings(part)
    lines = []
    for name, entry in known.items():
        if name in table:
            text = f"{key_text(name)} = {value_text(table[name])}"
            lines += _beside(text, _meaning(entry, told[name])) if comments else [text]
    for name, entry in entries(part).items():
        if isinstance(entry, SubPart | PartTable) and name in table and _is_name(table[name]):
            lines.append(f"{key_text(name)} = {value_text(table[name])}")
    for name, entry in known.items():
        if name not in table and comments and (isinstance(entry, Number) or not only_numbers):
            text = f"#{key_text(name)} = {default_text(part, name, entry)}"
            lines += _beside(text, _meaning(entry, told[name]))
    return lines


def _meaning(entry: Entry, told: str) -> str:
    example = _example(entry.hint) if isinstance(entry, Option) else ""
    if example and told:
        return f"{example}: {told}"
    text = expected(entry)
    if getattr(entry, "doc", "") or not told:
        return text
    return told if told.startswith('"') else f"{text}, {told}"  # a list of words says it all


def _example(hint: Any) -> str:
    """Names or numbers of nodes as they may stand in a file, such as `[1, 2]`; empty for all else."""
    alternatives = [_nodes(member) for member in (hint, *typing.get_args(hint))]
    if int in typing.get_args(hint) and str in typing.get_args(hint):
        return '1 or "name"'
    if typing.get_origin(hint) is tuple:
        return alternatives[0]
    return " or ".join(filter(None, alternatives))


def _nodes(hint: Any, first: int = 1) -> str:
    """A list of nodes, or one; empty for what holds none."""
    if int in typing.get_args(hint) and str in typing.get_args(hint):
        return str(first)
    if typing.get_origin(hint) is not tuple:
        return ""
    inner = typing.get_args(hint)
    inner = inner[:1] * 2 if inner[-1] is Ellipsis else inner
    shown = [_nodes(one, at) for at, one in enumerate(inner, first)]
    return f"[{', '.join(shown)}]" if all(shown) else ""


def default_text(part: type[Part], name: str, entry: Entry) -> str:
    """The default of an entry as it is typed, `...` where there is none."""
    value = next(f.default for f in dataclasses.fields(part) if f.name == name)
    if value is None:
        return "..."
    if isinstance(entry, Number):
        value = with_unit(np.asarray(value, float), entry.unit)
    return value_text(list(value) if isinstance(value, tuple) else value)


def with_unit(value: np.ndarray, unit: str) -> Any:
    """Numbers in SI units as texts with their unit, in lists where there are several."""
    if value.ndim == 0:
        return as_text(float(value), unit)
    return [with_unit(item, unit) for item in value]


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


def _is_name(given: Any) -> bool:
    """Whether the name of a bearing, or a list of such names, stands for a section."""
    return all(map(is_value, given)) if isinstance(given, list) else is_value(given)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def start_files() -> dict[str, Any]:
    """The files of the machines to start from, by kind."""
    folder = resources.files("jaxcomp.scene") / "starts"
    found = {f.name[:-5]: f for f in folder.iterdir() if f.name.endswith(".toml")}
    return dict(sorted(found.items(), key=lambda item: item[0] != "slider-crank"))
