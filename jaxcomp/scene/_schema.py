"""What a machine file may say: its sections, and what each may hold, read off the class of its part."""

import dataclasses
import inspect
import re
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

# The packages that declare parts: a class can only be found by its kind once it is imported.
from .. import compressor as compressor
from .. import cylinder as cylinder
from .. import film as film
from .. import friction as friction
from .. import gas as gas
from .. import mechanism as mechanism
from .. import motor as motor
from .._core.each import AbstractEach
from .._core.extensions import ExtensionError, import_extensions
from .._core.fields import Bound, Part
from .._core.words import did_you_mean
from ..compressor import Compressor
from ..film import AbstractJournal, AbstractOil, NamedBearing

# Sections beside those of the compressor: name of the section, class of its part (which may be
# abstract: then `type` selects one of its subclasses). A class in the form "package:name" is
# imported when a file has the section.
SECTIONS: dict[str, type[Part] | str] = {
    "rotor": "jaxcomp.rotor:RotorModel",
    "loads": "jaxcomp.rotor:LoadCase",
    "balancing": "jaxcomp.rotor:BalancingPlanes",
    "suspension": "jaxcomp.vibration:Suspension",
    "torsion": "jaxcomp.crank:CrankTrain",
}

# Sections that hold named sections: what each of those describes.
NAMED: dict[str, type[Part]] = {"bearings": AbstractJournal, "oils": AbstractOil}


class Number(NamedTuple):
    """A float array with unit and bound.

    With `spread` a single value may stand for a list, with `each` a list over several cylinders for it.
    """

    unit: str
    bound: Bound
    shape: tuple[int | None, ...]
    required: bool
    doc: str
    spread: bool
    each: bool = False


class Option(NamedTuple):
    """A choice that is no quantity: a word, a name, a count, or tuples of them."""

    hint: Any
    required: bool


class Section(NamedTuple):
    """A part inside the part, of one of several classes, or with `rows` a row of such parts."""

    classes: tuple[type, ...]
    required: bool
    rows: bool = False

    def title(self, path: str) -> str:
        """The heading of the section in a file."""
        return f"[[{path}]]" if self.rows else f"[{path}]"


class Unreadable(NamedTuple):
    """Something that a file cannot hold, such as a function."""

    required: bool


Entry = Number | Option | Section | Unreadable


def join(path: str, key: str) -> str:
    """Dotted path of a key in a section."""
    return f"{path}.{key}" if path else key


def imported(part: type[Part] | str) -> type[Part]:
    """The class of a section of `SECTIONS`."""
    if not isinstance(part, str):
        return part
    package, _, name = part.partition(":")
    return getattr(import_module(package), name)


def top_sections() -> dict[str, Section]:
    """The sections of a file, in order, but for those with names of their own (`NAMED`)."""
    sections = {}
    for name, entry in entries(Compressor).items():
        if isinstance(entry, Section):
            sections[name] = entry
    for name, part in SECTIONS.items():
        sections[name] = Section((imported(part),), False)
    return sections


def given_sections(document: Mapping[str, Any]) -> Iterator[tuple[str, Section, Any]]:
    """The sections that a file has: path, what may stand there, and table."""
    for name, entry in top_sections().items():
        if name in document:
            yield name, entry, document[name]
    for section, part in NAMED.items():
        for name, table in document.get(section, {}).items():
            if name != "source":
                yield join(section, name), Section((part,), False), table


@cache
def every_place() -> tuple[tuple[str, str, type[Part]], ...]:
    """Heading, kind and class of all that may stand anywhere in a file."""
    sections = top_sections()
    for name, part in NAMED.items():
        sections[f"{name}.NAME"] = Section((part,), False)
    return tuple(_places_in(sections, "", ()))


def _places_in(section_entries: Mapping[str, Entry], above: str, inside: tuple[type, ...]):
    for name, entry in section_entries.items():
        if not isinstance(entry, Section):
            continue
        path = join(above, name)
        for kind, part in choices(entry.classes).items():
            if part is NamedBearing and path.endswith(".NAME"):
                continue  # a description is no name
            yield entry.title(path), kind, part
            if part not in inside:
                yield from _places_in(entries(part), path, (*inside, part))


def holders(key: str) -> tuple[str, ...]:
    """Headings of the sections that may have an entry, without those inside others of them."""
    titles = []
    for title, _, part in every_place():
        if key in entries(part) and title not in titles:
            titles.append(title)
    return tuple(titles)


@cache
def entries(part: type[Part]) -> dict[str, Entry]:
    """Entries of a section that describes a part of this class, by key."""
    hints = typing.get_type_hints(part)
    each = part.for_each_cylinder
    by_key = {}
    for field in dataclasses.fields(part):
        if field.init and not field.metadata.get("derived"):
            by_key[field.name] = _entry(field, hints[field.name], each)
    return by_key


@cache
def meanings(part: type[Part]) -> dict[str, str]:
    """Meaning of each entry of a section, in words: of its declaration or of the class's
    documentation.
    """
    _, _, text = (inspect.getdoc(part) or "").partition("Args:\n")
    block = re.split(r"\n\S", text)[0]
    arguments = {}
    for name, words in re.findall(r"^    (\w+): (.*(?:\n     +.*)*)", block, re.MULTILINE):
        # without unit and shape, which the declaration has
        plain = re.sub(r"^\[[^]]*\](?: \([^)]*\))?,? ?", "", words)
        arguments[name] = " ".join(plain.split()).rstrip(".")
    descriptions = {}
    for name, entry in entries(part).items():
        descriptions[name] = getattr(entry, "doc", "") or arguments.get(name, "")
    return descriptions


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
    by_kind: dict[str, type[Part]] = {}
    for base in classes:
        is_protocol = _is_protocol(base)
        root = Part if is_protocol else base
        for part in _descendants(root):
            if is_protocol and not issubclass(part, base):
                continue
            if _in_files(part):
                _check_kind(part, by_kind.get(kind_of(part), part))
                by_kind[kind_of(part)] = part
    return by_kind


