"""Speeds on the command line: `--speed 3000rpm` and `--speeds 600rpm:6000rpm:100`."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..scene import Scene, SceneError, to_si
from ._arguments import with_one_unit
from ._errors import CommandError

if TYPE_CHECKING:  # a speed can be read without the rotor
    from ..rotor import RotorModel

# Points of a range that names none.
POINTS = 60


def single_speeds(texts: Sequence[str], scene: Scene) -> np.ndarray:
    """[rad/s] The speeds of `--speed`, or those that the scene runs at.

    Raises:
        CommandError: no speed, one below zero, or none known.
    """
    if texts:
        return np.array([_speed(text, f"--speed {text}") for text in texts])
    from ..running import own_speeds

    own = own_speeds(scene.parts.get("balancing"), scene.compressor)
    if own is not None:
        return np.asarray(own)
    raise CommandError("--speed: is missing, and the scene names no speed of its own")


def speed_range(text: str) -> np.ndarray:
    """[rad/s] The speeds of `--speeds from:to` or `from:to:count`.

    Raises:
        CommandError: another form, a range that does not rise, or fewer than two points.
    """
    parts = text.split(":")
    option = f"--speeds {text}"
    if len(parts) not in (2, 3):
        raise CommandError(f"{option}: must have the form from:to or from:to:count")
    low, high = (_speed(part, option) for part in with_one_unit(parts[:2]))
    count = POINTS
    if len(parts) == 3:
        if not parts[2].strip().isdigit():
            raise CommandError(f"{option}: the number of points must be a whole number")
        count = int(parts[2])
    if not low < high:
        raise CommandError(f"{option}: must rise")
    if not 2 <= count <= 100_000:
        raise CommandError(f"{option}: must have 2 to 100000 points")
    return np.linspace(low, high, count)


def rotor_of(scene: Scene, *speeds: np.ndarray | None) -> "RotorModel":
    """The rotor of a scene, its films under the static loads of the crank where they name none.

    Args:
        scene: the scene.
        speeds: [rad/s] at which it will be asked; without any, films keep open loads.

    Raises:
        SceneError: it has none.
    """
    from ..rotor import System
    from ..running import rotor_at

    if "rotor" not in scene.parts:
        raise SceneError("rotor", "is missing: this scene describes no rotor", file=scene.file)
    wanted = np.concatenate([s for s in speeds if s is not None] or [[]])
    model = rotor_at(scene, np.unique(wanted))
    assert not isinstance(model, System)  # a scene holds no prepared one
    return model


def _speed(text: str, option: str) -> float:
    # on the command line a frequency of rotation can be nothing but a speed
    text = re.sub(r"\s*hz\s*$", " turn/s", text.strip(), flags=re.IGNORECASE)
    value = float(to_si(text, "rad/s", option))
    if value < 0:
        raise CommandError(f"{option}: must be >= 0 rad/s")
    return value
