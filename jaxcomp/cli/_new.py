"""`jaxcomp new`: a scene file to start from, with what every entry means."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors


class Kind(enum.StrEnum):
    """What the new machine is; each has a file in `jaxcomp/scene/starts`."""

    slider_crank = "slider-crank"
    v_twin = "v-twin"
    slider_link = "slider-link"
    rotor = "rotor"


@reports_errors
def new(
    file: Annotated[Path, typer.Argument(help="File to write; - prints it.")] = Path(
        "my-machine.toml"
    ),
    kind: Annotated[Kind, typer.Option(help="What to start from.")] = Kind.slider_crank,
    force: Annotated[bool, typer.Option("--force", help="Write over a file.")] = False,
) -> None:
    """Write a scene file to start from, with a comment on every entry.

    Example: [bold]jaxcomp new my-machine.toml --kind slider-link[/bold]
    """
    from ..scene import start

    if str(file) == "-":
        typer.echo(start(kind.value, "my-machine"), nl=False)
        return
    if file.suffix != ".toml":
        raise CommandError(f"{file}: must end in .toml")
    if file.exists() and not force:
        raise CommandError(f"{file}: is there already; --force writes over it")
    file.write_text(start(kind.value, file.stem), encoding="utf-8")
    verb = "respond" if kind is Kind.rotor else "run"
    typer.echo(f"{file} is written. Change it, then: jaxcomp check {file}; jaxcomp {verb} {file}")
