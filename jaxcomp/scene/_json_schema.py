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
    own = entries(Compressor)
    needed = [name for name, entry in own.items() if getattr(entry, "required", False)]
    others = [name for name in top_sections() if name not in own]
    properties: dict[str, Any] = {name: _TEXT for name in HEADER}
    properties |= _properties(Compressor, parts)
    properties |= {name: _entry(top_sections()[name], name, parts) for name in others}
    for name, part in NAMED.items():
        row = _section((part,), parts, named=False)
        properties[name] = _object({"source": _TEXT}, additionalProperties=row)
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "A machine for jaxcomp",
        **_object(properties),
        "anyOf": [{"required": [name]} for name in others] + [{"required": needed}],
        "definitions": parts,
    }


def _object(properties: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "additionalProperties": False} | more


def _properties(part: type[Part], parts: dict[str, Any]) -> dict[str, Any]:
    """Schema of each key of a section, with its meaning."""
    told = meanings(part)
    found = {}
    for name, entry in entries(part).items():
        if isinstance(entry, Number | Option):
            words = meaning(entry, told[name])
            found[name] = _entry(entry, name, parts) | {"description": words}
            if isinstance(entry, Number) and name in part.tables_by_name:
                numbers = {
                    "type": "object",
                    "additionalProperties": _any(_number(entry, name, False)),
                }
                found[name]["anyOf"].append(numbers | {"minProperties": 1})
        elif isinstance(entry, Section):
            found[name] = _entry(entry, name, parts)
    return found


def _entry(entry: Entry, name: str, parts: dict[str, Any]) -> dict[str, Any]:
    if isinstance(entry, Section):
        one = _section(entry.classes, parts)
        return {"type": "array", "items": one} if entry.rows else one
    if isinstance(entry, Number):
        bare, beside = (_shaped(entry, _number(entry, name, given)) for given in (False, True))
        table = {"value": _any(beside), "unit": _TEXT, "source": _TEXT}
        return {"anyOf": [*bare, _object(table, required=["value"])]}
    assert isinstance(entry, Option)
    word = _word(entry.hint)
    table = _object({"value": word, "source": _TEXT}, required=["value"])
    return {"anyOf": [word, table]}


def _any(alternatives: list[Any]) -> dict[str, Any]:
    return alternatives[0] if len(alternatives) == 1 else {"anyOf": alternatives}


def _number(entry: Number, name: str, unit_given: bool) -> list[Any]:
    """A single number: bare where it needs no unit, or its table has one, and as a text."""
    low, high, low_open, high_open = entry.bound
    level = is_temperature(name, entry.unit)
    sign = NUMBER.removeprefix("[+-]?") if low >= 0 and not level else NUMBER
    text = rf"^\s*\+?{sign}\s*[^\d\s,].*$" + (_GRADE if entry.unit == "Pa s" else "")
    if not entry.unit:
        ends = [("exclusiveMinimum" if low_open else "minimum", low)]
        ends += [("exclusiveMaximum" if high_open else "maximum", high)]
        number = {"type": "number"} | {end: x for end, x in ends if np.isfinite(x)}
        return [number, {"type": "string", "pattern": _PERCENT}]
    texts = [{"type": "string", "pattern": text}]
    return [{"type": "number"}, *texts] if unit_given else texts


def _shaped(entry: Number, single: list[Any]) -> list[Any]:
    """A number or the lists that may stand for it."""
    one = _any(single)
    shape = entry.shape
    if shape == (...,):
        return [*single, {"type": "array"}]
    rows = one
    for length in reversed(shape):
        rows = {"type": "array", "items": rows}
        rows |= {} if length is None else {"minItems": length, "maxItems": length}
    out = [rows] if shape else [*single]
    out += [one] if shape and entry.spread else []
    return [*out, {"type": "array", "items": one}] if entry.each else out


def _word(hint: Any) -> dict[str, Any]:
    inner = get_args(hint)
    if get_origin(hint) is Literal:
        return {"enum": list(inner)}
    if get_origin(hint) is tuple and inner[-1] is Ellipsis:
        return {"type": "array", "items": _word(inner[0])}
    if get_origin(hint) is tuple:
        return {"type": "array", "items": [_word(one) for one in inner], "minItems": len(inner)}
    if inner:
        return {"anyOf": [_word(one) for one in inner]}
    return {"const": "none"} if hint is type(None) else {"type": _SIMPLE[hint]}


def _section(classes: tuple[type, ...], parts: dict[str, Any], named: bool = True) -> Any:
    """A section of one of several kinds, or the name of a bearing where one may stand."""
    known = choices(classes)
    kinds = {kind: part for kind, part in known.items() if named or part is not NamedBearing}
    found = [_part(part, kind, len(known) > 1, parts) for kind, part in kinds.items()]
    return {"oneOf": found + ([_TEXT] if NamedBearing in kinds.values() else [])}


def _part(part: type[Part], kind: str, several: bool, parts: dict[str, Any]) -> dict[str, str]:
    """A reference to the definition of a class of parts, which is added where it is missing."""
    name = f"{part.__name__}{'' if several else '.only'}"
    if name not in parts:
        parts[name] = {}  # a part may stand inside itself
        properties = {"type": {"const": kind}, "source": _TEXT, **_properties(part, parts)}
        own = entries(part)
        needed = [key for key, entry in own.items() if getattr(entry, "required", False)]
        lists = {k for k, e in own.items() if isinstance(e, Number) and e.shape[:1] == (None,)}
        columns = [key for key in needed if key in lists]
        kept = ["type"] * several + [key for key in needed if key not in columns]
        more: dict[str, Any] = {"required": kept, "description": summary(part)}
        if columns:  # which may come from a file
            more["anyOf"] = [{"required": columns}, {"required": [KEY]}]
            properties[KEY] = _TEXT
        parts[name] = _object(properties, **more)
    return {"$ref": f"#/definitions/{name}"}
