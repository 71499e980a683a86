"""Numbers of results as JSON nests them, with the SI unit of every number in its key.

A table names every number by its key, `*` any key beside those that are named. What a table does not
name is no number. A list has the table of its entries, and a unit stands for all numbers beneath a
key: one, a list, or several by name. A class of results has its table as a text, in which a line has
keys with their unit, several separated by semicolons, behind the places that hold them.
"""

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import Any, Union

from .registry import registered_quantity


class UnitNote(str):
    """Where the unit of a number is said that is not in its key."""


Table = Mapping[str, Union[str, "Table"]]

# Notes that stand in braces in the place of a unit. Quantities and numbers of a machine listed by their
# names each have their unit behind their name; two units are those that the result has under a key.
NAMED = UnitNote("by name, with the unit that the registry or the result has for the name")
OF_THE_WHOLE = (UnitNote("vibration_unit"), UnitNote("correction_unit"))
NOTES = {
    "beside": UnitNote("in the unit that stands beside it"),
    "quantity": UnitNote("in the unit of the quantity"),
    "number": UnitNote("in the unit of the number of the machine"),
    "ratio": UnitNote("in the unit of the quantity over that of the number"),
    "mixed": UnitNote("in metres along x, y and z and in radians about them"),
    "option": UnitNote("as the option was given"),
    "bytes": UnitNote("in bytes"),
    "parameters": UnitNote("in the units of the parameters"),
    "celsius": UnitNote("in SI units, temperatures in degrees Celsius"),
    "file": UnitNote("as it stands in the file"),
    "efficiency": UnitNote("an efficiency, or of a response a displacement in metres"),
    "named": NAMED,
    **{str(note): note for note in OF_THE_WHOLE},
}

_GROUP = re.compile(r" *(?P<keys>[^[{]*?) *(\[(?P<unit>.*)\]|\{(?P<note>.*)\})?")


@cache
def units_table(text: str) -> Table:
    """The table of a text."""
    table: dict[str, Any] = {}
    for line in text.split("\n"):
        # a line without a place names keys of the result itself
        places, colon, groups = line.strip().rpartition(":")
        for place in places.split("|"):
            entries = table
            if colon:
                for key in place.split("."):
                    entries = entries.setdefault(key, {})
            for group in filter(None, map(_GROUP.fullmatch, groups.split(";"))):
                unit = group["unit"] or ""
                if group["note"]:
                    unit = NOTES[group["note"]]
                entries |= dict.fromkeys(filter(None, group["keys"].split(", ")), unit)
    return table


def merged(*tables: Table) -> Table:
    """One table of several, of which a later one counts where both name a number."""
    union: dict[str, Any] = {}
    for table in tables:
        for key, entry in table.items():
            if isinstance(entry, Mapping) and isinstance(union.get(key), Mapping):
                entry = merged(union[key], entry)
            union[key] = entry
    return union


def with_units(numbers: dict[str, Any], table: Table) -> dict[str, Any]:
    """Numbers with the SI unit of each in its key, as `mean_speed [rad/s]`."""
    return _Keyed(numbers).of(numbers, table)


class _OfResult(dict):
    """Plain numbers of a result within others, with their units."""

    def __init__(self, numbers: dict[str, Any], units: Table):
        super().__init__(numbers)
        self.units = units


class _Keyed:
    """Puts units into keys; knows those that the result itself says, for names and for its whole."""

    def __init__(self, result: dict[str, Any]):
        self.root = result
        self.named = {}
        # a part that has a name and a unit tells the unit of that name wherever else it stands
        for value in result.values():
            entries = value
            if not isinstance(value, list | tuple):
                entries = [value]
            for entry in entries:
                self._learn(entry)

    def _learn(self, part: Any) -> None:
        if isinstance(part, dict) and {"name", "unit"} <= {*part}:
            self.named[part["name"]] = part["unit"]
        elif isinstance(part, dict):
            for name, entry in part.items():
                if isinstance(entry, dict) and "unit" in entry:
                    self.named[name] = entry["unit"]

    def of(self, value: Any, table: Table) -> Any:
        """A part of the result with units in its keys."""
        if isinstance(value, list | tuple):
            return [self.of(entry, table) for entry in value]
        if not isinstance(value, dict) or isinstance(value, _New):
            return value
        out = {}
        if isinstance(value, _OfResult):
            table = value.units
        for key, inner in value.items():
            note = table.get(key, table.get("*", {}))
            if isinstance(inner, _OfResult | _New):
                note = {}  # it brings its own units
            if note is NAMED and not isinstance(inner, dict):  # names stand beside each other
                note = self._unit(key)
            if note is NAMED:
                out[key] = self._keyed_quantities(inner)
            elif not isinstance(note, str):
                out[key] = self.of(inner, note)
            else:
                out[self._key(key, self._noted_unit(note), inner)] = inner
        return out

    def _keyed_quantities(self, numbers: dict[str, Any]) -> dict[str, Any]:
        """Numbers by the names of quantities, each with the unit of its quantity."""
        out = {}
        for name, number in numbers.items():
            out[self._key(name, self._unit(name), number)] = number
        return out

    def _noted_unit(self, note: str) -> str:
        """The unit that a note of the table stands for; "" where it has none for a key."""
        unit = note
        if note in OF_THE_WHOLE:
            unit = self.root.get(note, "")
        if isinstance(unit, UnitNote):
            unit = ""  # the note is for readers of the schema
        return unit

    def _unit(self, name: str) -> str:
        quantity = registered_quantity(name)
        return self.named.get(name, quantity.unit if quantity else "")

    @staticmethod
    def _key(key: str, unit: str, value: Any) -> str:
        # a truth value or a word has no unit, also under a key that may hold a number
        if unit and not isinstance(value, bool | str):
            return f"{key} [{unit}]"
        return key


