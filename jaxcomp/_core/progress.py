"""Words on standard error while something takes its time: compiling, and work that comes in pieces.

`JAXCOMP_WAITS=off`, set before the import, keeps all of them away.
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# [s] Compiling for longer than this is told; between two lines of progress.
_AFTER = 2.0
_EVERY = 10.0
# [s] that one byte of a program's text takes to compile: 16 to 28 s for 566 kB (a machine with valves).
_PER_BYTE = 4e-5
_PACKAGE = str(Path(__file__).parents[1])
# What functions compute, in words; "the results" of all others.
_COMPUTES = {
    "solve_orbit": "the steady state", "orbit": "the steady state", "solve_cycle": "the cycle",
    "simulate": "the motion", "sensitivity": "the gains", "gains": "the gains",
    "optimise": "the search", "pareto": "the search", "improve": "the search",
    "sweep": "the designs", "sweep_machines": "the designs", "tolerance": "the tolerances",
    "balance": "the balance", "rating_map": "the map", "identify": "the map",
    "steady_state": "the steady state", "load_steps": "the load steps", "rotor_at": "the rotor",
    "rotor_motion": "the vibration", "rotor_modes": "the modes", "undamped_modes": "the modes",
    "critical_speeds": "the critical speeds", "machine_influence": "the influence of the planes",
    "compare": "the comparison", "accuracy": "the settings", "page": "the desk", "serve": "the desk",
}  # fmt: skip
# Files whose functions nobody calls by name.
_UNNAMED = (f"{os.sep}cli{os.sep}", f"{os.sep}_core{os.sep}", "__main__.py")


class _Compiles:
    """Whether compiling is told, and for which machine."""

    announced = False
    machine = ""
    status: Any = None  # of rich, which shows that something goes on; it says what compiles


def watch_compiles(machine: str = "") -> None:
    """From now on say so before a program compiles for more than two seconds.

    The command line does; elsewhere `JAXCOMP_WAITS=on` does as much.
    """
    _Compiles.announced = True
    if machine:
        _Compiles.machine = machine


def watched() -> bool:
    """Whether somebody waits for a command, who is told how long it takes."""
    return _Compiles.announced


@contextmanager
def compiling(size: int, cached: bool = False) -> Iterator[None]:
    """A program of so many bytes is compiled; say so before if that takes long.

    Args:
        size: [bytes] of its text.
        cached: whether later processes find it compiled.
    """
    seconds = size * _PER_BYTE
    requested = _Compiles.announced or os.environ.get("JAXCOMP_WAITS", "").lower() in (
        "on",
        "1",
        "yes",
    )
    if not requested or not shows_waits() or seconds < _AFTER:
        yield
        return
    machine = f" of {_Compiles.machine}" if _Compiles.machine else ""
    text = f"compiling {_called()}{machine}, about {float(f'{seconds:.1g}'):.0f} s"
    if cached:
        text += "; later starts are quicker"
    status = _Compiles.status
    if status is None:
        tell(text)
        yield
        return
    before = status.status
    status.update(f"{text[0].upper()}{text[1:]} ...")
    try:
        yield
    finally:
        status.update(before)


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
    return _COMPUTES.get(name, "the results")


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
    print(f"jaxcomp: {text}", file=sys.stderr, flush=True)


def _span(seconds: float) -> str:
    total = round(seconds)
    if total < 3600:
        return f"{total // 60}:{total % 60:02d}"
    return f"{total // 3600}:{total // 60 % 60:02d}:{total % 60:02d}"
