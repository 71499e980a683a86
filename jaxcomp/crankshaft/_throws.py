"""Throws of a crankshaft: the rods on each pin, and layouts that go by a name."""

import re
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, Part, quantity

# Throws of a layout, and rods of a star.
_MOST = 64


class Throw(Part):
    """One throw of the crankshaft with the rods on its pin.

    Args:
        angle: [rad] of the pin, ahead of the first throw in the sense of rotation.
        position: [m] middle of the pin along the shaft.
        banks: [rad] (n,) direction of each cylinder's axis, in the order of the rods along the shaft.
        rod_pitch: [m] between neighbouring rods along the shaft.
        unbalance: [kg m] of the crank at this throw without rods, positive at the pin's side; that
            of a counterweight is negative.
    """

    kind: ClassVar[str] = "throw"

    banks: Float[Array, " n"] = quantity("rad", ANY, shape=(None,))
    angle: Float[Array, ""] = quantity("rad", ANY, default=0.0)
    position: Float[Array, ""] = quantity("m", ANY, default=0.0)
    rod_pitch: Float[Array, ""] = quantity("m", ANY, default=0.0)
    unbalance: Float[Array, ""] = quantity("kg m", ANY, default=0.0)

    def __check_init__(self):
        if not self.banks.size:
            raise BadInput("banks", "[]", "at least one bank angle")


def throws_of(name: str) -> list[tuple[float, list[float]]]:
    """Angle of each throw and banks on it [deg] of a layout by name.

    Raises:
        BadInput: a name that stands for none.
    """
    text = re.sub(r"[ _-]", "", name.lower())
    times = 1
    fan = re.fullmatch(r"(v{1,2}|w|l)(\d+(?:\.\d+)?)(?:x(\d+))?", text)
    flat = re.fullmatch(r"(single|inline|boxer|opposed|radial)(\d*)(?:x(\d+))?", text)
    # a fan that went right round would put two cylinders into one place
    if fan and float(fan[2]) * {"w": 2, "vv": 3}.get(fan[1], 1) < 360:
        kind = fan[1]
        spacing = float(fan[2])
        times = int(fan[3] or 1)
        count = {"v": 2, "l": 2, "w": 3, "vv": 4}[kind]
        banks = [_fan(count, spacing)]
    elif flat and (flat[2] or flat[1] not in ("inline", "radial")):
        kind = flat[1]
        count = int(flat[2] or 2)
        times = int(flat[3] or 1)
        if kind == "radial":
            if not 1 <= count <= _MOST:
                times = 0
            banks = [_star(min(count, _MOST))]
        elif kind == "opposed":
            banks = [[0.0, 180.0]]
        else:
            times *= {"single": 1}.get(kind, count)
            # the pistons of a boxer have throws of their own, opposed ones share theirs
            banks = [[0.0], [180.0]] if kind == "boxer" else [[0.0]]
    else:
        times = 0
        banks = [[0.0]]
    if times < 1 or times > _MOST:
        examples = (
            '"single", "in-line-4", "boxer-2", "opposed", "radial-5", "V90", "W60", "VV45", "V90x2"'
        )
        raise BadInput("layout", name, f"a layout such as {examples}")
    mirrored = times % 2 == 0 and times > 2
    distinct = times // 2 if mirrored else times
    angles = _star(distinct)
    # An in-line crank that is its own mirror image leaves no couple of any order.
    if mirrored:
        angles += angles[::-1]
    throws = []
    for i, angle in enumerate(angles):
        throws.append((angle, banks[i % len(banks)]))
    return throws


def _fan(count: int, spacing: float) -> list[float]:
    """[deg] Directions at equal angles from one to the next, about 0."""
    return [(i - 0.5 * (count - 1)) * spacing for i in range(count)]


def _star(count: int) -> list[float]:
    """[deg] Directions evenly round a revolution, from 0."""
    return [i * 360 / count for i in range(count)]


def rod_places(throw: Throw) -> np.ndarray:
    """Places of the rods about the middle of the pin, in pitches."""
    count = throw.banks.size
    return np.arange(count) - 0.5 * (count - 1)
