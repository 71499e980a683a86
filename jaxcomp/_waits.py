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

import jax

# [s] Compiling for longer than this is told; between two looks; between two lines of progress.
_AFTER, _LOOK, _EVERY = 2.0, 0.1, 10.0
# Looks without compiling after which a wait has ended.
_QUIET = 10
_PACKAGE = str(Path(__file__).parent)
_COMPILING = tuple(
    str(Path("jax", "_src", *where))
    for where in (
        ("interpreters", "partial_eval.py"),
        ("interpreters", "mlir.py"),
        ("compiler.py",),
    )
)
# Files whose functions nobody calls by name.
_UNNAMED = (f"{os.sep}cli{os.sep}", "__main__.py", "_fields.py")


class _Watch:
    """Looks, while JAX compiles, whether the thread that called it still waits for that."""

    def __init__(self):
        self.thread: threading.Thread | None = None
        self.spinner = False  # shows that something goes on, and says that it may be compiling

    def heard(self, event: str, seconds: float, **_) -> None:
        """JAX traced, lowered or compiled something: something larger may be around it."""
        alive = self.thread is not None and self.thread.is_alive()
        if alive or not event.startswith("/jax/core/compile"):
            return
        begun, caller = time.monotonic() - seconds, threading.get_ident()
        self.thread = threading.Thread(target=self._look, args=(begun, caller), daemon=True)
        self.thread.start()

    def _look(self, begun: float, caller: int) -> None:
        quiet, told = 0, False
        while quiet < _QUIET:
            time.sleep(_LOOK)
            name = _compiles(caller)
            quiet = 0 if name else quiet + 1
            if name and not told and time.monotonic() - begun > _AFTER:
                told = True
                if not self.spinner:
                    _say(
                        f"compiling {name}: some seconds to a minute the first time; "
                        "calls with the same shapes are fast from then on"
                    )


def _compiles(caller: int) -> str:
    """The function of this package for which a thread traces or compiles; "" if it does not."""
    frame = sys._current_frames().get(caller)
    busy, name = False, ""
    while frame is not None:
        file = frame.f_code.co_filename
        busy = busy or file.endswith(_COMPILING)
        if file.startswith(_PACKAGE) and not any(place in file for place in _UNNAMED):
            # the outermost one with a public name
            word = frame.f_code.co_name
            name = word if not word.startswith(("_", "<")) else name or word.strip("_<>")
        frame = frame.f_back
    if busy and caller != threading.main_thread().ident and name:
        return "a study"  # whose pieces run in threads of their own
    return name if busy else ""


_WATCH = _Watch()


def watch_compiles() -> None:
    """Say so where compiling takes more than two seconds, unless `JAXCOMP_WAITS` is off."""
    if shows_waits():
        jax.monitoring.register_event_duration_secs_listener(_WATCH.heard)


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
    _WATCH.spinner = True
    try:
        with console.status(text):
            yield
    finally:
        _WATCH.spinner = False


class Progress:
    """How far some work is, with the time that is left."""

    def __init__(self, text: str, total: int | None, done: int, unit: str, bar=None):
        self._text, self._total, self._unit, self._bar = text, total, unit, bar
        self._told = time.monotonic()
        self._from: tuple[float, int] | None = None
        if bar is not None:
            self._task = bar.add_task(text, total=total, completed=done, left="")

    def at(self, done: int, total: int | None = None, text: str = "") -> None:
        """So many are done, of so many; `text` says at what the work is."""
        self._total, self._text = total or self._total, text or self._text
        now = time.monotonic()
        if self._from is None or done < self._from[1]:
            self._from = now, done  # what was first was compiled as well
        begun, before = self._from
        left = ""
        if self._total and done > before:
            seconds = (self._total - done) * (now - begun) / (done - before)
            left = f"{_span(seconds)} left"
        if self._bar is not None:
            self._bar.update(
                self._task, completed=done, total=self._total, description=self._text, left=left
            )
        elif now - self._told > _EVERY and done != self._total and shows_waits():
            self._told = now
            of = f" of {self._total:,}" if self._total else ""
            _say(f"{self._text}: {done:,}{of} {self._unit}{', ' + left if left else ''}")


@contextmanager
def progress_of(
    text: str, total: int | None = None, done: int = 0, unit: str = "", show: bool = True
) -> Iterator[Progress]:
    """Progress on standard error: a bar on a terminal, elsewhere a line every ten seconds.

    Args:
        text: what is worked on.
        total: pieces in all, if that is known.
        done: pieces that were there before.
        unit: what the pieces are.
        show: whether to show anything.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not show or not shows_waits():
        silent = Progress(text, total, done, unit)
        silent._told = float("inf")
        yield silent
    elif not console.is_terminal:
        yield Progress(text, total, done, unit)
    else:
        from rich import progress as rich

        columns = ("{task.description}", rich.BarColumn(), rich.MofNCompleteColumn(),
                   unit, rich.TimeElapsedColumn(), "{task.fields[left]}")  # fmt: skip
        with rich.Progress(*(c for c in columns if c), console=console, transient=True) as bar:
            yield Progress(text, total, done, unit, bar)


def _say(text: str) -> None:
    print(f"jaxcomp: {text}", file=sys.stderr, flush=True)


def _span(seconds: float) -> str:
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d}"
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
