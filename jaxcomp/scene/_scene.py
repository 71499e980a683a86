"""Scene files: a machine with the source of every value, read from TOML."""

import contextlib
import copy
import dataclasses
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from functools import cached_property
from importlib import import_module, resources
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._fields import BadInput, Part
from .._registry import DESIGN_RULES
from .._words import did_you_mean, hint
from ..compressor import Compressor, single_numbers
from ..film import AbstractJournal, AbstractOil
from ..machine import Assembly, Machine, assembled, correction_planes
from ._csv import with_tables
from ._dump import is_section, toml_text_like
from ._errors import SceneError
from ._read import MOST_HINTS, Reader, join
from ._schema import entries
from ._toml import check_tables, toml_tables
from ._units import to_si
from ._write import set_value, updated

# Sections beside those of the compressor: name of the section, class of its part (which may be
# abstract: then `type` selects one of its subclasses). A class in the form "package:name" is
# imported when a file has the section.
SECTIONS: dict[str, type[Part] | str] = {
    "rotor": "jaxcomp.rotor:RotorModel",
    "loads": "jaxcomp.rotor:LoadCase",
    "balancing": "jaxcomp.rotor:BalancingPlanes",
    "suspension": "jaxcomp.shaking:Suspension",
    "torsion": "jaxcomp.crank:CrankTrain",
}

# Sections that hold named sections: what each of those describes.
NAMED: dict[str, type[Part]] = {"bearings": AbstractJournal, "oils": AbstractOil}

_HEADER = ("name", "description", "source")


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """What a scene file describes.

    Attributes:
        name: short name of the machine.
        description: one line on it.
        machine: all its numbers, each once; `assembled` puts it together.
        sources: source of each given value by dotted path; empty text where none is named.
        file: name of the file, for messages.
        document: the tables as they were read, for `dump` and `with_values`; not to be changed.
        text: the file that they come from, whose comments `dump` keeps.
    """

    name: str
    description: str
    machine: Machine
    sources: Mapping[str, str]
    file: str
    document: Mapping[str, Any]
    text: str = ""

    @cached_property
    def assembly(self) -> Assembly:
        """The machine put together, as the solvers take it."""
        return assembled(self.machine)

    @property
    def compressor(self) -> Compressor | None:
        """The compressor put together; `None` if the file has none of its sections."""
        return self.assembly.compressor

    @property
    def parts(self) -> Mapping[str, Part]:
        """The parts of the sections beside the compressor, as they stand in the file, by section."""
        return self.machine.parts

    def as_compressor(self) -> Compressor:
        """The compressor put together, where one is needed.

        Raises:
            SceneError: the scene has none.
        """
        if self.compressor is None:
            raise SceneError(
                "mechanism", "is missing: this scene describes no compressor", file=self.file
            )
        return self.compressor


class Bundled(NamedTuple):
    """A bundled machine.

    Attributes:
        name: as `load` takes it.
        description: one line.
    """

    name: str
    description: str


def load(name_or_path: str | os.PathLike) -> Scene:
    """Read a scene file.

    Args:
        name_or_path: name of a bundled machine (see `machines`) or path of a TOML file.

    Raises:
        SceneError: the file cannot be found or read, an unknown key, a missing key or part, a
            value of another dimension or outside its bound. It names file, key, value and bound.

    >>> scene = load("mayekawa-wbhe")
    >>> float(scene.compressor.mechanism.bore), scene.sources["mechanism.bore"]
    (0.13, 'printed, Table 1')
    >>> load("mayekawa-wbeh")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    jaxcomp.scene._errors.SceneError: no machine ... "mayekawa-wbeh"; did you mean "mayekawa-wbhe"?
    """
    given = os.fspath(name_or_path)
    path = Path(given)
    if given in _bundled():
        file, read = f"{given}.toml", _bundled()[given].read_bytes
    elif path.exists():
        file, read = given, path.read_bytes
    elif path.suffix == ".toml":
        files = (str(other) for other in path.parent.glob("*.toml"))
        raise SceneError("", f"cannot be read: No such file{hint(given, files)}", file=given)
    else:
        file = f"{given}.toml"
        near = (
            f'; did you mean "{file}"?' if Path(file).exists() else did_you_mean(given, _bundled())
        )
        raise SceneError("", f'no machine and no file has the name "{given}"{near}')
    try:
        return loads(read(), file)
    except OSError as error:
        raise SceneError("", f"cannot be read: {error.strerror}", file=file) from None


def loads(text: str | bytes, file: str = "") -> Scene:
    """Read a scene from TOML text.

    Args:
        text: the scene; bytes are UTF-8.
        file: its name in messages.

    Raises:
        SceneError: as `load`.
    """
    document = toml_tables(text, file)
    text = text if isinstance(text, str) else text.decode("utf-8")
    return _scene(document, file, text=text.removeprefix("\ufeff"))


