"""What a scene file may say about a part, read off the declaration of its class."""

import dataclasses
import inspect
import re
import types
import typing
from collections.abc import Callable
from functools import cache
from typing import Any, Literal, NamedTuple

# The packages that declare parts: a class can only be found by its kind once it is imported.
from .. import compressor as compressor
from .. import cylinder as cylinder
from .. import film as film
from .. import friction as friction
from .. import gas as gas
from .. import mechanism as mechanism
from .. import motor as motor
from .._extensions import ExtensionError, import_extensions
from .._fields import Bound, Part


class Number(NamedTuple):
    """A float array with unit and bound.

    With `spread` a single value may stand for a list, with `each` a list over several cylinders for it.
    """

    unit: str
    bound: Bound
    shape: tuple[int | None, ...]
    required: bool
    optional: bool
    doc: str
    spread: bool
    each: bool = False


class Option(NamedTuple):
    """A choice that is no quantity: a word, a name, a count, or tuples of them."""

    hint: Any
    required: bool
    optional: bool


class SubPart(NamedTuple):
    """A part inside the part, of one of several classes."""

    classes: tuple[type, ...]
    required: bool
    optional: bool


class PartTable(NamedTuple):
    """A row of parts of one of several classes."""

    classes: tuple[type, ...]
    required: bool
    optional: bool


class Unreadable(NamedTuple):
    """Something that a file cannot hold, such as a function."""

    required: bool


Entry = Number | Option | SubPart | PartTable | Unreadable


@cache
def entries(part: type[Part]) -> dict[str, Entry]:
    """What a section that describes a part of this class may hold, by key."""
    hints = typing.get_type_hints(part)
    each = part.for_each_cylinder
    return {f.name: _entry(f, hints[f.name], each) for f in dataclasses.fields(part) if f.init}


@cache
def meanings(part: type[Part]) -> dict[str, str]:
    """What each entry of a section is, in words: of its declaration or of the class's documentation."""
    _, _, text = (inspect.getdoc(part) or "").partition("Args:\n")
    block = re.split(r"\n\S", text)[0]
    found = re.findall(r"^    (\w+): (.*(?:\n     +.*)*)", block, re.MULTILINE)
    # without unit and shape, which the declaration has
    bare = {name: re.sub(r"^\[[^]]*\](?: \([^)]*\))?,? ?", "", told) for name, told in found}
    told = {name: " ".join(words.split()).rstrip(".") for name, words in bare.items()}
    return {
        name: getattr(entry, "doc", "") or told.get(name, "")
        for name, entry in entries(part).items()
    }


def kind_of(part: type) -> str:
    """The word that selects a class: its `kind`, or its name in lower case with underscores."""
    kind = part.__dict__.get("kind")
    is_field = any(f.name == "kind" for f in dataclasses.fields(part))
    if isinstance(kind, str) and not is_field:
        return kind
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", part.__name__).lower()


def choices(classes: tuple[type, ...]) -> dict[str, type[Part]]:
    """The concrete classes that a file can describe, by kind.

    Args:
        classes: classes of parts, abstract or not, or protocols that parts may follow.

    Raises:
        ExtensionError: a module of another package that cannot be imported, or a class there with the
            kind of one of this package.
    """
    import_extensions()
    found: dict[str, type[Part]] = {}
    for base in classes:
        for part in _descendants(Part if _is_protocol(base) else base):
            if _is_protocol(base) and not issubclass(part, base):
                continue
            concrete = not inspect.isabstract(part) and not part.__name__.startswith("Abstract")
            concrete &= getattr(part, "in_files", True)  # some laws only the solvers make
            if concrete and not any(
                isinstance(entry, Unreadable) and entry.required for entry in entries(part).values()
            ):
                _check_kind(part, found.get(kind_of(part), part))
                found[kind_of(part)] = part
    return found


def _check_kind(part: type[Part], other: type[Part]) -> None:
    """That no class of another package takes the kind of one of this package."""
    own = __name__.partition(".")[0] + "."
    if other.__module__.startswith(own) and not part.__module__.startswith(own):
        raise ExtensionError(
            f'{part.__module__}.{part.__qualname__} has the kind "{kind_of(part)}" of '
            f"{other.__module__}.{other.__qualname__}; give it another `kind`."
        )


