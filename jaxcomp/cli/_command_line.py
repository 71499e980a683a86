"""The command that runs, as it was typed, for the record in its results."""

import shlex
from contextvars import ContextVar
from typing import Any

from typer.core import TyperGroup

_words: ContextVar[tuple[str, ...]] = ContextVar("words", default=())


class RecordedGroup(TyperGroup):
    """A group of commands that keeps the words it was called with."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the words, then read them."""
        _words.set(tuple(args))
        return super().parse_args(ctx, args)


def command_line() -> str:
    """The command with its arguments, ready to be typed again."""
    return shlex.join(["jaxcomp", *_words.get()])
