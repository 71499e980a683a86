"""Changes in the tables of a scene, so that they say what the parts hold."""

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._fields import Part
from ..film import NamedBearing
from ._dump import is_section
from ._errors import SceneError
from ._read import unwrapped
from ._schema import Number, Option, PartTable, SubPart, choices, entries, kind_of
from ._units import as_text

# Keys that are plain texts and carry no source.
_PLAIN = ("type", "source", "name", "description")


def set_value(document: dict[str, Any], path: str, value: Any, source: str) -> set[str]:
    """Set one entry of nested tables, in place.

    Args:
        document: the tables.
        path: dotted path; numbers are places in a list. Sections that lack are made.
        value: the entry, `None` to take it away.
        source: its source.

    Returns:
        Paths of the other entries of its section, if the entry is a new `type`.

    Raises:
        SceneError: the path leads through a value or past the end of a list.
    """
    keys = path.split(".")
    if not all(keys):
        raise SceneError(path, "is no path; it must be names joined by dots")
    node: Any = document
    for place, key in enumerate(keys):
        here = ".".join(keys[:place])
        if isinstance(node, Mapping) and not is_section(node):
            node = node["value"]
        last = place + 1 == len(keys)
        if isinstance(node, list):
            if not key.isdigit() or int(key) >= len(node):
                raise SceneError(path, f"must name one of the {len(node)} entries of {here}")
            if last:
                _replace_in_list(node, int(key), value, path)
            else:
                node = node[int(key)]
        elif not isinstance(node, dict):
            raise SceneError(path, f"leads through {here}, which is a single value")
        elif not last:
            node = node.setdefault(key, {})
        elif value is None:
            node.pop(key, None)
        elif isinstance(value, Mapping) or key in _PLAIN:
            node[key] = copy.deepcopy(value)
            if key == "type":
                return {".".join([*keys[:-1], other]) for other in node if other != "type"}
        else:
            node[key] = {"value": value, "source": source}
    return set()


def updated(table: Mapping[str, Any], old: Part | None, new: Part, source: str) -> dict[str, Any]:
    """A section that describes `new`, given the one that describes `old`.

    Entries that do not differ stay as they were written, others keep their unit if they can.

    Raises:
        SceneError: a part that a file cannot describe.
    """
    same = type(old) is type(new)
    out = copy.deepcopy(dict(table)) if same else {}
    known = entries(type(new))
    if not same:
        siblings = choices((type(new),))
        if kind_of(type(new)) not in siblings:
            raise SceneError("", f"a file cannot describe a part of type {type(new).__name__}")
        out["type"] = kind_of(type(new))
        if old is None:  # the top of a document keeps its header and its other sections
            out = {**copy.deepcopy(dict(table)), **out}
    for name, entry in known.items():
        before, after = getattr(old, name, None) if same else None, getattr(new, name)
        if after is None:
            out.pop(name, None)
        elif isinstance(after, NamedBearing):
            if before is None or getattr(before, "name", None) != after.name:
                out[name] = {"value": after.name, "source": source}
        elif isinstance(entry, SubPart):
            section = out.get(name, {}) if before is not None else {}
            out[name] = updated(section, before, after, source)
        elif isinstance(entry, PartTable):
            rows = out.get(name, []) if before and len(before) == len(after) else []
            olds = before if rows else [None] * len(after)
            rows = rows or [{}] * len(after)
            out[name] = [
                new.name if isinstance(new, NamedBearing) else updated(row, old, new, source)
                for row, old, new in zip(rows, olds, after, strict=True)
            ]
        elif isinstance(entry, Number):
            if before is None or not np.array_equal(before, after):
                given = unwrapped(out[name], name)[0] if name in out else None
                out[name] = {"value": _texts(np.asarray(after), entry.unit, given)}
                out[name]["source"] = source
        elif isinstance(entry, Option) and (not same or before != after):
            out[name] = {"value": _listed(after), "source": source}
    return out


def _replace_in_list(values: list, index: int, value: Any, path: str) -> None:
    if value is None:
        raise SceneError(path, "is one of a list and cannot be taken away alone")
    values[index] = copy.deepcopy(value)


def _texts(value: np.ndarray, unit: str, given: Any) -> Any:
    if value.ndim == 0:
        return as_text(float(value), unit, given)
    givens = given if isinstance(given, list) and len(given) == len(value) else [None] * len(value)
    return [_texts(item, unit, old) for item, old in zip(value, givens, strict=True)]


def _listed(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_listed(item) for item in value]
    return "none" if value is None else value
