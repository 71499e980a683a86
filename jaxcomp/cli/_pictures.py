"""`jaxcomp animate` and `desk`: pictures that move, and a page whose results follow dragged numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import jaxcomp as jc

from .._core.declared import Record, part, reading, word
from .._core.evidence import Check, ended, is_small
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
    answer = Animation(scene.name, scene.file, frames)
    from ..plot._animate import journal_motion, mechanism_motion

    with waiting("Solving and drawing ..."):
        if scene.compressor is not None:
            orbit = jc.crank.solve_orbit(scene)
            compressor = scene.as_compressor()
            moving["mechanism"] = gif(mechanism_motion(compressor, orbit, frames))
            if orbit.positions:
                moving["journals"] = gif(journal_motion(compressor, orbit, frames))
            converged = bool(orbit.converged)
            answer = replace(
                answer,
                converged=converged,
                status="converged" if converged else "not converged",
                energy_residual=orbit.energy.residual,
                mean_speed=orbit.mean_speed,
                mechanical_efficiency=orbit.mechanical_efficiency,
            )
        if {"rotor", "loads", "balancing"} <= set(scene.parts):
            motion, improvement = balancing_motion(scene, speed, frames)
            moving["balance"] = gif(motion)
            answer = replace(answer, balancing=improvement)
        refuse(not moving, f"{scene.file}: has neither a crank nor a rotor to be balanced")
    written = "Moving pictures and report"
    output.emit(answer, animate_tables, lambda: moving, scene, written=written)


@dataclass(frozen=True)
class BalancedMotion(Record):
    """A rotor before and after balancing.

    Attributes:
        speed: [rad/s] of the rotor.
        largest_before, largest_after: [m] largest amplitudes along an axis.
        improvement: [-] rms at the targets, after over before.
    """

    speed: Any = reading("rad/s")
    largest_before: Any = reading("m")
    largest_after: Any = reading("m")
    improvement: Any = reading("")


@dataclass(frozen=True)
class Animation(Record):
    """Results that moving pictures show.

    Attributes:
        machine, file: name and file of the machine.
        frames: pictures a revolution.
        converged, status: of the periodic state.
        energy_residual: [-] of the periodic state.
        mean_speed: [rad/s]
        mechanical_efficiency: [-]
        balancing: of the rotor.
    """

    machine: str = word()
    file: str = word()
    frames: int = reading("")
    converged: bool | None = word(optional=True, default=None)
    status: str | None = word(optional=True, default=None)
    energy_residual: Any = reading("", optional=True, default=None)
    mean_speed: Any = reading("rad/s", optional=True, default=None)
    mechanical_efficiency: Any = reading("", optional=True, default=None)
    balancing: BalancedMotion | None = part(
        BalancedMotion, inline=True, optional=True, default=None
    )

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of the periodic state, where there is a crank."""
        if self.converged is None:
            return ()
        return (
            ended("Solution", str(self.status), self.converged),
            is_small("Energy closure", float(self.energy_residual), tolerance),
        )


def balancing_motion(
    scene: jc.scene.Scene, speed: str | None, frames: int
) -> tuple[Motion, BalancedMotion]:
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
    improvement = BalancedMotion(
        speed=at[0],
        largest_before=abs(before.displacement[..., 0]).max(),
        largest_after=abs(after.displacement[..., 0]).max(),
        improvement=balance.improvement,
    )
    return balance_motion(model, before, after, frames), improvement


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
