"""`jaxcomp animate`: the mechanism over one revolution, the machine before and after balancing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import jaxcomp as jc

from .._shown import RPM
from ._arguments import changed_scene
from ._errors import CommandError, reports_errors
from ._options import Machine, Sets
from ._output import show_results, write_results
from ._rotor import points_and_range, rotor_of
from ._start import start_jax
from ._tables import row_table


@reports_errors
def animate(
    machine: Machine,
    out: Annotated[
        Path, typer.Option(help="Folder for the moving pictures (GIF) and report.html.")
    ],
    sets: Sets = None,
    speed: Annotated[
        str | None,
        typer.Option(
            metavar="SPEED", help="Speed of the rotor, e.g. 3000rpm; the scene's if absent."
        ),
    ] = None,
    frames: Annotated[int, typer.Option(help="Pictures per revolution.")] = 48,
) -> None:
    """Draw the mechanism over one revolution with its forces, and a rotor before and after balancing.

    Journals that move in their films are drawn in their clearances as well.

    Example: [bold]jaxcomp animate slider-link-8cc --out result[/bold]
    """
    if not 4 <= frames <= 360:
        raise CommandError(f"--frames {frames}: must be >= 4 and <= 360")
    from .._waits import spinner
    from ..plot import gif

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    moving, result = {}, {"machine": scene.name, "file": scene.file, "frames": frames}
    with spinner("Solving and drawing ..."):
        if scene.compressor is not None:
            orbit = jc.crank.solve_orbit(scene)
            motion, found = turning_motion(scene, orbit, frames)
            moving["mechanism"] = gif(motion)
            result |= found
            if orbit.positions:
                compressor = scene.as_compressor()
                moving["journals"] = gif(jc.plot.journal_motion(compressor, orbit, frames))
        if {"rotor", "loads", "balancing"} <= set(scene.parts):
            motion, found = balancing_motion(scene, speed, frames)
            moving["balance"] = gif(motion)
            result |= found
        if not moving:
            raise CommandError(f"{scene.file}: has neither a crank nor a rotor to be balanced")
        tables = animate_tables(result)
        write_results(out, moving, result, scene, tables)
    show_results(result, tables, False, out, "Moving pictures and report")


def turning_motion(
    scene: jc.scene.Scene, orbit: jc.Orbit, frames: int
) -> tuple[jc.plot.Motion, dict[str, Any]]:
    """The mechanism in its periodic state."""
    machine = scene.as_compressor()
    evidence = {
        "converged": bool(orbit.converged),
        "status": "converged" if bool(orbit.converged) else "not converged",
        "energy_residual": float(orbit.energy.residual),
        "mean_speed": float(orbit.mean_speed),
        "mechanical_efficiency": float(orbit.mechanical_efficiency),
    }
    return jc.plot.mechanism_motion(machine, orbit, frames), evidence


def balancing_motion(
    scene: jc.scene.Scene, speed: str | None, frames: int
) -> tuple[jc.plot.Motion, dict[str, Any]]:
    """The rotor with its crankcase and housing, without and with the least-squares corrections.

    Raises:
        CommandError: no loads.
    """
    import jax.numpy as jnp

    places, case = scene.parts["balancing"], scene.parts["loads"]
    assert isinstance(places, jc.rotor.BalancingPlanes)
    if not isinstance(case, jc.rotor.LoadCase) or not case.loads:
        raise CommandError(f"{scene.file}: loads: is missing; nothing excites this rotor")
    speeds, _ = points_and_range(scene, [speed] if speed else None, None)
    model, at = rotor_of(scene, speeds), jnp.asarray(speeds)
    found = jc.balancing.least_squares(jc.balancing.direct_influence(model, case.loads, places, at))
    masses = jc.rotor.Unbalances(
        tuple(plane.node for plane in places.planes),
        jnp.abs(found.correction),
        jnp.angle(found.correction),
    )
    before = jc.rotor.respond(model, case.loads, at[:1]).checked()
    after = jc.rotor.respond(model, (*case.loads, masses), at[:1]).checked()
    result = {
        "speed": float(at[0]),
        "largest_before": float(abs(before.displacement[..., 0]).max()),
        "largest_after": float(abs(after.displacement[..., 0]).max()),
        "improvement": float(found.improvement),
    }
    return jc.plot.balance_motion(model, before, after, frames), result


def animate_tables(result: dict[str, Any]):
    """Results that the pictures show, in the units of their captions."""
    rows = (
        ("Mechanical efficiency", "mechanical_efficiency", 100, "%"),
        ("Mean speed", "mean_speed", RPM, "rpm"),
        ("Speed of the rotor", "speed", RPM, "rpm"),
        ("Largest motion before balancing", "largest_before", 1e6, "µm"),
        ("Largest motion after balancing", "largest_after", 1e6, "µm"),
        ("Root mean square at the targets that is left", "improvement", 100, "%"),
    )
    cells = (
        (words, f"{factor * result[key]:.4g} {unit}")
        for words, key, factor, unit in rows
        if key in result
    )
    return [row_table(f"{result['machine']}: moving pictures", ("Quantity", ""), cells, texts=2)]
