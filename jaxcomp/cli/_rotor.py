"""Speeds on the command line, and parts that the commands of rotors share."""

import re
from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any

import typer

import jaxcomp as jc

from ._arguments import with_one_unit
from ._errors import CommandError
from ._options import Excitation

if TYPE_CHECKING:
    import numpy as np

    from ..rotor import RotorModel
    from ..scene import Scene

# Points of a range that names none, and the most.
_POINTS, _MOST = 60, 100_000
# Below this share of backward or forward motion an orbit is called a line.
_LINE = 0.05

Speed = Annotated[
    list[str] | None,
    typer.Option(
        "--speed",
        metavar="SPEED",
        help="Speed to solve, e.g. 3000rpm; those of the scene if absent. Repeatable.",
    ),
]
Speeds = Annotated[
    str | None,
    typer.Option(
        metavar="SPEEDS",
        help="Speeds to solve, e.g. 3000rpm,3600rpm, or a range from:to or from:to:count, e.g. "
        "300rpm:6000rpm:200, for curves, Campbell diagram and critical speeds.",
    ),
]


def speeds_of(text: str) -> "np.ndarray":
    """[rad/s] The speeds of `--speeds a,b,c`, `from:to` or `from:to:count`.

    Raises:
        CommandError: another form, a range that does not rise, or fewer than two points of one.
    """
    import numpy as np

    parts, option = text.split(":"), f"--speeds {text}"
    if len(parts) == 1 and "," in text:
        return np.array([_speed(part, option) for part in with_one_unit(text.split(","))])
    if len(parts) == 1 and text.strip():
        return np.array([_speed(text, option)])
    if len(parts) not in (2, 3):
        raise CommandError(f"{option}: must have the form a,b,c or from:to or from:to:count")
    low, high = (_speed(part, option) for part in with_one_unit(parts[:2]))
    count = _POINTS
    if len(parts) == 3:
        if not parts[2].strip().isdigit():
            raise CommandError(f"{option}: the number of points must be a whole number")
        count = int(parts[2])
    if not low < high:
        raise CommandError(f"{option}: must rise")
    if not 2 <= count <= _MOST:
        raise CommandError(f"{option}: must have 2 to {_MOST} points")
    return np.linspace(low, high, count)


def scene_speeds(scene: "Scene") -> "np.ndarray":
    """[rad/s] The speeds that the scene runs at.

    Raises:
        CommandError: none known.
    """
    import numpy as np

    from ..running import own_speeds

    own = own_speeds(scene.parts.get("balancing"), scene.compressor)
    if own is None:
        raise CommandError("--speed: is missing, and the scene names no speed of its own")
    return np.asarray(own)


def points_and_range(scene: "Scene", single: Sequence[str] | None, speeds: str | None):
    """[rad/s] Single speeds of `--speed`, of a list in `--speeds` or of the scene; the range, or `None`.

    Raises:
        CommandError: a speed below zero, no range, or no speed known.
    """
    import numpy as np

    given = None if speeds is None else speeds_of(speeds)
    range_ = given if ":" in (speeds or "") else None
    points = [_speed(text, f"--speed {text}") for text in single or ()]
    if given is not None and range_ is None:
        points += given.tolist()
    return np.array(points) if points else scene_speeds(scene), range_


def rotor_of(scene: "Scene", *speeds: "np.ndarray | None") -> "RotorModel":
    """The rotor of a scene, its films under the static loads of the crank where they name none.

    Args:
        scene: the scene.
        speeds: [rad/s] at which it will be solved; without any, films keep open loads.

    Raises:
        SceneError: it has none.
    """
    import numpy as np

    from ..running import rotor_at

    if "rotor" not in scene.parts:
        missing = "is missing: this scene describes no rotor"
        raise jc.scene.SceneError("rotor", missing, file=scene.file)
    wanted = np.concatenate([s for s in speeds if s is not None] or [[]])
    model = rotor_at(scene, np.unique(wanted))
    assert not isinstance(model, jc.rotor.System)  # a scene holds no prepared one
    return model


def chosen_excitation(scene: "Scene", given: Excitation | None) -> Excitation:
    """What shakes the rotor of a scene: of `--excitation`, or by the rule of `Assembly.excitation`.

    Raises:
        CommandError: the crank's forces of a scene that does not join the crank to the rotor.
    """
    try:
        return Excitation(scene.assembly.excitation(given and given.value))
    except jc.BadInput:
        missing = "loads.crank: is missing; --excitation crank needs it"
        raise CommandError(f"{scene.file}: {missing}") from None


def header(scene: "Scene", model: "RotorModel", free: bool = False) -> dict[str, Any]:
    """What the results of rotors have in common."""
    # hanging free a rotor has no bearings that could hold it against the magnetic pull
    pulled = model.magnetic_pulls and not free
    groups = zip(jc.rotor.subset_names(model), jc.rotor.subsets(model), strict=True)
    return {
        "machine": scene.name,
        "file": scene.file,
        "version": version("jaxcomp"),
        "degrees_of_freedom": model.dof,
        "subsets": {name: [str(node) for node in group] for name, group in groups},
        "magnetic_pull_limit": float(jc.rotor.magnetic_pull_limit(model)) if pulled else None,
    }


def pull_row(result: dict[str, Any]):
    """The limit of the unbalanced magnetic pull, for the table of convergence or stability."""
    if result["magnetic_pull_limit"] is not None:
        yield "Magnetic pull", f"{result['magnetic_pull_limit']:.4g}", "times it is unstable"


def whirl(share: float) -> str:
    """Direction of an orbit from its minor over its major axis."""
    return "plane" if abs(share) < _LINE else "forward" if share > 0 else "backward"


def _speed(text: str, option: str) -> float:
    # on the command line a frequency of rotation can be nothing but a speed
    text = re.sub(r"\s*hz\s*$", " turn/s", text.strip(), flags=re.IGNORECASE)
    value = float(jc.scene.to_si(text, "rad/s", option))
    if value < 0:
        raise CommandError(f"{option}: must be >= 0 rad/s")
    return value
