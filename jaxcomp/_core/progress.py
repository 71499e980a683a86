"""Words on standard error while something takes its time: compiling, and work that comes in pieces.

`JAXCOMP_WAITS=off`, set before the import, keeps all of them away.
"""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .waits import Wait, earlier_waits, expected, remaining, remember, seconds_of

# [s] Compiling for longer than this is told; between two lines of progress.
_AFTER = 2.0
_EVERY = 10.0
# [bytes] Programs of a shorter text are sums and copies, of which nobody wants to know the number.
_COUNTED = 12_000
# [bytes] The first program of a longer text says what kind of machine the task has.
_LONG = 30_000
_PACKAGE = str(Path(__file__).parents[1])
# What functions compute, in words; "the results" of all others.
_COMPUTES = {
    "solve_orbit": "the steady state", "orbit": "the steady state", "solve_cycle": "the cycle",
    "simulate": "the motion", "sensitivity": "the gains", "gains": "the gains",
    "optimise": "the search", "pareto": "the search", "improve": "the search",
    "sweep": "the designs", "sweep_machines": "the designs", "tolerance": "the tolerances",
    "balance": "the balance", "rating_map": "the map", "identify": "the fit",
    "steady_state": "the steady state", "load_steps": "the load steps", "rotor_at": "the rotor",
    "rotor_motion": "the vibration", "rotor_modes": "the modes", "undamped_modes": "the modes",
    "critical_speeds": "the critical speeds", "machine_influence": "the influence of the planes",
    "compare": "the comparison", "accuracy": "the settings", "page": "the desk", "serve": "the desk",
    "check": "the values that follow", "run": "the steady state", "modes": "the modes",
    "respond": "the vibration", "animate": "the pictures",
}  # fmt: skip
# Files whose functions nobody calls by name.
_UNNAMED = (f"{os.sep}cli{os.sep}", f"{os.sep}_core{os.sep}", "__main__.py")


class _Compiles:
    """Whether compiling is told, for which task and machine, and what was compiled so far."""

    announced = False
    task = ""
    machine = ""
    status: Any = None  # of rich, which shows that something goes on; it says what compiles
    folder: Any = None  # called for the folder in which waits are remembered
    first = 0  # [bytes] of the first long program, compiled or read
    programs = 0  # compiled or read so far
    size = 0  # [bytes] of all of them
    before = 0.0  # [s] of compiling when the task began
    loaded = False  # whether a program was there already, so that not all of them were compiled
    total = ""  # what was told of all programs
    lock = threading.RLock()  # several threads compile at once


def watch_compiles(machine: str = "", task: str = "") -> None:
    """From now on say so before a program compiles for more than two seconds.

    The command line does; elsewhere `JAXCOMP_WAITS=on` does as much, and a notebook unasked: of whole
    solutions, and after `keep_programs` of all programs.

    Args:
        machine: name of the machine.
        task: that begins, under which its waits are remembered, such as `run` or `run --out`.
    """
    _Compiles.announced = True
    if machine:
        _Compiles.machine = machine
    if task:
        _Compiles.task = task
        _Compiles.first = _Compiles.programs = _Compiles.size = 0
        _Compiles.before = compile_time.seconds
        _Compiles.loaded = False
        _Compiles.total = ""


def remember_waits() -> None:
    """The task is done: keep how long its programs compiled, if all of them did."""
    folder = _folder()
    if not _Compiles.first or _Compiles.loaded or folder is None:
        return
    seconds = compile_time.seconds - _Compiles.before
    wait = Wait(_Compiles.task, _Compiles.first, _Compiles.programs, _Compiles.size, seconds)
    remember(folder, wait)


def count_loaded(size: int) -> None:
    """A program of so many bytes was read, and did not compile."""
    if size >= _COUNTED:
        _Compiles.loaded = True
        _count(size)


def _count(size: int) -> None:
    _Compiles.programs += 1
    _Compiles.size += size
    if size >= _LONG and not _Compiles.first:
        _Compiles.first = size


def remember_in(folder: Callable[[], Path | None]) -> None:
    """Where waits are remembered."""
    _Compiles.folder = staticmethod(folder)


def _folder() -> Path | None:
    return _Compiles.folder and _Compiles.folder()


def watched() -> bool:
    """Whether somebody waits for a command, who is told how long it takes."""
    return _Compiles.announced