def _in_files(part: type[Part]) -> bool:
    """Whether a class is a concrete one that a file can describe."""
    if inspect.isabstract(part) or part.__name__.startswith("Abstract"):
        return False
    if not getattr(part, "in_files", True):  # some laws only the solvers make
        return False
    needed = [entry for entry in entries(part).values() if entry.required]
    return not any(isinstance(entry, Unreadable) for entry in needed)


def _check_kind(part: type[Part], other: type[Part]) -> None:
    """That no class of another package takes the kind of one of this package."""
    package = __name__.partition(".")[0] + "."
    if other.__module__.startswith(package) and not part.__module__.startswith(package):
        raise ExtensionError(
            f'{part.__module__}.{part.__qualname__} has the kind "{kind_of(part)}" of '
            f"{other.__module__}.{other.__qualname__}; give it another `kind`."
        )


def option_value(hint: Any, value: Any) -> Any:
    """The value that the class wants: tuples for lists, `None` for the word `none`.

    Raises:
        ValueError: with what the option must be.
    """
    members = _members(hint)
    if len(members) > 1:
        for member in sorted(members, key=lambda alternative: alternative is not type(None)):
            with suppress(ValueError):
                return option_value(member, value)
    elif hint is type(None) and value == "none":
        return None
    elif typing.get_origin(hint) is Literal and value in typing.get_args(hint):
        return value
    elif typing.get_origin(hint) is tuple and isinstance(value, list):
        inner = typing.get_args(hint)
        if len(inner) == 2 and inner[1] is Ellipsis:
            inner = inner[:1] * len(value)
        if len(inner) == len(value):
            with suppress(ValueError):
                return tuple(map(option_value, inner, value))
    elif type(value) is hint:
        return value
    raise ValueError(f"must be {_described(hint)}{_near_word(members, value)}")


def _near_word(members: tuple[Any, ...], value: Any) -> str:
    """The word of some hints that a wrong one is near to, as the end of a message."""
    words = []
    for member in members:
        for word in typing.get_args(member):
            if isinstance(word, str):
                words.append(word)
    if not words or not isinstance(value, str):
        return ""
    near = did_you_mean(value, words)
    if "did you mean" not in near:  # all that is known stands in front of it
        return ""
    return near


def expected(entry: Entry) -> str:
    """Expectation of an entry, with unit and bound, as the end of a sentence."""
    if isinstance(entry, Number):
        return _expected_number(entry)
    if isinstance(entry, Section) and not entry.rows:
        return f"a section of type {' or '.join(sorted(choices(entry.classes)))}"
    if isinstance(entry, Option):
        return _described(entry.hint)
    return "given"


def _expected_number(entry: Number) -> str:
    kind = "a number"
    if entry.spread:
        kind = "a number or a list of numbers"
    elif entry.shape:
        kind = "a list of numbers"
    bound = f" {entry.bound}"
    if bound == " finite":  # as every number is
        bound = ""
    unit = f"[{entry.unit}]" if entry.unit else "pure"
    doc = f", {entry.doc}" if entry.doc else ""
    return f"{kind}{bound} {unit}{doc}"


def _entry(field: dataclasses.Field, hint: Any, each: bool) -> Entry:
    none = dataclasses.MISSING
    required = field.default is none and field.default_factory is none
    if "unit" in field.metadata:
        declared = field.metadata
        return Number(
            unit=declared["unit"],
            bound=declared["bound"],
            shape=declared["shape"],
            required=required,
            doc=declared["doc"],
            spread=declared["spread"],
            each=each and declared["shape"] == (),
        )
    options = tuple(member for member in _members(hint) if member is not type(None))
    if options and all(map(_is_part, options)):
        return Section(options, required)
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        members = _members(inner[0])
        if len(inner) == 2 and inner[1] is Ellipsis and all(map(_is_part, members)):
            return Section(members, required, rows=True)
    if _is_option(hint):
        return Option(hint, required)
    return Unreadable(required)


def _descendants(base: type):
    yield base
    # what holds for single cylinders comes behind what holds for all
    for child in sorted(
        base.__subclasses__(), key=lambda subclass: issubclass(subclass, AbstractEach)
    ):
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
    if len(_members(hint)) > 1:
        return all(map(_is_option, _members(hint)))
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        return all(_is_option(member) for member in inner if member is not Ellipsis)
    return hint in (bool, int, str, type(None)) or typing.get_origin(hint) is Literal


def _described(hint: Any) -> str:
    members = _members(hint)
    if len(members) > 1:
        return " or ".join(map(_described, members))
    if typing.get_origin(hint) is Literal:
        return "one of " + ", ".join(f'"{word}"' for word in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"a list, each entry {_described(inner[0])}"
        return "a list of " + ", ".join(map(_described, inner))
    names = {bool: "true or false", int: "a whole number", str: "a text", type(None): '"none"'}
    return names[hint]
