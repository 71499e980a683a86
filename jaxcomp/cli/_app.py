"""The program `jaxcomp`: one command a file, joined here.

Nothing heavy is imported before a command needs it, so that help and completion answer at once.
"""

from typing import Annotated

import typer

from ._balance import balance
from ._bearing import bearing
from ._list import list_machines
from ._modes import modes
from ._optimise import optimise
from ._respond import respond
from ._run import run
from ._sweep import sweep

app = typer.Typer(
    name="jaxcomp",
    help="Reciprocating compressors: from geometry to efficiency and vibration.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("list")(list_machines)
app.command("run")(run)
app.command("respond")(respond)
app.command("modes")(modes)
app.command("bearing")(bearing)
app.command("balance")(balance)
app.command("optimise")(optimise)
app.command("sweep")(sweep)


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
    from ._cache import leave_out_callbacks, quiet_loader

    quiet_loader()
    leave_out_callbacks()
    app()