@contextmanager
def compiling(size: int, cached: bool = False, purpose: str = "") -> Iterator[None]:
    """A program of so many bytes is compiled; say so before if that takes long.

    Args:
        size: [bytes] of its text.
        cached: whether later processes find it compiled.
        purpose: words on what it is compiled for, where that is not the first call.
    """
    # the words alone are made one at a time: programs compile side by side
    with _Compiles.lock:
        text = _words_before(size, cached, purpose)
    status = _Compiles.status
    if not text or status is None:
        yield
        return
    before = status.status
    status.update(f"{text[0].upper()}{text[1:]} ...")
    try:
        yield
    finally:
        status.update(before)


def _words_before(size: int, cached: bool, purpose: str) -> str:
    """Sentence for a program that takes long, which is told if nothing shows it; "" for others."""
    before = (_Compiles.programs, _Compiles.size)
    if size >= _COUNTED:
        _count(size)
    by_setting = os.environ.get("JAXCOMP_WAITS", "").lower() in ("on", "1", "yes")
    requested = _Compiles.announced or by_setting or _in_notebook()
    if not requested or not shows_waits():
        return ""
    # a file is read, which programs that nobody waits for have no need of
    waits = earlier_waits(_folder())
    seconds = seconds_of(size, waits)
    if seconds < _AFTER:
        return ""
    # what was told of all programs of the task covers this one
    if _Compiles.total and not purpose:
        return _Compiles.total
    text, is_total = _forecast(size, seconds, before, waits)
    if purpose:
        text += f", {purpose}"
    elif cached:
        text += "; later starts are quicker"
    if is_total and not purpose:
        _Compiles.total = text
    if _Compiles.status is None:
        tell(text)
    return text


def _forecast(
    size: int, seconds: float, before: tuple[int, int], waits: list[Wait]
) -> tuple[str, bool]:
    """Sentence on a program that takes long; whether it speaks of all that the task has left.

    Args:
        size: [bytes] of the program.
        seconds: that it takes.
        before: number and size of the programs before it.
        waits: on this machine.
    """
    machine = ""
    if _Compiles.machine:
        machine = f" of {_Compiles.machine}"
    open_wait = None
    if _Compiles.first:
        open_wait = remaining(expected(_Compiles.task, _Compiles.first, waits), *before)
    if open_wait is None or open_wait.programs <= 1 or open_wait.size < size:
        return f"compiling {_called()}{machine}, about {_about(seconds)}", False
    programs = f"{open_wait.programs} programs for {_called()}{machine}"
    return f"compiling {programs}, about {_about(open_wait.seconds)} in all", True


def _in_notebook() -> bool:
    """Whether the cell of a notebook runs, where nobody sees that something goes on."""
    if "ipykernel" not in sys.modules:
        return False
    from IPython import get_ipython

    return getattr(get_ipython(), "kernel", None) is not None


def _called() -> str:
    """Task of the outermost function of this package that runs and has a public name."""
    frame = sys._getframe(1)
    name = ""
    while frame is not None:
        file = frame.f_code.co_filename
        word = frame.f_code.co_name
        if file.startswith(_PACKAGE) and not any(place in file for place in _UNNAMED):
            inner = word.startswith(("_", "<")) or "<locals>" in frame.f_code.co_qualname
            if not inner:
                name = word
        frame = frame.f_back
    # what a thread of its own compiles has no such function above it
    command = _Compiles.task.partition(" ")[0]
    return _COMPUTES.get(name) or _COMPUTES.get(command, "the results")


def shows_waits() -> bool:
    """Whether anything is said at all."""
    return os.environ.get("JAXCOMP_WAITS", "on").lower() not in ("off", "0", "no")


