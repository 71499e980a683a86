"""From the tables of a machine file to parts."""

from collections.abc import Callable, Container, Iterable, Mapping
from typing import Any

import numpy as np

from .._core.errors import BadInput
from .._core.fields import Part, at
from .._core.words import did_you_mean, nearest
from ..film import NamedBearing
from ._schema import (
    Entry,
    Number,
    Option,
    Section,
    choices,
    entries,
    expected,
    holders,
    join,
    kind_of,
    option_value,
)
from ._text import SceneError, short_value
from ._units import to_si

# Keys of a section that are no fields of its part.
_META = ("type", "source")
# Problems up to which the nearest known key is looked up, which takes time.
MOST_HINTS = 20
_FEW = 3


class Reader:
    """Reads sections, remembers where each value comes from, and goes on after what is wrong.

    Attributes:
        sources: text by dotted path.
        problems: everything that is wrong with what was read so far.
        stale: paths of entries that are dropped, from the tables as well, where their section has
            no use for them.
    """

    def __init__(self, stale: Iterable[str] = ()):
        self.sources: dict[str, str] = {}
        self.problems: list[SceneError] = []
        self.stale = frozenset(stale)

    def part(
        self,
        table: Any,
        classes: tuple[type, ...],
        path: str,
        source: str | None = None,
        ignored: Container[str] = (),
    ) -> Part | None:
        """Build the part that a section describes; `None` if that adds to `problems`.

        Args:
            table: the section.
            classes: what the part may be.
            path: dotted path of the section, empty at the top.
            source: of all values that name none.
            ignored: keys that belong to somebody else.
        """
        return self._tried(self._part, table, classes, path, source, ignored)

    def named(self, table: Any, classes: tuple[type, ...], path: str, source) -> dict[str, Any]:
        """The parts of a section of named sections; the arguments are as for `part`."""
        if not isinstance(table, Mapping):
            self.problems.append(SceneError(path, f"must hold sections [{path}.NAME]", table))
            return {}
        source = _text(table.get("source", source), join(path, "source"))
        parts = {}
        for name, section in table.items():
            if name != "source":
                parts[name] = self.part(section, classes, join(path, name), source)
        return parts

    def _part_or_name(self, entry: Any, classes, path: str, source) -> Part | None:
        """A part, or the name of a bearing where one may stand."""
        if is_value(entry):
            name, _, own_source = unwrapped(entry, path)
            if isinstance(name, str) and NamedBearing in choices(classes).values():
                self.sources[path] = own_source or source or ""
                return NamedBearing(name)
        return self.part(entry, classes, path, source)

    def _tried(self, read: Callable[..., Any], *arguments: Any) -> Any:
        """Value that a function reads, `None` where that ends in a problem."""
        before = len(self.problems)
        try:
            value = read(*arguments)
        except SceneError as error:
            value = None
            self.problems.append(error)
        if len(self.problems) > before:
            return None
        return value

    def _part(self, table, classes, path, source, ignored) -> Part | None:
        if not isinstance(table, Mapping) or "value" in table:
            raise SceneError(path, f"must be a section [{path}]", table)
        kind = selected_class(table, classes, path)
        table = kind.written(table)
        source = _text(table.get("source", source), join(path, "source"))
        allowed = entries(kind)
        for key in list(table):
            if key not in allowed and join(path, key) in self.stale:
                del table[key]  # pyright: ignore[reportIndexIssue]
        before = len(self.problems)
        meant = self._report_unknown_keys(table, allowed, path, ignored)
        values = {}
        for name, entry in allowed.items():
            if name in table:
                entry_path = join(path, name)
                values[name] = self._tried(self._entry, entry, table[name], entry_path, source)
        for name, entry in allowed.items():
            # a misspelt key is not reported a second time as a missing one
            if name not in table and entry.required and name not in meant:
                problem = f"is missing; it must be {expected(entry)}"
                self.problems.append(SceneError(join(path, name), problem))
        if len(self.problems) > before:
            return None
        return _built(kind, values, table, path)

    def _report_unknown_keys(
        self, table: Mapping, allowed: Mapping[str, Entry], path: str, ignored: Container[str]
    ) -> set[str | None]:
        """Report keys that a section does not have, and return the known keys that they resemble."""
        meant = set()
        for key, value in table.items():
            if key in allowed or key in _META or key in ignored:
                continue
            hint = ""
            if len(self.problems) < MOST_HINTS:
                hint = _hint(key, allowed, path)
                meant.add(nearest(key, allowed))
            if isinstance(value, Mapping):
                value = value.get("value")
            self.problems.append(SceneError(join(path, key), f"is an unknown key{hint}", value))
        return meant

    def _entry(self, entry: Entry, written: Any, path: str, source: str | None) -> Any:
        if isinstance(entry, Section):
            if not entry.rows:
                return self._part_or_name(written, entry.classes, path, source)
            if not isinstance(written, list):
                raise SceneError(path, f"must be a row of sections [[{path}]]", written)
            rows = []
            for i, row in enumerate(written):
                rows.append(self._part_or_name(row, entry.classes, f"{path}.{i}", source))
            return tuple(rows)
        value, unit, own_source = unwrapped(written, path)
        self.sources[path] = own_source or source or ""
        if isinstance(entry, Number):
            si = to_si(value, entry.unit, path, unit)
            if not si.size and entry.shape[:1] == (None,):  # a table without rows has no columns
                lengths = [length or 0 for length in entry.shape[1:]]
                return si.reshape(0, *lengths)
            if (si.ndim or not entry.spread) and not (si.ndim == 1 and entry.each):
                _check_shape(si, entry.shape, path, value)
            return si
        if isinstance(entry, Option):
            try:
                return option_value(entry.hint, value)
            except ValueError as error:
                raise SceneError(path, str(error), value) from None
        raise SceneError(path, "cannot be given in a file", value)


