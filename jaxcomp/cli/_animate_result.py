"""What `jaxcomp animate` solves before it draws."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from rich.markup import escape

from ..balancing import direct_influence, least_squares
from ..crank import solve_orbit
from ..plot import Motion, balance_motion, mechanism_motion
from ..rotor import BalancingPlanes, LoadCase, Unbalances, respond
from ..scene import Scene
from ._errors import CommandError
from ._rotor import points_and_range, rotor_of
from ._tables import _table


def turning_motion(scene: Scene, frames: int) -> tuple[Motion, dict[str, Any]]:
    """The mechanism in its periodic state."""
    machine = scene.as_compressor()
    orbit = solve_orbit(machine)
    evidence = {
        "converged": bool(orbit.converged),
        "status": "converged" if bool(orbit.converged) else "not converged",
        "energy_residual": float(orbit.energy.residual),
        "mean_speed": float(orbit.mean_speed),
        "mechanical_efficiency": float(orbit.mechanical_efficiency),
    }
    return mechanism_motion(machine, orbit, frames), evidence


def balancing_motion(scene: Scene, speed: str | None, frames: int) -> tuple[Motion, dict[str, Any]]:
    """The rotor with its crankcase and housing, without and with the least-squares corrections.

    Raises:
        CommandError: nothing that shakes it.
    """
    places, case = scene.parts["balancing"], scene.parts["loads"]
    assert isinstance(places, BalancingPlanes)
    if not isinstance(case, LoadCase) or not case.loads:
        raise CommandError(f"{scene.file}: loads: is missing; nothing excites this rotor")
    speeds, _ = points_and_range(scene, [speed] if speed else None, None)
    model, at = rotor_of(scene, speeds), jnp.asarray(speeds)
    found = least_squares(direct_influence(model, case.loads, places, at))
    masses = Unbalances(
        tuple(plane.node for plane in places.planes),
        jnp.abs(found.correction),
        jnp.angle(found.correction),
    )
    before = respond(model, case.loads, at[:1]).checked()
    after = respond(model, (*case.loads, masses), at[:1]).checked()
    result = {
        "speed": float(at[0]),
        "largest_before": float(np.abs(before.displacement[..., 0]).max()),
        "largest_after": float(np.abs(after.displacement[..., 0]).max()),
        "improvement": float(found.improvement),
    }
    return balance_motion(model, before, after, frames), result


def animate_tables(result: dict[str, Any]):
    """What was solved for the pictures, in the units of their captions."""
    table = _table(escape(f"{result['machine']}: moving pictures"), "What", "")
    rpm = 30 / math.pi
    rows = (
        ("Mechanical efficiency", "mechanical_efficiency", 100, "%"),
        ("Mean speed", "mean_speed", rpm, "rpm"),
        ("Speed of the rotor", "speed", rpm, "rpm"),
        ("Largest motion before balancing", "largest_before", 1e6, "µm"),
        ("Largest motion after balancing", "largest_after", 1e6, "µm"),
        ("Root mean square at the targets that is left", "improvement", 100, "%"),
    )
    for words, key, factor, unit in rows:
        if key in result:
            table.add_row(words, f"{factor * result[key]:.4g} {unit}")
    return [table]