@contextmanager
def spinner(text: str) -> Iterator[None]:
    """Show that something goes on, if standard error is a terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal or not shows_waits():
        yield
        return
    try:
        with console.status(text) as _Compiles.status:
            yield
    finally:
        _Compiles.status = None


class _CompileTime:
    """Time in which something was compiled, by one thread or by several at once."""

    def __init__(self):
        self.seconds = 0.0  # in all
        self._lock = threading.Lock()
        self._running = 0
        self._begun = 0.0

    def __enter__(self) -> None:
        with self._lock:
            if self._running == 0:
                self._begun = time.monotonic()
            self._running += 1

    def __exit__(self, *error) -> None:
        with self._lock:
            self._running -= 1
            if self._running == 0:
                self.seconds += time.monotonic() - self._begun


# No forecast of further work includes it.
compile_time = _CompileTime()


class Progress:
    """Progress of some work, with the time that is left.

    The time follows from what the pieces so far took on this machine: of the first one without the
    compiling of its programs, and without the first one, which ends their tracing, as soon as there are
    more.
    """

    def __init__(
        self,
        text: str,
        total: int | None,
        finished: int,
        unit: str,
        bar=None,
        told_at: float | None = None,
    ):
        self._text = text
        self._total = total
        self._unit = unit
        self._bar = bar
        begun = time.monotonic()
        self._told_at = begun if told_at is None else told_at
        self._start = (begun - compile_time.seconds, finished)
        self._first: tuple[float, int] | None = None
        self._last = self._start
        if bar is not None:
            self._task = bar.add_task(text, total=total, completed=finished, left="")

    def at(
        self, finished: int, total: int | None = None, text: str = "", is_limit: bool = False
    ) -> None:
        """Show that so many are done, of so many; `text` says at what the work is.

        Args:
            finished: pieces so far; fewer than before where other work begins.
            total: pieces in all, if that is known only now.
            text: what is worked on now.
            is_limit: whether there may be fewer pieces in all.
        """
        self._total = total or self._total
        self._text = text or self._text
        instant = time.monotonic()
        mark = (instant - compile_time.seconds, finished)
        # other work begins, of whose pace the pieces so far say nothing
        if finished < self._last[1]:
            self._start = (self._last[0], 0)
            self._first = None
        begun, before = self._first or self._start
        if self._first is None and finished > before:
            self._first = mark
        self._last = mark
        remaining = ""
        at_most = "at most " if is_limit else ""
        if self._total and finished > before:
            # compiling counts when it ends, and may have begun before these pieces: below zero then
            seconds = (self._total - finished) * max(mark[0] - begun, 0.0) / (finished - before)
            # what rounds to nothing is left out: after the first piece it may be compiling alone
            if seconds >= 0.5:
                remaining = f"{at_most}{_span(seconds)} left"
        if self._bar is not None:
            self._bar.update(
                self._task,
                completed=finished,
                total=self._total,
                description=self._text,
                left=remaining,
            )
        elif instant - self._told_at > _EVERY and finished != self._total and shows_waits():
            self._told_at = instant
            of_total = f" of {at_most}{self._total:,}" if self._total else ""
            line = f"{self._text}: {finished:,}{of_total} {self._unit}"
            if remaining:
                line += f", {remaining}"
            tell(line)


@contextmanager
def progress_of(
    text: str, total: int | None = None, finished: int = 0, unit: str = "", show: bool = True
) -> Iterator[Progress]:
    """Progress on standard error: a bar on a terminal, elsewhere a line every ten seconds.

    Args:
        text: what is worked on.
        total: pieces in all, if that is known.
        finished: pieces that were there before.
        unit: what the pieces are.
        show: whether to show anything.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not show or not shows_waits():
        # told in the far future, so that there is never a line
        yield Progress(text, total, finished, unit, told_at=float("inf"))
    elif not console.is_terminal:
        yield Progress(text, total, finished, unit)
    else:
        from rich import progress as rich

        columns = ("{task.description}", rich.BarColumn(), rich.MofNCompleteColumn(),
                   unit, rich.TimeElapsedColumn(), "{task.fields[left]}")  # fmt: skip
        with rich.Progress(*(c for c in columns if c), console=console, transient=True) as bar:
            yield Progress(text, total, finished, unit, bar)


def tell(text: str) -> None:
    """One line on standard error."""
    # at once, so that lines of several threads do not meet
    sys.stderr.write(f"jaxcomp: {text}\n")
    sys.stderr.flush()


def _about(seconds: float) -> str:
    """A time to one digit: 40 s, 2 min."""
    if seconds < 90:
        return f"{float(f'{seconds:.1g}'):.0f} s"
    return f"{round(seconds / 60)} min"


def _span(seconds: float) -> str:
    total = round(seconds)
    if total < 3600:
        return f"{total // 60}:{total % 60:02d}"
    return f"{total // 3600}:{total // 60 % 60:02d}:{total % 60:02d}"
