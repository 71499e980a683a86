"""`jaxcomp desk`: a machine in the browser, whose results follow while its numbers are dragged."""

from typing import Annotated

import typer

from ._arguments import changed_scene
from ._errors import CommandError, reports_errors
from ._options import Designs, Machine, Sets
from ._start import start_jax


@reports_errors
def desk(
    machine: Machine,
    sets: Sets = None,
    designs: Designs = None,
    port: Annotated[int, typer.Option(help="Port of the loopback address; a free one if 0.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Open a page in the browser on which results follow while numbers of the machine are dragged.

    Nothing leaves this computer: the page is served on the loopback address alone. Ctrl+C ends it.

    Example: [bold]jaxcomp desk mayekawa-wbhe[/bold]
    """
    if not 0 <= port <= 65535:
        raise CommandError(f"--port {port}: must be >= 0 and <= 65535")
    start_jax()
    scene = changed_scene(machine, sets or (), designs or ())
    try:
        from ..desk import serve
    except ImportError:
        raise CommandError("the desk needs Panel; pip install 'jaxcomp[desk]'") from None
    serve(scene, port=port, show=browser)