def dump(scene: Scene) -> str:
    """TOML text that `loads` reads back to the same scene, with the comments of its file."""
    return toml_text_like(scene.text, scene.document)


def machines() -> tuple[Bundled, ...]:
    """The bundled machines, by name."""
    found = []
    for name, file in sorted(_bundled().items()):
        header = tomllib.loads(file.read_text("utf-8"))
        found.append(Bundled(name, header.get("description", "")))
    return tuple(found)


def with_values(scene: Scene, changes: Mapping[str, Any], source: str = "set by the user") -> Scene:
    """A copy of a scene with other values, checked as a file is.

    Args:
        scene: the scene.
        changes: value by dotted path, all set before anything is checked. A value is a number, a
            text with a unit, a list, a table (a whole section) or `None`, which takes an optional
            value or part away. A new `type` keeps those keys of its section that the new class
            knows as well. A path may be a pattern (see `jaxcomp.design.matching`). Design rules and
            correction masses are set after the others, in their order.
        source: what the scene records as the source of these values.

    Raises:
        SceneError: an unknown path, or as `load`.
        BadInput: a pattern that fits no number, or a design rule that is not made for the machine.
    """
    from ..design import by_name, variable  # only who changes a scene needs the studies

    designed = {path: value for path, value in changes.items() if _is_designed(path)}
    given = {path: value for path, value in changes.items() if path not in designed}
    if given:
        scene = _with_entries(scene, given, source)
    for name, value in by_name(scene.machine, designed).items():
        one = variable(scene.machine, name)
        machine = one.apply(scene.machine, to_si(value, one.unit, name))
        scene = with_machine(scene, machine, f"design rule, {name} = {value}")
    return scene


def with_lists(scene: Scene, paths: Iterable[str]) -> Scene:
    """A scene in which numbers that are named for single cylinders are lists over the cylinders.

    Args:
        scene: with several cylinders; any other stays as it is.
        paths: such as "mechanism.bore.2", of the third cylinder, or "mechanism.bore.*"; those that
            name something else change nothing.
    """
    from ..design import matching, variable

    if scene.compressor is None or scene.compressor.cylinders is None:
        return scene
    single = single_numbers(scene.compressor)
    changes = {}
    for path in paths:
        stem, _, last = path.rpartition(".")
        if not (last.isdigit() or "*" in last):
            continue
        with contextlib.suppress(BadInput):
            matching(scene.machine, path)
            continue
        for name in (name for name in single if fnmatchcase(name, stem)):
            table = _entry(scene.document, name)
            if "value" not in table:
                value = float(variable(scene.machine, name).current(scene.machine))
                table = {"value": f"{value} {single[name]}".strip(), "source": "default"}
            changes[name] = {**table, "value": [table["value"]] * scene.compressor.cylinders.count}
    return _with_entries(scene, changes, "") if changes else scene


def _entry(document: Mapping[str, Any], path: str) -> dict[str, Any]:
    """The table of a value with its source as it was read; empty where none is given."""
    node: Any = document
    for key in path.split("."):
        node = node.get(key, {})
    return dict(node) if isinstance(node, Mapping) else {"value": node}


def _is_designed(path: str) -> bool:
    return path in DESIGN_RULES or path.startswith("corrections.")


def _with_entries(scene: Scene, changes: Mapping[str, Any], source: str) -> Scene:
    """A copy of a scene with other entries of its file."""
    from ..design import matching, variable_names

    scene = with_lists(scene, changes)
    known = {*entries(Compressor), *_HEADER, *SECTIONS, *NAMED}
    for path in changes:
        if "." not in path and path not in known and not any(_places(scene.document, path)):
            names = known | ({*DESIGN_RULES} & {*variable_names(scene.machine)})
            near = did_you_mean(path, names)
            raise SceneError(path, f"is no section and no design rule{near}", file=scene.file)
    changes = {
        name: value
        for path, value in changes.items()
        for name in (matching(scene.machine, path) if "*" in path else [path])
    }
    document = copy.deepcopy(dict(scene.document))
    stale: set[str] = set()
    try:
        # a new type first: it decides which keys of its section stay
        for path in sorted(changes, key=lambda p: p.split(".")[-1] != "type"):
            stale |= set_value(document, path, changes[path], source)
    except SceneError as error:
        raise error.in_file(scene.file) from None
    return _scene(document, scene.file, stale - set(changes), scene.text, scene.machine.corrections)


def with_value(scene: Scene, path: str, value: Any, source: str = "set by the user") -> Scene:
    """`with_values` for a single value.

    Args:
        scene: the scene, which stays as it is.
        path: dotted path of the entry.
        value: number in SI units, text with a unit, or list; `None` takes an optional one away.
        source: where it comes from, for the tables.
    """
    return with_values(scene, {path: value}, source)


