"""The program `jaxcomp`: one command a file, joined here.

Nothing heavy is imported before a command needs it, so that help and completion answer at once.
"""

from typing import Annotated

import typer

from ._accuracy import accuracy
from ._animate import animate
from ._balance import balance
from ._bearing import bearing
from ._check import check
from ._command_line import RecordedGroup
from ._list import list_machines
from ._modes import modes
from ._new import new
from ._optimise import optimise
from ._respond import respond
from ._run import run
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
_MACHINES, _ANALYSE, _DESIGN = "Machines", "Analyse one machine", "Design and balance"
app.command("new", rich_help_panel=_MACHINES)(new)
app.command("check", rich_help_panel=_MACHINES)(check)
app.command("list", rich_help_panel=_MACHINES)(list_machines)
app.command("run", rich_help_panel=_ANALYSE)(run)
app.command("animate", rich_help_panel=_ANALYSE)(animate)
app.command("respond", rich_help_panel=_ANALYSE)(respond)
app.command("modes", rich_help_panel=_ANALYSE)(modes)
app.command("bearing", rich_help_panel=_ANALYSE)(bearing)
app.command("accuracy", rich_help_panel=_ANALYSE)(accuracy)
app.command("balance", rich_help_panel=_DESIGN)(balance)
app.command("optimise", rich_help_panel=_DESIGN)(optimise)
app.command("sweep", rich_help_panel=_DESIGN)(sweep)
app.command("tolerance", rich_help_panel=_DESIGN)(tolerance)


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
    from ._cache import leave_out_callbacks, one_blas_thread, quiet_loader

    quiet_loader()
    one_blas_thread()
    leave_out_callbacks()
    app()
