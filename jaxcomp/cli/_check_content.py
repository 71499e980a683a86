"""Findings of `jaxcomp check`: parts of a machine file, what follows from them, or all its errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jaxcomp as jc

from .._core.declared import BESIDE, Note, Record, part, reading, word
from ..scene._describe import left_out
from ..scene.contents import PartContent, example_values, part_contents
from ..scene.follows import follows


@dataclass(frozen=True)
class FileError(Record):
    """An error of a machine file: its place, the value there, and what is wrong with it."""

    key: str = word()
    value: Any = reading(Note("as it stands in the file"))
    problem: str = word()


@dataclass(frozen=True)
class FileErrors(Record):
    """All errors of a machine file; the keys are stable."""

    file: str = word()
    ok: bool = word()
    errors: tuple[FileError, ...] = part(FileError)


@dataclass(frozen=True)
class Consequence(Record):
    """A number that follows from the entries of a machine file."""

    what: str = word()
    value: Any = reading(BESIDE)
    unit: str = word()


@dataclass(frozen=True)
class FileContent(Record):
    """A machine file without errors.

    Attributes:
        machine, description, file: as the file has them.
        ok: True.
        parts: by section.
        examples: values that are still those of a file to start from.
        follows: what follows from the entries.
        commands: that have something to work on.
        left_out: what a scene leaves out.
        unusual: values out of their usual range.
    """

    machine: str = word()
    description: str = word()
    file: str = word()
    ok: bool = word()
    parts: dict[str, PartContent] = part(PartContent, by_name=True)
    examples: int = reading("")
    follows: tuple[Consequence, ...] = part(Consequence)
    commands: Sequence[str] = word()
    left_out: Sequence[str] = word()
    unusual: tuple[Any, ...] = word()


def error_result(file: str, errors: Sequence[jc.scene.SceneError]) -> FileErrors:
    """All errors of a file."""

    rows = []
    for error in errors:
        value = error.value
        if not isinstance(value, str | int | float | bool | None):
            value = str(value)
        rows.append(FileError(error.key, value, error.problem))
    return FileErrors(file=file, ok=False, errors=tuple(rows))


def check_result(scene: jc.scene.Scene) -> FileContent:
    """Parts, what follows from them, commands for the scene, what it leaves out, unusual values."""
    consequences = []
    for consequence in follows(scene):
        consequences.append(Consequence(*consequence))
    return FileContent(
        machine=scene.name,
        description=scene.description,
        file=scene.file,
        ok=True,
        parts=part_contents(scene),
        examples=example_values(scene),
        follows=tuple(consequences),
        commands=_commands(scene),
        left_out=list(left_out(scene)),
        unusual=tuple(jc.scene.implausible_values(scene)),
    )


def _commands(scene: jc.scene.Scene) -> list[str]:
    """The commands that have something to work on."""
    design = ["compare", "sensitivity", "optimise", "sweep", "tolerance"]
    out = []
    if scene.compressor is not None:
        out += ["run", "simulate", "animate", *design]
        if hasattr(getattr(scene.compressor.gas, "fluid", None), "saturation"):
            out += ["map"]
    if "rotor" in scene.parts:
        loads = scene.parts.get("loads")
        out += ["modes"]
        if isinstance(loads, jc.rotor.LoadCase) and (loads.loads or loads.crank):
            out += ["respond"]
        if {"loads", "balancing"} <= set(scene.parts):
            out += ["balance", *design[1:]]
    return list(dict.fromkeys(out))