def with_machine(scene: Scene, machine: Machine, source: str) -> Scene:
    """A copy of a scene with another machine; its document says so with every digit.

    Args:
        scene: the scene.
        machine: with the same sections; a file does not hold its corrections.
        source: what the scene records as the source of the values that differ.

    Raises:
        SceneError: a value outside its bound, or a part that a file cannot describe.
    """
    old, document = scene.machine, dict(scene.document)
    if machine.compressor is not None:
        document = updated(document, old.compressor, machine.compressor, source)
    for name, part in machine.parts.items():
        document[name] = updated(document[name], old.parts[name], part, source)
    for section in NAMED:
        for name, part in getattr(machine, section).items():
            table = dict(document[section])
            table[name] = updated(table[name], getattr(old, section)[name], part, source)
            document[section] = table
    return _scene(document, scene.file, text=scene.text, corrections=machine.corrections)


def imported(part: type[Part] | str) -> type[Part]:
    """The class of a section of `SECTIONS`."""
    if not isinstance(part, str):
        return part
    package, _, name = part.partition(":")
    return getattr(import_module(package), name)


def _check_beside(name: str, part: Part, parts: Mapping[str, Part]) -> None:
    """Let a part check what it says about the other sections, where it has a method for that."""
    check = getattr(part, "check_beside", None)
    if check is None:
        return
    try:
        check(parts)
    except BadInput as error:
        if not error.field:  # the section as a whole
            raise SceneError(name, f"must be {error.bound}") from None
        key = join(name, error.field)
        raise SceneError(key, f"must be {error.bound}", error.value) from None


def _places(table: Mapping[str, Any], key: str, path: str = "") -> Iterator[str]:
    """Paths in the sections below a table that end in a key."""
    for name, section in table.items():
        if is_section(section):
            if key in section:
                yield join(join(path, name), key)
            yield from _places(section, key, join(path, name))


def _bundled() -> dict[str, Any]:
    folder = resources.files("jaxcomp") / "machines"
    return {f.name[:-5]: f for f in folder.iterdir() if f.name.endswith(".toml")}


def _scene(
    document: dict[str, Any],
    file: str,
    stale: Iterable[str] = (),
    text: str = "",
    corrections: Mapping[str, Array] | None = None,
) -> Scene:
    try:
        document = with_tables(document, Path(file).parent)
        check_tables(document)
        return _checked_scene(document, file, stale, text, corrections or {})
    except SceneError as error:
        raise error.in_file(file) from None


def _checked_scene(
    document: dict[str, Any],
    file: str,
    stale: Iterable[str],
    text: str,
    corrections: Mapping[str, Array],
) -> Scene:
    reader, own = Reader(stale), entries(Compressor)
    for key in _HEADER:
        if not isinstance(document.get(key, ""), str):
            reader.problems.append(SceneError(key, "must be a text", document[key]))
    unknown = [key for key in document if key not in {*own, *_HEADER, *SECTIONS, *NAMED}]
    for key in unknown:
        what = "section" if is_section(document[key]) else "key"
        few = len(reader.problems) < MOST_HINTS
        places = list(_places(document, key)) if few else []
        near = did_you_mean(key, {*own, *_HEADER, *SECTIONS, *NAMED}) if few else ""
        if places:
            near = "; did you mean {}?".format(" or ".join(f'"{place}"' for place in places))
        reader.problems.append(SceneError(key, f"is an unknown {what}{near}"))
    source = document.get("source")
    compressor, parts = None, {}
    if any(key in own for key in document) or not any(key in SECTIONS for key in document):
        ignored = frozenset((*_HEADER, *SECTIONS, *NAMED, *unknown))
        compressor = reader.part(document, (Compressor,), "", source, ignored=ignored)
    for name, part in SECTIONS.items():
        if name in document:
            parts[name] = reader.part(document[name], (imported(part),), name, source)
    named = {
        name: reader.named(document.get(name, {}), (part,), name, source)
        for name, part in NAMED.items()
    }
    if reader.problems:
        first, *others = reader.problems
        raise SceneError(first.key, first.problem, first.value, others=others)
    for name, part in parts.items():
        _check_beside(name, part, parts)
    planes = correction_planes(parts.get("balancing"))
    masses = {name: corrections.get(name, jnp.zeros(2)) for name in planes}
    machine = Machine(compressor, parts, masses, **named)
    default_name = Path(file).stem or "machine"
    found = Scene(
        document.get("name", default_name),
        document.get("description", ""),
        machine,
        reader.sources,
        file,
        document,
        text,
    )
    try:
        found.assembly  # noqa: B018  names what the parts want of each other and do not find
    except BadInput as error:
        raise SceneError(error.field, f"must be {error.bound}", error.value) from None
    return found
