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
from ._read import chosen, is_value, unwrapped
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
    files = start_files()
    return {
        kind: tomllib.loads(one.read_text("utf-8"))["description"] for kind, one in files.items()
    }


def start_files() -> dict[str, Any]:
    found = bundled("scene", "starts")
    return {"slider-crank": found.pop("slider-crank"), **found}


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
        for row in tables_under(table, name):
            lines += _section_lines(row, inner, here, told)
        if comments and name not in table:
            lines += ["", *_comment(f"Optional {inner.title(here)}: {_choices(inner.classes)}")]
    return lines


def tables_under(table: Mapping[str, Any], name: str) -> list[Any]:
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
        if isinstance(entry, Section) and name in table and not tables_under(table, name):
            lines.append(f"{key_text(name)} = {value_text(table[name])}")
    for name, entry in known.items():
        if name not in table and comments and (isinstance(entry, Number) or not only_numbers):
            text = f"#{key_text(name)} = {default_text(part, name, entry)}"
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


def default_text(part: type[Part], name: str, entry: Entry) -> str:
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
