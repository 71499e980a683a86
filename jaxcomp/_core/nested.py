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


class Said(str):
    """Where the unit of a number is said that is not in its key."""


Table = Mapping[str, Union[str, "Table"]]

# Notes that stand in braces in the place of a unit. Quantities and numbers of a machine listed by their
# names each have their unit behind their name; two units are those that the result has under a key.
NAMED = Said("by name, with the unit that the registry or the result has for the name")
OF_THE_WHOLE = (Said("vibration_unit"), Said("correction_unit"))
NOTES = {
    "beside": Said("in the unit that stands beside it"),
    "quantity": Said("in the unit of the quantity"),
    "number": Said("in the unit of the number of the machine"),
    "ratio": Said("in the unit of the quantity over that of the number"),
    "mixed": Said("in metres along x, y and z and in radians about them"),
    "option": Said("as the option was given"),
    "bytes": Said("in bytes"),
    "parameters": Said("in the units of the parameters"),
    "celsius": Said("in SI units, temperatures in degrees Celsius"),
    "file": Said("as it stands in the file"),
    "efficiency": Said("an efficiency, or of a response a displacement in metres"),
    "named": NAMED,
    **{str(one): one for one in OF_THE_WHOLE},
}

_GROUP = re.compile(r" *(?P<keys>[^[{]*?) *(\[(?P<unit>.*)\]|\{(?P<note>.*)\})?")


@cache
def units_table(text: str) -> Table:
    """The table of a text."""
    table: dict[str, Any] = {}
    for line in text.split("\n"):
        places, colon, groups = line.strip().rpartition(":")
        for place in places.split("|"):
            there = table
            for key in place.split(".") if colon else ():
                there = there.setdefault(key, {})
            for one in filter(None, map(_GROUP.fullmatch, groups.split(";"))):
                unit = NOTES[one["note"]] if one["note"] else one["unit"] or ""
                there |= dict.fromkeys(filter(None, one["keys"].split(", ")), unit)
    return table


def merged(*tables: Table) -> Table:
    """One table of several, of which a later one counts where both name a number."""
    whole: dict[str, Any] = {}
    for table in tables:
        for key, told in table.items():
            inner = isinstance(told, Mapping) and isinstance(whole.get(key), Mapping)
            whole[key] = merged(whole[key], told) if inner else told
    return whole


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
        for value in result.values():
            for one in value if isinstance(value, list | tuple) else [value]:
                self._learn(one)

    def _learn(self, one: Any) -> None:
        if isinstance(one, dict) and {"name", "unit"} <= {*one}:
            self.named[one["name"]] = one["unit"]
        elif isinstance(one, dict):
            inner = {k: v for k, v in one.items() if isinstance(v, dict) and "unit" in v}
            self.named |= {name: entry["unit"] for name, entry in inner.items()}

    def of(self, value: Any, table: Table) -> Any:
        """A part of the result with units in its keys."""
        if isinstance(value, list | tuple):
            return [self.of(one, table) for one in value]
        if not isinstance(value, dict):
            return value
        out = {}
        table = value.units if isinstance(value, _OfResult) else table
        for key, inner in value.items():
            of_result = isinstance(inner, _OfResult)
            told = {} if of_result else table.get(key, table.get("*", {}))
            if told is NAMED and not isinstance(inner, dict):  # names stand beside each other
                told = self._unit(key)
            if told is NAMED:
                out[key] = {self._key(name, self._unit(name), x): x for name, x in inner.items()}
            elif not isinstance(told, str):
                out[key] = self.of(inner, told)
            else:
                unit = self.root.get(told, "") if told in OF_THE_WHOLE else told
                out[self._key(key, "" if isinstance(unit, Said) else unit, inner)] = inner
        return out

    def _unit(self, name: str) -> str:
        one = registered_quantity(name)
        return self.named.get(name, one.unit if one else "")

    @staticmethod
    def _key(key: str, unit: str, value: Any) -> str:
        return f"{key} [{unit}]" if unit and not isinstance(value, bool | str) else key


# ------------------------------------------------------------------- making of nested numbers
def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers for JSON; of complex numbers the magnitudes.

    A number that is not finite becomes `None`; a result, and a tuple with named fields, a dictionary.
    """
    if hasattr(value, "nested"):
        return _OfResult(plain(value.nested()), value.units_of_nested())
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, complex):
        value = abs(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def records(**columns: Any) -> list[dict[str, Any]]:
    """The rows of columns of equal length, each by the names of the columns."""
    lists = (one.tolist() if hasattr(one, "tolist") else one for one in columns.values())
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]


def fields_of(found: Any, *names: str) -> dict[str, Any]:
    """Some attributes of a result by name."""
    return {name: getattr(found, name) for name in names}


# ------------------------------------------------------------------- schema
def _any_depth(name: str, one: dict[str, Any]) -> dict[str, Any]:
    again = {"$ref": f"#/$defs/{name}"}
    lists = {"type": "array", "items": again}
    return {"anyOf": [one, lists, {"type": "object", "additionalProperties": again}]}


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
    others = _WORDS
    for key, told in table.items():
        if not isinstance(told, str):
            inner = _listed(schema_of(told))
            key_is = key
            schema = {"anyOf": [inner, _WORDS]}
        elif told in OF_THE_WHOLE:
            patterns[rf"^{key}( \[.+\])?$"] = _NUMBERS | {"description": f"in the unit of `{told}`"}
            continue
        elif isinstance(told, Said):
            key_is = key
            schema = {"$ref": "#/$defs/stated", "description": str(told)}
        else:
            key_is = f"{key} [{told}]" if told else key
            schema = _NUMBERS
        if key == "*" and told and key_is != key:
            patterns[rf" \[{re.escape(told)}\]$"] = schema
        elif key == "*":
            others = {"anyOf": [schema, _WORDS]}
        else:
            properties[key_is] = schema
    return {
        "type": "object",
        "properties": properties,
        "patternProperties": patterns,
        "additionalProperties": others,
    }


def _listed(one: dict[str, Any]) -> dict[str, Any]:
    twice = {"type": "array", "items": one}
    return {"anyOf": [one, {"type": "array", "items": {"anyOf": [one, twice]}}]}
