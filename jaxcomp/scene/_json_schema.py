"""The JSON schema of machine files, with which editors complete and check them.

It is read off the declarations of the parts, as the checks of a file are, and says less than those:
the dimension of a unit, bounds of numbers with a unit beyond their sign, and rules across entries are
left to `load`. Draft 7, which editors of TOML know.
"""

from collections.abc import Mapping
from typing import Any, Literal, get_args, get_origin

import numpy as np

from .._core.display import is_temperature
from .._core.fields import Part
from ..compressor import Compressor
from ..film import NamedBearing
from ._annotated import meaning, summary
from ._cells import KEY
from ._scene import HEADER
from ._schema import NAMED, Entry, Number, Option, Section, choices, entries, meanings, top_sections
from ._text import NUMBER

_TEXT = {"type": "string"}
_PERCENT = rf"^\s*{NUMBER}\s*%?\s*$"
_GRADE = r"|^\s*(ISO[\s-]*)?VG\b.*$"
_SIMPLE = {bool: "boolean", int: "integer", str: "string"}


def json_schema() -> dict[str, Any]:
    """The JSON schema of a machine file; that of laws of other packages is a part of it.

    Raises:
        ExtensionError: a module of another package that cannot be imported.
    """
    parts: dict[str, Any] = {}
    crank_drive = entries(Compressor)
    needed = _required_keys(Compressor)

    properties: dict[str, Any] = dict.fromkeys(HEADER, _TEXT)
    properties |= _properties(Compressor, parts)
    alternatives = []
    for name, section in top_sections().items():
        if name not in crank_drive:
            properties[name] = _entry(section, name, parts)
            alternatives.append({"required": [name]})
    alternatives.append({"required": needed})
    for name, part in NAMED.items():
        row = _section((part,), parts, named=False)
        properties[name] = _object({"source": _TEXT}, additionalProperties=row)
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "A machine for jaxcomp",
        **_object(properties),
        "anyOf": alternatives,
        "definitions": parts,
    }


def _required_keys(part: type[Part]) -> list[str]:
    """Keys that a section needs."""
    keys = []
    for key, entry in entries(part).items():
        if entry.required:
            keys.append(key)
    return keys


def _object(properties: Mapping[str, Any], **keywords: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "additionalProperties": False} | keywords


def _properties(part: type[Part], parts: dict[str, Any]) -> dict[str, Any]:
    """Schema of each key of a section, with its meaning."""
    descriptions = meanings(part)
    properties = {}
    for name, entry in entries(part).items():
        if isinstance(entry, Number | Option):
            words = meaning(entry, descriptions[name])
            properties[name] = _entry(entry, name, parts) | {"description": words}
            if isinstance(entry, Number) and name in part.tables_by_name:
                numbers = {
                    "type": "object",
                    "additionalProperties": _any(_number(entry, name, False)),
                }
                properties[name]["anyOf"].append(numbers | {"minProperties": 1})
        elif isinstance(entry, Section):
            properties[name] = _entry(entry, name, parts)
    return properties


def _entry(entry: Entry, name: str, parts: dict[str, Any]) -> dict[str, Any]:
    if isinstance(entry, Section):
        section = _section(entry.classes, parts)
        if entry.rows:
            return {"type": "array", "items": section}
        return section
    if isinstance(entry, Number):
        alone = _shaped(entry, _number(entry, name, unit_given=False))
        in_table = _shaped(entry, _number(entry, name, unit_given=True))
        table = {"value": _any(in_table), "unit": _TEXT, "source": _TEXT}
        return {"anyOf": [*alone, _object(table, required=["value"])]}
    assert isinstance(entry, Option)
    word = _option(entry.hint)
    table = _object({"value": word, "source": _TEXT}, required=["value"])
    return {"anyOf": [word, table]}


def _any(alternatives: list[Any]) -> dict[str, Any]:
    if len(alternatives) == 1:
        return alternatives[0]
    return {"anyOf": alternatives}


def _number(entry: Number, name: str, unit_given: bool) -> list[Any]:
    """A single number: bare where it needs no unit, or its table has one, and as a text."""
    low, high, low_open, high_open = entry.bound
    level = is_temperature(name, entry.unit)
    if not entry.unit:
        number: dict[str, Any] = {"type": "number"}
        if np.isfinite(low):
            lower_end = "exclusiveMinimum" if low_open else "minimum"
            number[lower_end] = low
        if np.isfinite(high):
            upper_end = "exclusiveMaximum" if high_open else "maximum"
            number[upper_end] = high
        return [number, {"type": "string", "pattern": _PERCENT}]
    unsigned = NUMBER
    # -10 degC is a temperature above 0 K
    if low >= 0 and not level:
        unsigned = NUMBER.removeprefix("[+-]?")
    pattern = rf"^\s*\+?{unsigned}\s*[^\d\s,].*$"
    if entry.unit == "Pa s":
        pattern += _GRADE
    text = {"type": "string", "pattern": pattern}
    if unit_given:
        return [{"type": "number"}, text]
    return [text]


def _shaped(entry: Number, single: list[Any]) -> list[Any]:
    """A number or the lists that may stand for it."""
    number = _any(single)
    shape = entry.shape
    if shape == (...,):
        return [*single, {"type": "array"}]
    rows = number
    for length in reversed(shape):
        rows = {"type": "array", "items": rows}
        if length is not None:
            rows |= {"minItems": length, "maxItems": length}
    out = [*single]
    if shape:
        out = [rows]
        if entry.spread:
            out.append(number)
    if entry.each:
        out.append({"type": "array", "items": number})
    return out


def _option(hint: Any) -> dict[str, Any]:
    inner = get_args(hint)
    if get_origin(hint) is Literal:
        return {"enum": list(inner)}
    if get_origin(hint) is tuple and inner[-1] is Ellipsis:
        return {"type": "array", "items": _option(inner[0])}
    if get_origin(hint) is tuple:
        return {
            "type": "array",
            "items": [_option(member) for member in inner],
            "minItems": len(inner),
        }
    if inner:
        return {"anyOf": [_option(member) for member in inner]}
    if hint is type(None):
        return {"const": "none"}
    return {"type": _SIMPLE[hint]}


def _section(classes: tuple[type, ...], parts: dict[str, Any], named: bool = True) -> Any:
    """A section of one of several kinds, or the name of a bearing where one may stand."""
    every_kind = choices(classes)
    several = len(every_kind) > 1
    references: list[Any] = []
    for kind, part in every_kind.items():
        if named or part is not NamedBearing:
            references.append(_part(part, kind, several, parts))
    if named and NamedBearing in every_kind.values():
        references.append(_TEXT)
    return {"oneOf": references}


def _part(part: type[Part], kind: str, several: bool, parts: dict[str, Any]) -> dict[str, str]:
    """A reference to the definition of a class of parts, which is added where it is missing."""
    name = part.__name__
    if not several:
        name += ".only"
    if name not in parts:
        parts[name] = {}  # a part may stand inside itself
        properties = {"type": {"const": kind}, "source": _TEXT, **_properties(part, parts)}
        required = ["type"] if several else []
        columns = []
        for key in _required_keys(part):
            entry = entries(part)[key]
            if isinstance(entry, Number) and entry.shape[:1] == (None,):
                columns.append(key)
            else:
                required.append(key)
        keywords: dict[str, Any] = {"required": required, "description": summary(part)}
        if columns:  # which may come from a file
            keywords["anyOf"] = [{"required": columns}, {"required": [KEY]}]
            properties[KEY] = _TEXT
        parts[name] = _object(properties, **keywords)
    return {"$ref": f"#/definitions/{name}"}
