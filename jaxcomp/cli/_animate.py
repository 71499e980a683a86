"""`jaxcomp animate`: the mechanism over one turn, the machine before and after balancing."""

from pathlib import Path
from typing import Annotated

import typer

from ._errors import CommandError, reports_errors
from ._options import Machine, Sets


@reports_errors
def animate(
    machine: Machine,
    out: Annotated[
        Path, typer.Option(help="Folder for the moving pictures (GIF) and report.html.")
    ],
    sets: Sets = None,
    speed: Annotated[
        str | None,
        typer.Option(metavar="SPEED", help="Of the rotor, e.g. 3000rpm; the scene's if absent."),
    ] = None,
    frames: Annotated[int, typer.Option(help="Pictures a turn.")] = 48,
) -> None:
    """Draw the mechanism over one turn with its forces, and a rotor before and after balancing.

    Example: [bold]jaxcomp animate slider-link-8cc --out result[/bold]
    """
    if not 4 <= frames <= 360:
        raise CommandError(f"--frames {frames}: must be >= 4 and <= 360")
    from .._waits import spinner
    from ..plot import gif
    from ._animate_result import animate_tables, balancing_motion, turning_motion
    from ._arguments import changed_scene
    from ._output import show_results, write_results
    from ._start import start_jax

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    moving, result = {}, {"machine": scene.name, "file": scene.file, "frames": frames}
    with spinner("Solving and drawing ..."):
        if scene.compressor is not None:
            motion, found = turning_motion(scene, frames)
            moving["mechanism"] = gif(motion)
            result |= found
        if {"rotor", "loads", "balancing"} <= set(scene.parts):
            motion, found = balancing_motion(scene, speed, frames)
            moving["balance"] = gif(motion)
            result |= found
        if not moving:
            raise CommandError(f"{scene.file}: has neither a crank nor a rotor to be balanced")
        tables = animate_tables(result)
        write_results(out, moving, result, scene, tables)
    show_results(result, tables, False, out, "Moving pictures and report")