# ------------------------------------------------------------------- making of nested numbers
def unkeyed(keyed: Any) -> Any:  # TRANSITION
    if isinstance(keyed, list):
        return [unkeyed(entry) for entry in keyed]
    if not isinstance(keyed, dict):
        return keyed
    from .declared import Measured

    tree = {}
    for key, entry in keyed.items():
        match = re.fullmatch(r"(.*) \[(.*)\]", str(key))
        if match:
            tree[match[1]] = Measured(unkeyed(entry), match[2])
        else:
            tree[key] = unkeyed(entry)
    return tree


class _New(dict):  # TRANSITION
    pass


def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers for JSON; of complex numbers the magnitudes.

    A number that is not finite becomes `None`; a result, and a tuple with named fields, a dictionary.
    """
    from . import declared

    if isinstance(value, declared.Declared) and not hasattr(value, "nested"):  # TRANSITION
        return _New(declared.with_units(declared.tree_of(value)))
    if hasattr(value, "nested"):
        return _OfResult(plain(value.nested()), value.units_of_nested())
    # before lists and tuples: one with named fields is a tuple as well
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, _New | _OfResult):
        return value
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        # once more, for complex numbers and those that are not finite
        return plain(value.tolist())
    if isinstance(value, complex):
        value = abs(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON has no word for it
    return value


def records(**columns: Any) -> list[dict[str, Any]]:
    """The rows of columns of equal length, each by the names of the columns."""
    lists = []
    for column in columns.values():
        if hasattr(column, "tolist"):
            column = column.tolist()
        lists.append(column)
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]


def fields_of(result: Any, *names: str) -> dict[str, Any]:
    """Some attributes of a result by name."""
    return {name: getattr(result, name) for name in names}


# ------------------------------------------------------------------- schema
def _any_depth(name: str, schema: dict[str, Any]) -> dict[str, Any]:
    # by a reference to itself, for lists in lists and tables in tables to any depth
    reference = {"$ref": f"#/$defs/{name}"}
    lists = {"type": "array", "items": reference}
    return {"anyOf": [schema, lists, {"type": "object", "additionalProperties": reference}]}


# What the schemas of results refer to, in `$defs`.
SCHEMAS = {
    "words": _any_depth("words", {"type": ["string", "boolean", "null"]}),
    "numbers": _any_depth("numbers", {"type": ["number", "null"]}),
    "stated": _any_depth("stated", {"type": ["number", "string", "boolean", "null"]}),
}
_WORDS = {"$ref": "#/$defs/words"}
_NUMBERS = {"$ref": "#/$defs/numbers"}


def schema_of(table: Table) -> dict[str, Any]:
    """JSON schema of an object with these units in its keys; refers to `SCHEMAS` in `$defs`."""
    properties = {}
    patterns = {}
    further = _WORDS
    for key, entry in table.items():
        if not isinstance(entry, str):
            inner = _listed(schema_of(entry))
            key_is = key
            schema = {"anyOf": [inner, _WORDS]}
        elif entry in OF_THE_WHOLE:
            # the unit is known with the result only: any of them, or none
            patterns[rf"^{key}( \[.+\])?$"] = _NUMBERS | {
                "description": f"in the unit of `{entry}`"
            }
            continue
        elif isinstance(entry, UnitNote):
            key_is = key
            schema = {"$ref": "#/$defs/stated", "description": str(entry)}
        else:
            key_is = f"{key} [{entry}]" if entry else key
            schema = _NUMBERS
        if key == "*" and entry and key_is != key:
            patterns[rf" \[{re.escape(entry)}\]$"] = schema
        elif key == "*":
            further = {"anyOf": [schema, _WORDS]}
        else:
            properties[key_is] = schema
    return {
        "type": "object",
        "properties": properties,
        "patternProperties": patterns,
        "additionalProperties": further,
    }


def _listed(schema: dict[str, Any]) -> dict[str, Any]:
    twice = {"type": "array", "items": schema}
    return {"anyOf": [schema, {"type": "array", "items": {"anyOf": [schema, twice]}}]}
