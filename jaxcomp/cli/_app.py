"""The program `jaxcomp`: one command a file, joined here.

Nothing heavy is imported before a command needs it, so that help and completion answer at once.
"""

import inspect
import io
import sys
import textwrap
from collections.abc import Callable
from typing import Annotated

import typer

from ._accuracy import accuracy
from ._animate import animate
from ._balance import balance
from ._bearing import bearing
from ._check import check
from ._command_line import RecordedGroup
from ._compare import compare
from ._desk import desk
from ._explain import explain
from ._list import list_machines
from ._map import rating_map
from ._modes import modes
from ._new import new
from ._optimise import optimise
from ._respond import respond
from ._run import run
from ._sensitivity import sensitivity
from ._simulate import simulate
from ._sweep import sweep
from ._tolerance import tolerance
from ._update import update

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


def _flowing(text: str | None) -> str:
    """Help with one line a paragraph, which the width of the terminal breaks; indented lines stay."""
    paragraphs = inspect.cleandoc(text or "").split("\n\n")
    return "\n\n".join(
        textwrap.dedent(one) if one.startswith(" ") else one.replace("\n", " ")
        for one in paragraphs
    )


def _add(name: str, command: Callable[..., None], panel: str) -> None:
    app.command(name, help=_flowing(command.__doc__), rich_help_panel=panel)(command)


_MACHINES, _ANALYSE, _DESIGN = "Machines", "Analyse one machine", "Design and balance"
_add("new", new, _MACHINES)
_add("check", check, _MACHINES)
_add("list", list_machines, _MACHINES)
_add("explain", explain, _MACHINES)
_add("run", run, _ANALYSE)
_add("simulate", simulate, _ANALYSE)
_add("animate", animate, _ANALYSE)
_add("respond", respond, _ANALYSE)
_add("modes", modes, _ANALYSE)
_add("bearing", bearing, _ANALYSE)
_add("desk", desk, _ANALYSE)
_add("map", rating_map, _ANALYSE)
_add("accuracy", accuracy, _ANALYSE)
_add("balance", balance, _DESIGN)
_add("compare", compare, _DESIGN)
_add("optimise", optimise, _DESIGN)
_add("sensitivity", sensitivity, _DESIGN)
_add("sweep", sweep, _DESIGN)
_add("tolerance", tolerance, _DESIGN)
_add("update", update, _DESIGN)


def _show_version(wanted: bool) -> None:
    if wanted:
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
    from ._start import leave_out_callbacks, one_blas_thread, quiet_loader

    quiet_loader()
    one_blas_thread()
    leave_out_callbacks()
    # a terminal in ASCII or Latin-1 shows what it can of results with Greek letters
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
