"""An interrupt ends the program at once, whatever it does at the moment.

Python's own `KeyboardInterrupt` would be raised between any two steps of the main thread: in the middle
of an import of NumPy or JAX, which ends in a traceback or a segmentation fault, or in a callback of the
garbage collector, where it is dropped. So the handler ends the process itself. Python calls it between
two such steps as well, of which there are none while XLA compiles; then a thread that is told of the
interrupt too ends the process. A process that is told to end (SIGTERM, of `timeout`, `kill` or a queue of
jobs) ends in the same way, with its own status.

Both are there before the rest is imported, and little is imported for them: `_thread`, not `threading`.
"""

import _thread
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

# What a shell expects of a program that an interrupt ends: 128 and the number of the signal.
STOPPED = 130
_HEARD = {signal.SIGINT: STOPPED, signal.SIGTERM: 128 + signal.SIGTERM}
# [s] The main thread has to put away what it began.
_GRACE = 1.5
_CLEAR_LINE = "\r\x1b[K"
_SHOW_CURSOR = "\x1b[?25h"
_IMPORT = "<frozen importlib._bootstrap>"
# `interrupted` is the status of the signal that came, 0 before one has.
_state = {"words": "stopped", "interrupted": 0, "raised": 0}
_unfinished: set[str] = set()  # files


def words_when_stopped(words: str = "stopped") -> None:
    """Set the words with which a program that is interrupted from now on tells of its work."""
    _state["words"] = words


def say_stopped() -> str:
    """The words, which are said once."""
    words = _state["words"]
    _state["words"] = ""
    return words


@contextmanager
def removed_when_stopped(file: str | os.PathLike[str]) -> Iterator[None]:
    """A file that is not there if an interrupt ends the program within, as what is half written."""
    name = os.fspath(file)
    _unfinished.add(name)
    try:
        yield
    finally:
        _unfinished.discard(name)


@contextmanager
def interrupts_raised() -> Iterator[None]:
    """Within, an interrupt is raised as Python does; for the main thread, which hands out what it has."""
    _state["raised"] += 1
    try:
        yield
    finally:
        _state["raised"] -= 1


@contextmanager
def ends_when_interrupted() -> Iterator[None]:
    """End the process with status 130 within two seconds of an interrupt; in the main thread only.

    What runs within is the whole program: an interrupt that comes while Python puts itself away ends it
    in the same way, until Python hears none; then the process ends without a word. A process that was
    started to ignore a signal goes on to, but a `KeyboardInterrupt` that code raises ends it as well.
    """
    heard = _not_ignored()
    reading, writing = os.pipe()
    # Python writes the signal's number here: a full pipe must not hold up what was interrupted
    if hasattr(os, "set_blocking"):
        os.set_blocking(writing, False)

    def watch():
        number = os.read(reading, 1)[0]
        while number not in heard:
            number = os.read(reading, 1)[0]
        _state["interrupted"] = heard[number]
        # the main thread ends the process within this time, if it comes between two steps at all
        time.sleep(_GRACE)
        _leave(flush=False)  # the main thread may hold the streams

    # an interrupt within the garbage collector is no error to tell of: the handler ends the process
    def unraisable(event):
        if not issubclass(event.exc_type, KeyboardInterrupt):
            hook(event)

    hook = sys.unraisablehook
    sys.unraisablehook = unraisable
    _state.update(words="stopped", interrupted=0, raised=0)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in heard:
        signal.signal(number, _interrupted)
    _thread.start_new_thread(watch, ())
    try:
        yield
    except BaseException as error:
        code = None
        if isinstance(error, SystemExit):
            code = error.code
        if _state["interrupted"] or code == STOPPED or isinstance(error, KeyboardInterrupt):
            _leave()
        raise


def _not_ignored() -> dict[signal.Signals, int]:
    """The signals that this process was not started to ignore, with the status of each."""
    heard = {}
    for number, status in _HEARD.items():
        if signal.getsignal(number) != signal.SIG_IGN:
            heard[number] = status
    return heard


def _interrupted(number: int, frame: FrameType | None) -> None:
    """Handle the signal between two steps of the main thread."""
    _state["interrupted"] = _HEARD[signal.Signals(number)]
    # an exception within an import of NumPy or JAX would leave half of it behind
    if not _state["raised"] or _imports(frame):
        _leave()
    raise KeyboardInterrupt


def _imports(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename != _IMPORT:
        frame = frame.f_back
    return frame is not None


def _leave(flush: bool = True) -> None:
    """End at once, without the threads of XLA."""
    # nobody reads any more, or the main thread was writing when the signal came
    with suppress(OSError, ValueError, AttributeError, RuntimeError):
        if flush:
            sys.stdout.flush()
            sys.stderr.flush()
    for name in [*_unfinished]:
        with suppress(OSError):
            os.unlink(name)
    with suppress(OSError):
        # by the system's own call: the streams of Python may be locked by what the signal interrupted
        words = say_stopped()
        text = f"{words}\n" if words else ""
        if os.isatty(2):
            text = f"{_CLEAR_LINE}{text}{_SHOW_CURSOR}"
        os.write(2, text.encode(errors="replace"))
    os._exit(_state["interrupted"] or STOPPED)
