"""What the commands of rotors share: speeds, the rotor at them, what shakes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jaxcomp as jc

from . import _options as opt
from ._arguments import speed_of, speeds_of
from ._start import CommandError, command_name, refuse

if TYPE_CHECKING:
    import numpy as np

# Below this share of backward or forward motion an orbit is called a line.
_LINE = 0.05


def scene_speeds(scene: jc.scene.Scene) -> np.ndarray:
    """[rad/s] The speeds that the scene runs at."""
    import numpy as np

    from ..vibration._machine import own_speeds

    speeds = own_speeds(scene.parts.get("balancing"), scene.compressor)
    refuse(speeds is None, "--speed: is missing, and the machine names no speed of its own")
    return np.asarray(speeds)


def points_and_range(scene: jc.scene.Scene, single: Sequence[str] | None, speeds: str | None):
    """[rad/s] Single speeds of `--speed`, `--speeds` or the scene; the range of `--speeds`, or `None`."""
    import numpy as np

    needs_rotor(scene)  # told before a speed that the command line lacks
    range_ = None
    listed_speeds = []
    if speeds is not None and ":" in speeds:
        range_ = speeds_of(speeds)
    elif speeds is not None:
        listed_speeds = speeds_of(speeds).tolist()
    points = [speed_of(text, f"--speed {text}") for text in single or ()]
    points += listed_speeds
    if not points:
        return scene_speeds(scene), range_
    return np.array(points), range_


def needs_rotor(scene: jc.scene.Scene) -> None:
    """Refuse a machine without a rotor."""
    if "rotor" not in scene.parts:
        missing = f"the machine file has no [rotor], which `{command_name()}` needs"
        raise jc.scene.SceneError("", missing, file=scene.file)


def rotor_of(scene: jc.scene.Scene, *speeds: np.ndarray | None) -> jc.rotor.RotorModel:
    """The rotor of a scene, its films under the static loads of the crank where they name none.

    Args:
        scene: the scene.
        speeds: [rad/s] at which it will be solved; without any, films keep open loads.
    """
    import numpy as np

    from ..rotor._system import System

    needs_rotor(scene)
    all_speeds = np.concatenate([s for s in speeds if s is not None] or [[]])
    model = jc.rotor_at(scene, np.unique(all_speeds))
    assert not isinstance(model, System)  # a scene holds no prepared one
    return model


def chosen_excitation(scene: jc.scene.Scene, requested: opt.Excitation | None) -> opt.Excitation:
    """Source of the forces on the rotor of a machine: of `--excitation`, or by the rule of
    `Assembly.excitation`.
    """
    try:
        return scene.assembly.excitation(requested)
    except jc.BadInput:
        missing = "loads.crank: is missing; --excitation crank needs it"
        raise CommandError(f"{scene.file}: {missing}") from None


def pull_row(result: dict[str, Any]):
    """The limit of the unbalanced magnetic pull, for the table of convergence or stability."""
    if result["magnetic_pull_limit"] is not None:
        yield "Magnetic pull", f"{result['magnetic_pull_limit']:.4g}", "times it is unstable"


def whirl(share: float) -> str:
    """Direction of an orbit from its minor over its major axis."""
    if abs(share) < _LINE:
        return "plane"
    if share > 0:
        return "forward"
    return "backward"
