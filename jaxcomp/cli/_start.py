"""How a command starts and ends: its words are kept, JAX is made ready, errors are one line.

Programs compile quickly. What a user can cause ends in one line on
standard error and exit code 2; anything else is a fault of the program and keeps its traceback.
"""

import functools
import gc
import logging
import os
import re
import shlex
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Any

import typer
from typer.core import TyperGroup

from .._core.environment import xla_setting
from .._core.errors import BadInput
from .._core.interrupts import STOPPED, say_stopped, words_when_stopped
from .._core.progress import remember_waits, spinner, watch_compiles

# [s] in which workers that are on their way have come.
_WORKERS_WITHIN = 20
_words: ContextVar[tuple[str, ...]] = ContextVar("words", default=())

# An option with a word that none of its choices is, in typer's words.
_NO_CHOICE = re.compile(r"'([^']*)' is not one of (.*)", re.DOTALL)


class RecordedGroup(TyperGroup):
    """A group of commands that keeps the words it was called with."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the words, then read them."""
        _words.set(tuple(args))
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Call a command; a word that is no choice of an option is answered with the nearest one."""
        try:
            xla_setting()
        except BadInput as error:
            # whatever else a command imports would read that setting as well
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(2) from None
        try:
            return super().invoke(ctx)
        except Exception as error:
            # Of click or of what typer has in its place: both keep the text here.
            message = getattr(error, "message", None)
            match = isinstance(message, str) and _NO_CHOICE.search(message)
            if not match:
                raise
            from .._core.words import hint

            choices = re.findall(r"'([^']*)'", match[2])
            error.message = f"{message.rstrip('.')}{hint(match[1], choices)}."  # pyright: ignore
            raise


def command_line() -> str:
    """The command that runs with its arguments, ready to be typed again."""
    return shlex.join(["jaxcomp", *_words.get()])


def command_name() -> str:
    """The command that runs, such as `run`."""
    return next(iter(_words.get()), "jaxcomp")


class CommandError(ValueError):
    """An argument of the command line that makes no sense."""


def refuse(wrong: Any, why: str) -> None:
    """End the command with a word on its arguments if something is wrong with them."""
    if wrong:
        raise CommandError(why)


def refuse_unknown(option: str, name: str, names: Collection[str], kind: str) -> None:
    """End the command where a name is none of those that are known, with the nearest of them."""
    from .._core.words import did_you_mean

    refuse(name not in names, f"{option}: is no {kind}{did_you_mean(name, names)}")


def reports_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Wrap a command so that the errors a user can cause end in one line."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        words_when_stopped()
        try:
            command(**options)
            remember_waits()
        except Exception as error:
            shown_error = error
            if not isinstance(error, _caused_by_user()):
                platform = _platform_problem()
                if not platform:
                    raise
                shown_error = CommandError(platform)
            show_error(shown_error)
            further_errors = len(getattr(error, "others", ()))
            if further_errors:
                typer.echo(f"and {further_errors} more; `jaxcomp check FILE` lists them", err=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            typer.echo(say_stopped(), err=True)
            raise typer.Exit(STOPPED) from None

    return wrapped


def _platform_problem() -> str:
    """Fault of the platform that JAX is told to use; "" if there is none."""
    platform = os.environ.get("JAX_PLATFORMS", "")
    if not platform:
        return ""
    import jax

    try:
        jax.devices()
    except Exception:  # of several kinds, an assertion among them
        return f"JAX_PLATFORMS={platform}: JAX cannot run on it here; leave it out, or JAX_PLATFORMS=cpu"
    return ""


def usable_columns() -> None:
    """Leave out a width of the terminal that is none: rich would print nothing within zero columns."""
    columns = os.environ.get("COLUMNS")
    if columns is not None and not (columns.isdecimal() and int(columns[:9]) > 0):
        del os.environ["COLUMNS"]


def show_error(error: Exception) -> None:
    """One line on standard error, without the escape sequences that a file or argument may hold."""
    from ..scene._text import visible

    typer.echo(f"error: {visible(' '.join(str(error).split()))}", err=True)


def _caused_by_user() -> tuple[type[Exception], ...]:
    from .._core.extensions import ExtensionError
    from .._core.status import SolveFailed
    from ..scene import SceneError

    return CommandError, SceneError, BadInput, SolveFailed, ExtensionError, OSError


def waiting(
    words: str = "Solving (the first time it is compiled as well) ...",
) -> AbstractContextManager[Any]:
    """Tell on standard error what the user waits for."""
    return spinner(words)


def start_jax(*, once: bool = False) -> None:
    """Make ready what every command wants of JAX; call before it runs anything.

    Args:
        once: whether the programs of the command run once.
    """
    from .._core.precision import unoptimised_compiles
    from .._core.programs import keep_programs

    quick_compiles()
    keep_programs()
    if once:
        unoptimised_compiles()
    task = command_name()
    if any(word.partition("=")[0] == "--out" for word in _words.get()):
        task = f"{task} --out"
    watch_compiles(task=task)


def quiet_loader() -> None:
    """Keep XLA from printing pages about tuning flags of kept programs; call before JAX is imported.

    It compares the flags that a program was compiled with, hints to the compiler among them, with
    the features of the processor, and finds the hints missing there on the same machine.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def leave_out_callbacks() -> None:
    """Compile without the checks that call back from a running program; call before JAX is imported.

    JAX never keeps a program with callbacks, and diffrax checks its time grids in this way. What the
    solvers here find wrong they report in the status of their result.
    """
    os.environ.setdefault("EQX_ON_ERROR", "off")


def one_blas_thread() -> None:
    """Let BLAS work in the calling thread; call before SciPy is imported.

    Its matrices here have some dozen rows. On busy cores its threads wait for each other: a response of
    the three-subset rotor then took 160 ms instead of 0.8 ms.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def quick_compiles() -> None:
    """Compile quickly: objects are collected rarely in the whole command, see `RARELY`.

    The package itself tells XLA what saves more (`jaxcomp._core.precision`).
    """
    from .._core.programs import RARELY

    gc.set_threshold(*RARELY)


@contextmanager
def cluster(address: str | None) -> Iterator[Any]:
    """The client of a Dask cluster at an address or in a scheduler file; `None` if none is named."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise CommandError("--dask: needs Dask; pip install 'jaxcomp[dask]'") from None
    # it logs with tracebacks what a lost connection at the end means, above an answer that is whole
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    where = {"address": address}
    if address.endswith(".json"):
        where = {"scheduler_file": address}
    try:
        client = Client(**where, timeout=5)
    except (OSError, ValueError) as error:
        raise CommandError(
            f"--dask {address}: no scheduler answers ({error}); `dask scheduler` starts one, and "
            f"`dask worker {address}` each worker"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_WITHIN)
        except TimeoutError:
            raise CommandError(
                f"--dask {address}: the scheduler has no worker; `dask worker {address}` starts one"
            ) from None
        yield client
