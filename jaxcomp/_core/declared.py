"""Declarations of results: every number, word and record in them, once.

A field is declared by [`reading`][], [`word`][] or [`part`][], a number that is computed from fields by
`computed`. Unit, dimensions and sentence of a number stand there and nowhere else: JSON and its schema,
tables, xarray and what is printed read them.
"""

import dataclasses
import math
import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeVar

from .evidence import Check

_Value = TypeVar("_Value")
_Record = TypeVar("_Record")


class Note(str):
    """Where the unit of a number is said that is not in its declaration."""

    __slots__ = ()


BESIDE = Note("in the unit that stands beside it")
# Of numbers by the names of quantities, or of numbers of a machine: each is a `Measured`.
NAMED = Note("by name, with the unit that the registry or the result has for the name")
QUANTITY = Note("in the unit of the quantity")
OPTION = Note("as the option was given")
NUMBER = Note("in the unit of the number of the machine")
RATIO = Note("in the unit of the quantity over that of the number")
# Of a `Measured`, whose unit is known with the result only.
IN_KEY = Note("in the unit that stands in the key")


def with_unit(name: str, unit: str) -> str:
    """`pressure [Pa]`; the name alone for a pure number."""
    return f"{name} [{unit}]" if unit else name


class Measured(NamedTuple):
    """A number, or a list of them, whose unit is known with the result only."""

    value: Any
    unit: str


class Declaration(NamedTuple):
    """Description of an entry of a result before there is a result.

    Attributes:
        unit: SI unit of a number, "" for a pure one; a `Note` where it is known with the result only;
            `None` for words, truth values and records.
        dims: names of the dimensions of a number.
        doc: what it is, where the name does not tell.
        kind: class of a record, or of several, under the name; or a function that imports it, where it is
            rarely needed.
        by_name: whether it is a table of numbers or records by name.
        optional: whether the entry is left out where its value is `None`.
        inline: whether the entries of a record stand among those of the result.
        table_only: whether it is a curve, which tables have and JSON leaves out.
        key: name of the entry, where it is not that of the field.
    """

    unit: str | None = None
    dims: tuple[str, ...] = ()
    doc: str = ""
    kind: Any = None
    by_name: bool = False
    optional: bool = False
    inline: bool = False
    table_only: bool = False
    key: str = ""


class Computed(property):
    """A number, word or record that a result computes from its fields."""

    declaration: Declaration


# ------------------------------------------------------------------- declaring
# Options are further attributes of `Declaration`; of a field also `default`, `default_factory`, `static`.
def reading(unit: str, *dims: str, **options: Any) -> Any:
    """Declare a field with a number; a unit that is a `Note` is known with the result only."""
    return _field(options, unit=unit, dims=dims)


def word(**options: Any) -> Any:
    """Declare a field with words or truth values, or with lists or tables of them."""
    return _field(options)


def part(kind: Any, **options: Any) -> Any:
    """Declare a field with a record or a result, a list of them, or several by name."""
    return _field(options, kind=kind)


def held(**options: Any) -> Any:
    """Declare a field that is no entry: what numbers of the result are computed from."""
    return _field_with({}, options)


def computed(unit: str, *dims: str, **options: Any) -> Callable[[Callable[[Any], _Value]], _Value]:
    """Declare a property with a number, as `reading` declares a field."""
    return _computed(Declaration(unit=unit, dims=dims, **options))


def computed_word(**options: Any) -> Callable[[Callable[[Any], _Value]], _Value]:
    """Declare a property with words, as `word` declares a field."""
    return _computed(Declaration(**options))


def computed_part(kind: Any, **options: Any) -> Callable[[Callable[[Any], _Value]], _Value]:
    """Declare a property with records, as `part` declares a field."""
    return _computed(Declaration(kind=kind, **options))


def forwarded(kind: type, path: str, **options: Any) -> Any:
    """Declare a property that is a number of a part, with what the part declares of it.

    Args:
        kind: class of the part.
        path: field with the part, a dot and the name of the number there. Where the field is `None`, so
            is the number.
        options: attributes of `Declaration` that differ.
    """
    field, _, name = path.partition(".")

    def number(self: Any) -> Any:
        """Number of a part."""
        holder = getattr(self, field)
        if holder is None:
            return None
        return getattr(holder, name)

    return _computed(declarations(kind)[name]._replace(**options))(number)


