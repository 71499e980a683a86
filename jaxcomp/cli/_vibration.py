"""Vibration of the suspended compressor, as numbers and as a table."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from rich.table import Table

from ..crank import Orbit
from ..scene import Scene
from ..shaking import (
    Suspension,
    block_points,
    free_body_error,
    free_body_response,
    harmonic_response,
    natural_frequencies,
    orbit_load,
    point_motion,
)
from ._tables import _table, _words

_HARMONICS = 12
# instants of a turn among which the farthest excursion is looked for
_INSTANTS = 360


def vibration_result(scene: Scene, orbit: Orbit) -> dict[str, Any]:
    """Settled vibration in SI units; lists run over x, y, z or the six degrees of freedom.

    Amplitudes are those of the first harmonic. `free_body` is the approximation without springs and
    `free_body_error` its error over the amplitude.
    """
    suspension = scene.parts["suspension"]
    assert isinstance(suspension, Suspension)
    places = block_points(suspension)
    points = jnp.stack(list(places.values()))
    found = _numbers(scene.as_compressor().mechanism, orbit, suspension, points)
    found = jax.tree.map(lambda x: x.tolist(), jax.device_get(found))
    keys = ("position", "amplitude", "rms", "peak", "free_body", "free_body_error")
    return {
        "harmonics": _HARMONICS,
        "natural_frequencies": found["natural_frequencies"],
        "block_amplitude": found["block_amplitude"],
        "block_rms": found["block_rms"],
        "points": {
            name: {key: found[key][i] for key in keys} for i, name in enumerate(places)
        },
    }  # fmt: skip


def vibration_table(vibration: dict[str, Any]) -> Table:
    """Amplitudes of the points, the free-body approximation and its error."""
    hertz = ", ".join(f"{w / (2 * math.pi):.3g}" for w in vibration["natural_frequencies"])
    title = f"First harmonic on springs of {hertz} Hz, and as a free body"
    table = _table(title, "µm", "x", "y", "z", "Peak", "Free x", "y", "z", "Error", numbers=True)
    for name, point in vibration["points"].items():
        micrometres = [*point["amplitude"], point["peak"], *point["free_body"]]
        error = f"{100 * point['free_body_error']:.2g} %"
        table.add_row(_words(name), *(f"{1e6 * value:.3g}" for value in micrometres), error)
    table.columns[0].no_wrap = True
    return table


@eqx.filter_jit
def _numbers(mechanism, orbit: Orbit, suspension, points) -> dict[str, Any]:
    load = orbit_load(mechanism, orbit, suspension, _HARMONICS)
    block, free = harmonic_response(suspension, load), free_body_response(suspension, load)
    time = jnp.linspace(0.0, 1.0, _INSTANTS, endpoint=False) * orbit.period

    def at(point):
        motion = point_motion(suspension, block, point)
        excursion = jnp.linalg.norm(motion.at(time), axis=0)
        return {
            "position": point,
            "amplitude": jnp.abs(motion.amplitude[:, 0]),
            "rms": jnp.linalg.norm(motion.rms),
            "peak": jnp.max(excursion),
            "free_body": jnp.abs(point_motion(suspension, free, point).amplitude[:, 0]),
            "free_body_error": free_body_error(suspension, load, point)[0],
        }

    return {
        "natural_frequencies": natural_frequencies(suspension),
        "block_amplitude": jnp.abs(block.amplitude[:, 0]),
        "block_rms": block.rms,
        **jax.vmap(at)(points),
    }
