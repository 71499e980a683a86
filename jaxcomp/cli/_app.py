"""The program `jaxcomp`: its commands by what they are for, with the help of their options.

Nothing heavy is imported before a command needs it, so that help and completion answer at once.
"""

import inspect
import io
import re
import sys
import textwrap
from collections.abc import Callable
from copy import copy
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args, get_origin

import typer

from ._accuracy import accuracy
from ._balance import balance
from ._bearing import bearing
from ._check import check
from ._compare import compare, sensitivity
from ._files import cache, explain, list_machines, new, schema
from ._identify import identify
from ._map import rating_map
from ._modes import modes
from ._optimise import optimise
from ._pictures import animate, desk
from ._pulsation import pulsation
from ._respond import respond
from ._run import run
from ._simulate import simulate
from ._start import (
    RecordedGroup,
    leave_out_callbacks,
    one_blas_thread,
    quiet_loader,
    reports_errors,
    usable_columns,
)
from ._sweep import sweep
from ._tolerance import tolerance

app = typer.Typer(
    name="jaxcomp",
    cls=RecordedGroup,
    help="Reciprocating compressors: from geometry to efficiency and vibration.",
    no_args_is_help=True,
    epilog="Begin with: [bold]jaxcomp new my-machine.toml[/bold], [bold]jaxcomp check "
    "my-machine.toml[/bold], [bold]jaxcomp run my-machine.toml --out result[/bold]",
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
# An entry of `Args` in the docstring of a command.
_ENTRY = re.compile(r"(\w+)(?: \((.*?)\))?: (.*)")


def _flowing(text: str | None) -> str:
    """Help with one line a paragraph, which the width of the terminal breaks; indented lines stay."""
    paragraphs = []
    for paragraph in inspect.cleandoc(text or "").split("\n\n"):
        if paragraph.startswith(" "):
            paragraphs.append(textwrap.dedent(paragraph))
        else:
            paragraphs.append(paragraph.replace("\n", " "))
    return "\n\n".join(paragraphs)


def _add(name: str, command: Callable[..., None], panel: str) -> None:
    """Add a command; the help of its own options stands in its docstring.

    There an entry of `Args` reads `name: help`, or `name (METAVAR): help`. What one needs beside
    that is in its annotation. Arguments are required, options not; a flag that is off has no opposite.
    """
    command = reports_errors(command)
    text, _, argument_lines = inspect.cleandoc(command.__doc__ or "").partition("\n\nArgs:\n    ")
    docs = {}
    for line in re.split(r"\n    (?=\w)", argument_lines):
        if entry := _ENTRY.fullmatch(" ".join(line.split())):
            docs[entry[1]] = entry
    options, groups = _options_of(command)
    parameters = []
    for option in options:
        kind = option.annotation
        info = typer.Option()
        if get_origin(kind) is Annotated:
            kind, shared = get_args(kind)
            info = copy(shared)
        elif option.default is inspect.Parameter.empty:
            info = typer.Argument()
        elif kind is bool and option.default is False:
            info = typer.Option(f"--{option.name.replace('_', '-')}")
        if entry := docs.get(option.name):
            info.metavar = entry[2]
            info.help = entry[3]
        parameters.append(
            option.replace(annotation=Annotated[kind, info], kind=option.KEYWORD_ONLY)
        )
    grouped_command = _grouping(command, groups)
    grouped_command.__signature__ = inspect.Signature(parameters)  # pyright: ignore
    grouped_command.__annotations__ = {option.name: option.annotation for option in parameters}
    app.command(name, help=_flowing(text), rich_help_panel=panel)(grouped_command)


def _options_of(command: Callable[..., None]) -> tuple[list[inspect.Parameter], dict[str, Any]]:
    """The single options of a command, and by name its parameters that stand for a group of them.

    A group is a dataclass, whose fields are options in its place.
    """
    options = []
    groups = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        if is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
            options += inspect.signature(parameter.annotation, eval_str=True).parameters.values()
        else:
            options.append(parameter)
    return options, groups


def _grouping(command: Callable[..., None], groups: dict[str, Any]) -> Callable[..., None]:
    """A command that is called with single options, and takes some of them in groups."""

    @wraps(command)
    def called(**options: Any) -> None:
        grouped = {}
        for name, group in groups.items():
            values = {field.name: options.pop(field.name) for field in fields(group)}
            grouped[name] = group(**values)
        command(**options, **grouped)

    return called


# The commands that one needs first, by what they are for; those for developers last.
_COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "First": {
        "new": new,
        "check": check,
        "run": run,
        "desk": desk,
        "map": rating_map,
        "compare": compare,
        "optimise": optimise,
        "explain": explain,
    },
    "Studies of designs": {
        "sensitivity": sensitivity,
        "sweep": sweep,
        "tolerance": tolerance,
    },
    "Measured machines": {"identify": identify},
    "Pipes": {"pulsation": pulsation},
    "Vibration and balance": {"modes": modes, "respond": respond, "balance": balance},
    "Motion and bearings": {"simulate": simulate, "bearing": bearing, "animate": animate},
    "Machines, files and this program": {
        "list": list_machines,
        "accuracy": accuracy,
        "schema": schema,
        "cache": cache,
    },
}
for _panel, _commands in _COMMANDS.items():
    for _name, _command in _commands.items():
        _add(_name, _command, _panel)


def _show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"jaxcomp {version('jaxcomp')}")
        raise typer.Exit()


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Print the version and leave."
        ),
    ] = False,
) -> None:
    del version


def main() -> None:
    """Entry point of the program `jaxcomp`."""
    quiet_loader()
    one_blas_thread()
    usable_columns()
    leave_out_callbacks()
    # a terminal in ASCII or Latin-1 shows what it can of results with Greek letters
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