def _field(options: dict[str, Any], **declared: Any) -> Any:
    for name in Declaration._fields:
        if name in options:
            declared[name] = options.pop(name)
    return _field_with({"declaration": Declaration(**declared)}, options)


def _field_with(metadata: dict[str, Any], options: dict[str, Any]) -> Any:
    # equinox knows a static field by its metadata; this module is imported where equinox is not
    if options.pop("static", False):
        metadata["static"] = True
    return dataclasses.field(metadata=metadata, **options)


def _computed(declaration: Declaration) -> Callable[[Callable[[Any], _Value]], _Value]:
    def declare(function: Callable[[Any], _Value]) -> _Value:
        number = Computed(function)
        number.declaration = declaration
        return number  # pyright: ignore[reportReturnType], whose type is that of the value

    return declare


class Declared:
    """Base of classes with declared entries."""

    __slots__ = ()

    @classmethod
    def units_by_name(cls) -> Mapping[str, str]:
        """Units of entries that are known by name only, such as registered quantities, for the schema."""
        return {}

    def tree(self) -> dict[str, Any]:
        """Declared numbers and words by their names, as of `tree_of`."""
        tree: dict[str, Any] = {}
        for name, declaration in declarations(type(self)).items():
            if declaration.table_only:
                continue
            value = getattr(self, name)
            if value is None and declaration.optional:
                continue
            entry = tree_of(value)
            if declaration.inline:
                tree |= entry
            else:
                tree[declaration.key or name] = _measured(entry, declaration)
        return tree

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of this result, in a fixed order; none where it has nothing to be doubted.

        Args:
            tolerance: [-] that the solver was asked for.
        """
        del tolerance
        return ()

    def entries(self) -> dict[str, Any]:
        """Numbers [SI] and words by name, nested where they belong together.

        The names are stable; new ones may join them.
        """
        return without_units(tree_of(self))


class Record(Declared):
    """Base of records: numbers and words that stand together in a result, each declared once."""

    __slots__ = ()


# asked for every record that is printed, and the same for all of a class
@cache
def declarations(kind: type) -> Mapping[str, Declaration]:
    """Declarations of a class by the names of its fields and properties, in their order."""
    declared = {}
    for field in dataclasses.fields(kind):
        if "declaration" in field.metadata:
            declared[field.name] = field.metadata["declaration"]
    for base in reversed(kind.__mro__):
        for name, member in vars(base).items():
            if isinstance(member, Computed):
                declared[name] = member.declaration
    return declared


def kind_of(declaration: Declaration) -> type["Declared"]:
    """Class of the records of a declaration."""
    if isinstance(declaration.kind, type):
        return declaration.kind
    return declaration.kind()


def records_of(kind: type[_Record], **columns: Any) -> tuple[_Record, ...]:
    """Records of a class from columns of equal length by the names of its fields."""
    lists = []
    for column in columns.values():
        # numbers of Python, as they stand in JSON
        if hasattr(column, "tolist"):
            column = column.tolist()
        lists.append(column)
    records = []
    for row in zip(*lists, strict=True):
        records.append(kind(**dict(zip(columns, row, strict=True))))
    return tuple(records)


# ------------------------------------------------------------------- entries
def tree_of(value: Any) -> Any:
    """Numbers and words of a result, or of tables and lists with results in them, for JSON.

    A number with a unit is a `Measured`. Of complex numbers the magnitudes are taken; a number that is
    not finite becomes `None`.
    """
    if isinstance(value, Declared):
        return value.tree()
    if isinstance(value, Measured):
        return Measured(tree_of(value.value), value.unit)
    # before lists and tuples: one with named fields is a tuple as well
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {key: tree_of(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [tree_of(entry) for entry in value]
    if hasattr(value, "tolist"):
        # once more, for complex numbers and those that are not finite
        return tree_of(value.tolist())
    if isinstance(value, complex):
        value = abs(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON has no word for it
    return value


def _measured(entry: Any, declaration: Declaration) -> Any:
    unit = declaration.unit
    if not unit or isinstance(unit, Note):
        return entry
    if declaration.by_name:
        return {member: Measured(number, unit) for member, number in entry.items()}
    return Measured(entry, unit)


def without_units(tree: Any) -> Any:
    """Numbers and words of a tree of `tree_of` alone."""
    if isinstance(tree, Measured):
        return without_units(tree.value)
    if isinstance(tree, dict):
        return {key: without_units(entry) for key, entry in tree.items()}
    if isinstance(tree, list):
        return [without_units(entry) for entry in tree]
    return tree


def with_units(tree: Any) -> Any:
    """Numbers and words of a tree with the SI unit of each in its key, as `mean_speed [rad/s]`."""
    if isinstance(tree, Measured):
        return with_units(tree.value)
    if isinstance(tree, list):
        return [with_units(entry) for entry in tree]
    if not isinstance(tree, dict):
        return tree
    keyed = {}
    for key, entry in tree.items():
        # a truth value or a word has no unit, also under a key that may hold a number
        if isinstance(entry, Measured) and not isinstance(entry.value, bool | str):
            key = with_unit(key, entry.unit)
        keyed[key] = with_units(entry)
    return keyed


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


class _Schema(NamedTuple):
    """Schemas of entries: by their keys, and by patterns of keys."""

    properties: dict[str, Any]
    patterns: dict[str, Any]

    def add(self, other: "_Schema") -> None:
        """Add entries; a key that two classes have may hold what either of them says."""
        for schemas, further in zip(self, other, strict=True):
            for key, schema in further.items():
                if schemas.get(key, schema) != schema:
                    schema = {"anyOf": [schemas[key], schema]}
                schemas[key] = schema

    def document(self) -> dict[str, Any]:
        """The schema of an object; what it does not name are words."""
        return {
            "type": "object",
            "properties": self.properties,
            "patternProperties": self.patterns,
            "additionalProperties": _WORDS,
        }


def schema_of(*kinds: Any) -> dict[str, Any]:
    """JSON schema of an object with the entries of these classes; refers to `SCHEMAS` in `$defs`."""
    schema = _Schema({}, {})
    for kind in kinds:
        schema.add(_schema_of_kind(kind))
    return schema.document()


def _schema_of_kind(kind: type[Declared]) -> _Schema:
    schema = _Schema({}, {})
    for name, unit in kind.units_by_name().items():
        schema.properties[with_unit(name, unit)] = _NUMBERS
    for name, declaration in declarations(kind).items():
        if declaration.inline and declaration.kind is not None:
            schema.add(_schema_of_kind(kind_of(declaration)))
        elif not (declaration.inline or declaration.table_only):
            schema.add(_schema_of_entry(declaration.key or name, declaration))
    return schema


def _schema_of_entry(key: str, declaration: Declaration) -> _Schema:
    unit = declaration.unit
    if declaration.kind is not None:
        schema = _listed(schema_of(kind_of(declaration)))
        if declaration.by_name:
            schema = {"type": "object", "additionalProperties": {"anyOf": [schema, _WORDS]}}
        return _Schema({key: {"anyOf": [schema, _WORDS]}}, {})
    if unit is None:
        return _Schema({}, {})
    if unit is IN_KEY:
        # the unit is known with the result only: any of them, or none
        described = _NUMBERS | {"description": str(unit)}
        return _Schema({}, {rf"^{re.escape(key)}( \[.+\])?$": described})
    if isinstance(unit, Note):
        return _Schema({key: {"$ref": "#/$defs/stated", "description": str(unit)}}, {})
    if declaration.by_name:
        named = {rf" \[{re.escape(unit)}\]$": _NUMBERS}
        return _Schema({key: _Schema({}, named).document()}, {})
    return _Schema({with_unit(key, unit): _NUMBERS}, {})


def _listed(schema: dict[str, Any]) -> dict[str, Any]:
    twice = {"type": "array", "items": schema}
    return {"anyOf": [schema, {"type": "array", "items": {"anyOf": [schema, twice]}}]}
