"""`jaxcomp check`: what a scene file holds, or everything that is wrong with it."""

import typer

from ._errors import reports_errors, show_error
from ._options import AsJson, Machine


@reports_errors
def check(
    machine: Machine,
    as_json: AsJson = False,
) -> None:
    """Read a scene file: show its parts and what follows from them, or all its errors.

    Exit code 2 if anything is wrong. Unusual values are pointed at, but are no errors.

    Example: [bold]jaxcomp check my-machine.toml[/bold]
    """
    from ..scene import SceneError, load
    from ._check_result import check_result, check_tables, error_result
    from ._json import print_json
    from ._output import show_results
    from ._start import start_jax

    start_jax()
    try:
        scene = load(machine)
    except SceneError as error:
        found = [error, *error.others]
        if as_json:
            print_json(error_result(machine, found))
        for one in found:
            show_error(one)
        if len(found) > 1:
            typer.echo(f"{len(found)} errors", err=True)
        raise typer.Exit(2) from None
    result = check_result(scene)
    show_results(result, check_tables(result), as_json, None)
