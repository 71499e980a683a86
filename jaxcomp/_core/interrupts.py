"""An interrupt ends the program soon, whatever it does at the moment.

Python raises `KeyboardInterrupt` in the main thread between two of its own steps. None comes while XLA
compiles, one that falls into a callback of the garbage collector is dropped, and after the last words of
the program threads of XLA may compile on for minutes. So another thread is told of the interrupt as well.

It is there before the rest is imported, and little is imported for it: `_thread`, not `threading`.
"""

import _thread
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

# What a shell expects of a program that an interrupt ends.
STOPPED = 130
# [s] The main thread has to put away what it began.
_GRACE = 1.5
_SHOW_CURSOR = "\x1b[?25h"
_state = {"words": "stopped", "interrupted": False}


def words_when_stopped(words: str = "stopped") -> None:
    """What a program that is interrupted from now on says of its work."""
    _state["words"] = words


def say_stopped() -> str:
    """The words, which are said once."""
    words, _state["words"] = _state["words"], ""
    return words


@contextmanager
def ends_when_interrupted() -> Iterator[None]:
    """End the process with status 130 within two seconds of an interrupt; in the main thread only."""
    reading, writing = os.pipe()
    if hasattr(os, "set_blocking"):
        os.set_blocking(writing, False)
    hook, alive = sys.unraisablehook, _thread.allocate_lock()

    def watch():
        while number := os.read(reading, 1):
            if number[0] == signal.SIGINT:
                _state["interrupted"] = True
                if not alive.acquire(timeout=_GRACE):
                    _leave(flush=False)  # the main thread may hold the streams
                break
        os.close(reading)

    def unraisable(what):
        if not issubclass(what.exc_type, KeyboardInterrupt):
            hook(what)

    alive.acquire()
    _state.update(words="stopped", interrupted=False)
    sys.unraisablehook = unraisable
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        _thread.start_new_thread(watch, ())
        yield
    except BaseException as error:
        code = error.code if isinstance(error, SystemExit) else None
        if _state["interrupted"] or code == STOPPED or isinstance(error, KeyboardInterrupt):
            _leave()
        raise
    finally:
        alive.release()
        signal.set_wakeup_fd(before)
        sys.unraisablehook = hook
        os.close(writing)


def _leave(flush: bool = True) -> None:
    """End at once, without the threads of XLA."""
    words = say_stopped()
    with suppress(OSError, ValueError, AttributeError):  # nobody reads any more
        if flush:
            sys.stdout.flush()
            sys.stderr.flush()
        text = f"{words}\n" if words else ""
        if os.isatty(2):
            text += _SHOW_CURSOR
        os.write(2, text.encode(errors="replace"))
    os._exit(STOPPED)