def _hint(key: str, allowed: Container[str], path: str) -> str:
    """Advice in place of an unknown key: a similar one, or its own section where few have it."""
    if not nearest(key, allowed):  # pyright: ignore[reportArgumentType]
        places = holders(key)
        if 0 < len(places) <= _FEW:
            return f"; it belongs in {' or '.join(places)}"
    return did_you_mean(key, allowed)  # pyright: ignore[reportArgumentType]


def selected_class(table: Mapping, classes: tuple[type, ...], path: str) -> type[Part]:
    """The class that the `type` of a section selects."""
    parts = choices(classes)
    if "type" not in table:
        if len(parts) == 1:
            return next(iter(parts.values()))
        words = ", ".join(sorted(parts))
        raise SceneError(join(path, "type"), f"is missing; it must be one of: {words}")
    word = table["type"]
    if not isinstance(word, str) or word not in parts:
        words = ", ".join(sorted(parts))
        near = ""
        if isinstance(word, str):
            near = did_you_mean(word, parts)
            if "did you mean" not in near:  # all words stand in front of it
                near = ""
        raise SceneError(join(path, "type"), f"must be one of: {words}{near}", word)
    return parts[word]


def unwrapped(entry: Any, path: str) -> tuple[Any, str | None, str | None]:
    """Value, unit of bare numbers and source of an entry, which may be a value or a table."""
    if not isinstance(entry, Mapping):
        return entry, None, None
    for key in entry:
        if key not in ("value", "unit", "source"):
            hint = did_you_mean(key, ("value", "unit", "source"))
            raise SceneError(join(path, key), f"is an unknown key of a value{hint}")
    if "value" not in entry:
        raise SceneError(path, "lacks its `value`")
    unit = _text(entry.get("unit"), join(path, "unit"))
    source = _text(entry.get("source"), join(path, "source"))
    return entry["value"], unit, source


def is_value(entry: Any) -> bool:
    """Whether an entry of a table is a value, bare or with its source, and not a section."""
    return not isinstance(entry, Mapping) or "value" in entry


def _built(kind: type[Part], values: dict[str, Any], table: Mapping, path: str) -> Part:
    try:
        return kind.of_entries(**values)
    except BadInput as error:
        if error.field in values:
            value = unwrapped(table[error.field], path)[0]
            raise SceneError(join(path, error.field), f"must be {error.bound}", value) from None
        if error.field.split(".")[0] in values:  # a place within a table of parts
            value = _written_at(table, error.field, error.value)
            raise SceneError(join(path, error.field), f"must be {error.bound}", value) from None
        # a rule across fields: show the values that it names
        shown = []
        for name in values:
            if name in error.bound and name in table:
                shown.append(f"{name} = {_as_written(table[name], path)}")
        but = ""
        if shown:
            but = f", but has {', '.join(shown)}"
        raise SceneError(path or kind_of(kind), f"must be {error.bound}{but}") from None
    except ValueError as error:
        raise SceneError(path or kind_of(kind), " ".join(str(error).split())) from None


def _as_written(entry: Any, path: str) -> str:
    """Value of an entry as the file has it, without the middle of a list."""
    value = unwrapped(entry, path)[0]
    if isinstance(value, str):
        return value
    return short_value(value)


def _written_at(table: Any, path: str, value: Any) -> Any:
    """An entry as the file gives it, with its unit; `value` where it has none or holds it in a list."""
    try:
        table = at(table, path)
    except LookupError:  # a default, or one value for all rows
        return value
    if not is_value(table):
        return value
    written, _, _ = unwrapped(table, path)
    if isinstance(written, list) and not np.ndim(value):
        return value
    return written


def _check_shape(value: np.ndarray, shape: tuple[int | None, ...], path: str, written: Any) -> None:
    if shape == (...,):
        return
    if not _fits(value.shape, shape):
        bound = "a single value"
        if shape:
            lengths = ["n" if length is None else str(length) for length in shape]
            bound = f"a list of {' x '.join(lengths)} values"
        raise SceneError(path, f"must be {bound}", written)


def _fits(actual_shape: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    """Whether an array has a declared shape, in which `None` is any length."""
    if len(actual_shape) != len(shape):
        return False
    pairs = zip(shape, actual_shape, strict=True)
    return all(length in (None, actual) for length, actual in pairs)


def _text(value: Any, path: str) -> str | None:
    if value is not None and not isinstance(value, str):
        raise SceneError(path, "must be a text", value)
    return value