def option_problem(hint: Any, value: Any) -> str | None:
    """What is wrong with the value of an option, `None` if nothing is; lists count as tuples."""
    if _fits(hint, value):
        return None
    return f"must be {_described(hint)}"


def option_value(hint: Any, value: Any) -> Any:
    """The value that the class wants: tuples for lists, `None` for the word `none`."""
    if isinstance(value, list):
        inner = typing.get_args(_branch(hint, value)) or (Any,)
        if len(inner) == 2 and inner[1] is Ellipsis:
            inner = inner[:1] * len(value)
        return tuple(option_value(h, v) for h, v in zip(inner, value, strict=True))
    if value == "none" and type(None) in typing.get_args(hint):
        return None
    return value


def expected(entry: Entry) -> str:
    """What an entry must be, with unit and bound, as the end of a sentence."""
    if isinstance(entry, Number):
        unit = f"[{entry.unit}]" if entry.unit else "pure"
        bound = "" if str(entry.bound) == "finite" else f" {entry.bound}"
        doc = f", {entry.doc}" if entry.doc else ""
        what = "a list of numbers" if entry.shape else "a number"
        what = "a number or a list of numbers" if entry.spread else what
        return f"{what}{bound} {unit}{doc}"
    if isinstance(entry, SubPart):
        return f"a section of type {' or '.join(sorted(choices(entry.classes)))}"
    if isinstance(entry, Option):
        return (option_problem(entry.hint, object()) or "given").removeprefix("must be ")
    return "given"


def _entry(field: dataclasses.Field, hint: Any, each: bool) -> Entry:
    required = field.default is dataclasses.MISSING and (
        field.default_factory is dataclasses.MISSING
    )
    optional = field.default is None
    if "unit" in field.metadata:
        m = field.metadata
        spread = m["spread"]
        each &= m["shape"] == ()
        return Number(m["unit"], m["bound"], m["shape"], required, optional, m["doc"], spread, each)
    options = tuple(h for h in _members(hint) if h is not type(None))
    if options and all(_is_part(h) for h in options):
        return SubPart(options, required, optional)
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        members = _members(inner[0])
        if len(inner) == 2 and inner[1] is Ellipsis and all(_is_part(h) for h in members):
            return PartTable(members, required, optional)
    if all(_is_option(h) for h in _members(hint)):
        return Option(hint, required, optional)
    return Unreadable(required)


def _descendants(base: type):
    yield base
    for child in base.__subclasses__():
        yield from _descendants(child)


def _members(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a union, or the hint alone."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return typing.get_args(hint)
    return (hint,)


def _is_part(hint: Any) -> bool:
    return isinstance(hint, type) and (issubclass(hint, Part) or _is_protocol(hint))


def _is_protocol(hint: Any) -> bool:
    return isinstance(hint, type) and getattr(hint, "_is_protocol", False) and hint is not Callable


def _is_option(hint: Any) -> bool:
    if typing.get_origin(hint) is tuple:
        inner = [h for h in typing.get_args(hint) if h is not Ellipsis]
        return all(_is_option(member) for h in inner for member in _members(h))
    return hint in (bool, int, str, type(None)) or typing.get_origin(hint) is Literal


def _fits(hint: Any, value: Any) -> bool:
    members = _members(hint)
    if len(members) > 1:
        return any(_fits(member, value) for member in members)
    if hint is type(None):
        return value == "none"
    if typing.get_origin(hint) is Literal:
        return value in typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        if not isinstance(value, list):
            return False
        if len(inner) == 2 and inner[1] is Ellipsis:
            return all(_fits(inner[0], item) for item in value)
        return len(value) == len(inner) and all(map(_fits, inner, value))
    return type(value) is hint


def _branch(hint: Any, value: Any) -> Any:
    return next(member for member in _members(hint) if _fits(member, value))


def _described(hint: Any) -> str:
    members = _members(hint)
    if len(members) > 1:
        return " or ".join(_described(member) for member in members)
    if typing.get_origin(hint) is Literal:
        return "one of " + ", ".join(f'"{word}"' for word in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"a list, each entry {_described(inner[0])}"
        return "a list of " + ", ".join(_described(item) for item in inner)
    names = {bool: "true or false", int: "a whole number", str: "a text", type(None): '"none"'}
    return names[hint]
