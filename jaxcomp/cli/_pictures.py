"""`jaxcomp animate` and `desk`: pictures that move, and a page whose results follow dragged numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import jaxcomp as jc

from . import _options as opt
from ._output import Output
from ._rotor import points_and_range, rotor_of
from ._start import CommandError, refuse, waiting
from ._tables import row_table, value_rows

if TYPE_CHECKING:
    from ..plot._animate import Motion


def animate(
    *,
    out: Annotated[Path, typer.Option(callback=opt.folder)],
    case: opt.Case,
    speed: str | None = None,
    frames: int = 48,
    force: opt.Force = False,
) -> None:
    """Draw the mechanism over one revolution with its forces, and a rotor before and after balancing.

    Journals that move in their films are drawn in their clearances as well.

    Example: [bold]jaxcomp animate slider-link-8cc --out result[/bold]

    Args:
        out: Folder for the moving pictures (GIF) and report.html.
        speed (SPEED): Speed of the rotor, e.g. 3000rpm; the machine's if absent.
        frames: Pictures per revolution.
    """
    output = Output(out=out, force=force)
    refuse(not 4 <= frames <= 360, f"--frames {frames}: must be >= 4 and <= 360")
    from ..plot import gif

    scene = case.scene(once=True)
    moving = {}
    result = {"machine": scene.name, "file": scene.file, "frames": frames}
    from ..plot._animate import journal_motion, mechanism_motion

    with waiting("Solving and drawing ..."):
        if scene.compressor is not None:
            orbit = jc.crank.solve_orbit(scene)
            compressor = scene.as_compressor()
            moving["mechanism"] = gif(mechanism_motion(compressor, orbit, frames))
            if orbit.positions:
                moving["journals"] = gif(journal_motion(compressor, orbit, frames))
            converged = bool(orbit.converged)
            result |= {
                "converged": converged,
                "status": "converged" if converged else "not converged",
                "energy_residual": float(orbit.energy.residual),
                "mean_speed": float(orbit.mean_speed),
                "mechanical_efficiency": float(orbit.mechanical_efficiency),
            }
        if {"rotor", "loads", "balancing"} <= set(scene.parts):
            motion, balance_result = balancing_motion(scene, speed, frames)
            moving["balance"] = gif(motion)
            result |= balance_result
        refuse(not moving, f"{scene.file}: has neither a crank nor a rotor to be balanced")
    written = "Moving pictures and report"
    output.emit(result, animate_tables, lambda: moving, scene, written=written)


def balancing_motion(
    scene: jc.scene.Scene, speed: str | None, frames: int
) -> tuple[Motion, dict[str, Any]]:
    """The rotor with its crankcase and housing, without and with the least-squares corrections."""
    import jax.numpy as jnp

    from ..plot._rotor_motion import balance_motion

    places = scene.parts["balancing"]
    case = scene.parts["loads"]
    assert isinstance(places, jc.rotor.BalancingPlanes)
    if not isinstance(case, jc.rotor.LoadCase) or not case.loads:
        raise CommandError(f"{scene.file}: loads: is missing; nothing excites this rotor")
    singles = [speed] if speed else None
    speeds, _ = points_and_range(scene, singles, None)
    model = rotor_of(scene, speeds)
    at = jnp.asarray(speeds)
    balance = jc.balancing.least_squares(
        jc.balancing.direct_influence(model, case.loads, places, at)
    )
    nodes = tuple(plane.node for plane in places.planes)
    masses = balance.correction
    corrections = jc.rotor.Unbalances(nodes, jnp.abs(masses), jnp.angle(masses))
    before = jc.rotor.respond(model, case.loads, at[:1]).checked()
    after = jc.rotor.respond(model, (*case.loads, corrections), at[:1]).checked()
    result = {
        "speed": float(at[0]),
        "largest_before": float(abs(before.displacement[..., 0]).max()),
        "largest_after": float(abs(after.displacement[..., 0]).max()),
        "improvement": float(balance.improvement),
    }
    return balance_motion(model, before, after, frames), result


def animate_tables(result: dict[str, Any]):
    """Results that the pictures show, in the units of their captions."""
    rows = (
        ("Mechanical efficiency", "mechanical_efficiency", "%"),
        ("Mean speed", "mean_speed", "rpm"),
        ("Speed of the rotor", "speed", "rpm"),
        ("Largest motion before balancing", "largest_before", "µm"),
        ("Largest motion after balancing", "largest_after", "µm"),
        ("Root mean square at the targets that is left", "improvement", "%"),
    )
    cells = value_rows(result, rows, digits=4)
    return [row_table(f"{result['machine']}: moving pictures", ("Quantity", ""), cells, texts=2)]


def desk(case: opt.DesignCase, port: int = 0, browser: bool = True) -> None:
    r"""Open a page in the browser on which results follow while numbers of the machine are dragged.

    Nothing leaves this computer: the page is served on the loopback address alone. Ctrl+C ends it.
    Needs Panel: [bold]pip install '.\[desk]'[/bold] in the folder of jaxcomp.

    Example: [bold]jaxcomp desk mayekawa-wbhe[/bold]

    Args:
        port: Port of the loopback address; a free one if 0.
        browser: Open a browser.
    """
    refuse(not 0 <= port <= 65535, f"--port {port}: must be >= 0 and <= 65535")
    scene = case.scene()
    try:
        from ..desk import serve
    except ImportError:
        raise CommandError(
            "the desk needs Panel; in the folder of jaxcomp: pip install '.[desk]'"
        ) from None
    serve(scene, port=port, show=browser)
