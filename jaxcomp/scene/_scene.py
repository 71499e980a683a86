"""Machine files: a machine with the source of every value, read from TOML."""

import dataclasses
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._core.errors import BadInput
from .._core.fields import Part, names_with_value
from .._core.files import regular
from .._core.words import did_you_mean, hint
from ..compressor import Compressor, check_runs
from ..crank import CrankTrain
from ..machine import Assembly, Machine, assembled, correction_planes
from ._cells import with_tables
from ._read import MOST_HINTS, Reader
from ._schema import NAMED, SECTIONS, entries, imported, join
from ._text import (
    SceneError,
    bundled,
    check_tables,
    is_section,
    reading,
    toml_tables,
    toml_text_like,
)

# Keys of a file beside its sections.
HEADER = ("name", "description", "source")


@names_with_value
@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """Content of a machine file.

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
                "mechanism", "is missing: this machine file describes no compressor", file=self.file
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
    """Read a machine file.

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
    jaxcomp.scene._text.SceneError: no machine ... "mayekawa-wbeh"; did you mean "mayekawa-wbhe"?
    """
    if not isinstance(name_or_path, str | os.PathLike):
        what = f"a {type(name_or_path).__name__}"
        raise SceneError("machine", "must be the name of a bundled machine or of a file", what)
    name = os.fspath(name_or_path)
    bundled_files = bundled("machines")
    path = Path(name)
    file = f"{name}.toml"
    if name in bundled_files:
        with reading(file):
            return loads(bundled_files[name].read_bytes(), file)
    if path.exists():
        with reading(name):
            return loads(regular(path).read_bytes(), name)
    if path.suffix == ".toml":
        files = (str(other) for other in path.parent.glob("*.toml"))
        raise SceneError("", f"cannot be read: No such file{hint(name, files)}", file=name)
    near = did_you_mean(name, bundled_files)
    if Path(file).exists():
        near = f'; did you mean "{file}"?'
    raise SceneError("", f'no machine and no file has the name "{name}"{near}')


def loads(text: str | bytes, file: str = "", *, beside: bool = True) -> Scene:
    """Read a scene from TOML text.

    Args:
        text: the scene; bytes are UTF-8.
        file: its name in messages.
        beside: whether CSV files that it names are read, which a text from elsewhere must not ask for.

    Raises:
        SceneError: as `load`.
    """
    document = toml_tables(text, file)
    if not isinstance(text, str):
        text = text.decode("utf-8")
    return with_springs_counted(
        scene_of(document, file, text=text.removeprefix("\ufeff"), with_csv=beside)
    )


def dump(scene: Scene) -> str:
    """TOML text that `loads` reads back to the same scene, with the comments of its file.

    Args:
        scene: as `jaxcomp.load` gives it, also with parts that have been replaced.
    """
    return toml_text_like(scene.text, scene.document)


def machines() -> tuple[Bundled, ...]:
    """The bundled machines, by name."""
    files = bundled("machines").items()
    listed = []
    for name, file in files:
        header = tomllib.loads(file.read_text("utf-8"))
        listed.append(Bundled(name, header.get("description", "")))
    return tuple(listed)


def _check_beside(
    name: str, part: Part, parts: Mapping[str, Part], compressor: Compressor | None
) -> None:
    """Let a part check what it says about the other sections, and the runs of pipe that it names."""
    try:
        getattr(part, "check_beside", lambda parts: None)(parts)
        check_runs(compressor, getattr(part, "pipes", ()), "pipes")
    except BadInput as error:
        if not error.field:  # the section as a whole
            raise SceneError(name, f"must be {error.bound}") from None
        key = join(name, error.field)
        raise SceneError(key, f"must be {error.bound}", error.value) from None


def places_of(table: Mapping[str, Any], key: str, path: str = "") -> Iterator[str]:
    """Paths in the sections below a table that end in a key."""
    for name, section in table.items():
        if is_section(section):
            if key in section:
                yield join(join(path, name), key)
            yield from places_of(section, key, join(path, name))


def scene_of(
    document: dict[str, Any],
    file: str,
    stale: Iterable[str] = (),
    text: str = "",
    corrections: Mapping[str, Array] | None = None,
    with_csv: bool = True,
) -> Scene:
    """The scene that tables describe.

    Args:
        document: the tables.
        file: name of the file, for messages.
        stale: paths of entries that are dropped where their section has no use for them.
        text: as in `Scene`.
        corrections: [kg m] unbalance that is added in correction planes, by name.
        with_csv: as in `loads`.

    Raises:
        SceneError: as `load`.
    """
    with reading(file):
        folder = None
        if with_csv:
            folder = Path(file).parent
        document = with_tables(document, folder)
        check_tables(document)
        if not document:
            raise SceneError("", "is empty; `jaxcomp new FILE` writes a machine to start from")
        machine, sources = _machine(document, Reader(stale), corrections or {})
        name = document.get("name", Path(file).stem or "machine")
        description = document.get("description", "")
        scene = Scene(name, description, machine, sources, file, document, text)
        try:
            scene.assembly  # noqa: B018  names what the parts want of each other and do not find
        except BadInput as error:
            raise SceneError(error.field, f"must be {error.bound}", error.value) from None
    return scene


def with_springs_counted(scene: Scene) -> Scene:
    """The scene, once its section `torsion` has one spring fewer than inertias.

    Asked of files and of changes to that section: another layout may be solved without it.

    Raises:
        SceneError: another count.
    """
    train = scene.parts.get("torsion")
    if isinstance(train, CrankTrain):
        with reading(scene.file):
            try:
                train.springs(scene.as_compressor())
            except BadInput as error:
                raise SceneError(error.field, f"must be {error.bound}", error.value) from None
    return scene


def _check_header(document: Mapping[str, Any], reader: Reader) -> None:
    """Report entries of the header that are no texts."""
    for key in HEADER:
        if not isinstance(document.get(key, ""), str):
            reader.problems.append(SceneError(key, "must be a text", document[key]))


def _advice_on(key: str, document: Mapping[str, Any], sections: Iterable[str]) -> str:
    """Advice in place of an unknown key at the top: where it stands in a section, or a similar one."""
    places = " or ".join(f'"{place}"' for place in places_of(document, key))
    if not places:
        return did_you_mean(key, sections)
    return f"; did you mean {places}?"


def _machine(
    document: dict[str, Any], reader: Reader, corrections: Mapping[str, Array]
) -> tuple[Machine, dict[str, str]]:
    """The parts of all sections, and where their values come from."""
    crank_drive = entries(Compressor).keys()
    sections = {*crank_drive, *HEADER, *SECTIONS, *NAMED}
    _check_header(document, reader)
    unknown = [key for key in document if key not in sections]
    for key in unknown:
        advice = ""
        if len(reader.problems) < MOST_HINTS:
            advice = _advice_on(key, document, sections)
        what = "section" if is_section(document[key]) else "key"
        reader.problems.append(SceneError(key, f"is an unknown {what}{advice}"))
    source = document.get("source")
    compressor = None
    parts = {}
    # without any section that stands alone the crank drive is what is missing
    if document.keys() & crank_drive or not document.keys() & SECTIONS.keys():
        ignored = frozenset((*HEADER, *SECTIONS, *NAMED, *unknown))
        compressor = reader.part(document, (Compressor,), "", source, ignored=ignored)
    for name, part in SECTIONS.items():
        if name in document:
            parts[name] = reader.part(document[name], (imported(part),), name, source)
    named = {}
    for name, part in NAMED.items():
        named[name] = reader.named(document.get(name, {}), (part,), name, source)
    if reader.problems:
        first, *further = reader.problems
        raise SceneError(first.key, first.problem, first.value, others=further)
    for name, part in parts.items():
        _check_beside(name, part, parts, compressor)
    planes = correction_planes(parts.get("balancing"))
    masses = {name: corrections.get(name, jnp.zeros(2)) for name in planes}
    return Machine(compressor, parts, masses, **named), reader.sources
