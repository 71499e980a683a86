"""How long the programs of a task took to compile before, so that a wait is told once for all of them.

A task is a command of the program, and machines of one kind are told apart by the size of the first
long program: the texts of their programs are alike. What was measured on this machine stands in a file
beside the programs that are kept. At a first start it is `usual_waits.json`, measured elsewhere with
`python tests/tools/usual_waits.py`, at the pace of this machine as soon as that is known. Of other tasks
a program is told by itself, with the seconds that a byte of text takes.
"""

import contextlib
import functools
import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

FILE = "waits.json"
USUAL = Path(__file__).with_name("usual_waits.json")
# [s] that one byte of a program's text takes to compile: 16 to 28 s for 566 kB (a machine with valves).
_PER_BYTE = 4e-5
# First programs that differ by more are those of another kind of machine.
_ALIKE = 1.3
# What is remembered; the oldest goes first.
_MOST = 100


class Wait(NamedTuple):
    """Compiling that a task did.

    Attributes:
        task: such as "run", or "run --out" with pictures and files.
        first: [bytes] text of the first long program.
        programs: number of programs.
        size: [bytes] text of all of them.
        seconds: that all of them took.
    """

    task: str
    first: int
    programs: int
    size: int
    seconds: float


def earlier_waits(folder: Path | None) -> list[Wait]:
    """Waits on this machine, the newest last; none where the file is absent or damaged."""
    if folder is None:
        return []
    return _read(folder / FILE)


@functools.cache
def usual_waits() -> list[Wait]:
    """Waits at first starts of usual tasks, measured elsewhere."""
    return _read(USUAL)


def _read(file: Path) -> list[Wait]:
    try:
        waits = []
        for task, first, programs, size, seconds in json.loads(file.read_text("utf-8")):
            waits.append(Wait(str(task), int(first), int(programs), int(size), float(seconds)))
    except (OSError, ValueError, TypeError):
        return []
    return [wait for wait in waits if wait.size > 0 and wait.seconds > 0]


def remember(folder: Path, wait: Wait) -> None:
    """Keep a wait for later starts, in the place of an earlier one of the same kind."""
    different = [earlier for earlier in earlier_waits(folder) if not _is_alike(earlier, wait)]
    rows = [list(row) for row in [*different, wait][-_MOST:]]
    with contextlib.suppress(OSError):  # no room, or nothing may be written
        # written aside and renamed: other processes read the file at any moment
        handle, aside = tempfile.mkstemp(".aside", dir=folder)
        with open(handle, "w", encoding="utf-8") as file:
            json.dump(rows, file)
        os.replace(aside, folder / FILE)


def seconds_of(size: int, waits: Iterable[Wait]) -> float:
    """Seconds that programs of so many bytes take to compile, by what others took on this machine."""
    measured = list(waits)
    if not measured:
        return size * _PER_BYTE
    # of the sums and not a mean of ratios: long programs are what somebody waits for
    seconds = sum(wait.seconds for wait in measured)
    return size * seconds / sum(wait.size for wait in measured)


def expected(task: str, first: int, waits: list[Wait]) -> Wait | None:
    """Wait of a task whose first long program has so many bytes; `None` if nobody knows such a task."""
    present = Wait(task, first, 1, first, 0.0)
    earlier = _latest_alike(waits, present)
    if earlier is not None:
        return earlier
    usual = _latest_alike(usual_waits(), present)
    if usual is None:
        return None
    return usual._replace(seconds=usual.seconds * _pace(waits))


def remaining(wait: Wait | None, programs: int, size: int) -> Wait | None:
    """Part of a wait behind so many programs of so many bytes, compiled or read."""
    if wait is None or size >= wait.size:
        return None
    open_size = wait.size - size
    seconds = wait.seconds * open_size / wait.size
    return wait._replace(programs=wait.programs - programs, size=open_size, seconds=seconds)


def _pace(waits: list[Wait]) -> float:
    """Seconds on this machine over those elsewhere, of tasks that both have done."""
    measured_seconds = 0.0
    usual_seconds = 0.0
    for wait in waits:
        usual = _latest_alike(usual_waits(), wait)
        if usual is not None:
            measured_seconds += wait.seconds
            usual_seconds += usual.seconds
    return measured_seconds / usual_seconds if usual_seconds else 1.0


def _latest_alike(waits: list[Wait], present: Wait) -> Wait | None:
    for wait in reversed(waits):
        if _is_alike(wait, present):
            return wait
    return None


def _is_alike(wait: Wait, other: Wait) -> bool:
    ratio = wait.first / other.first
    return wait.task == other.task and 1 / _ALIKE < ratio < _ALIKE
