"""Errors of a command: one line on standard error, exit code 2, no traceback."""

import functools
from collections.abc import Callable
from typing import Any

import typer

# What a shell expects of a program that an interrupt ends.
STOPPED = 130


class CommandError(ValueError):
    """An argument of the command line that makes no sense."""


def reports_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Wrap a command so that the errors a user can cause end in one line.

    Anything else is a fault of the program and keeps its traceback.
    """

    @functools.wraps(command)
    def wrapped(*args: Any, **options: Any) -> None:
        try:
            command(*args, **options)
        except Exception as error:
            if not isinstance(error, _caused_by_user()):
                raise
            show_error(error)
            others = len(getattr(error, "others", ()))
            if others:
                typer.echo(f"and {others} more; `jaxcomp check FILE` lists them", err=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            typer.echo("stopped", err=True)
            raise typer.Exit(STOPPED) from None

    return wrapped


def show_error(error: Exception) -> None:
    """One line on standard error, without the escape sequences that a file or argument may hold."""
    from ..scene import visible

    typer.echo(f"error: {visible(' '.join(str(error).split()))}", err=True)


def _caused_by_user() -> tuple[type[Exception], ...]:
    from .._extensions import ExtensionError
    from .._fields import BadInput
    from .._status import SolveFailed
    from ..scene import SceneError

    return CommandError, SceneError, BadInput, SolveFailed, ExtensionError, OSError
