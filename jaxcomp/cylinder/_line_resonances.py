"""Frequencies at which the pipes of a machine ring by themselves, before any cycle is solved."""

from typing import NamedTuple

from jaxtyping import Array, Float

from ..piping import resonances
from ._cylinder import Cylinder, prepare
from ._waves import lines_of, waves_at_rest


class LineResonance(NamedTuple):
    """A resonance of the pipes of a line with its flanges shut.

    Attributes:
        line: "suction" or "discharge".
        frequency: [Hz]
        quality: [-] Q; losses of walls or a given attenuation and resistances, no mean flow.
    """

    line: str
    frequency: Float[Array, ""]
    quality: Float[Array, ""]


def line_resonances(
    cylinder: Cylinder, mechanism, speed: float, highest: float
) -> list[LineResonance]:
    """Resonances of all pipes of a machine, of either line from the lowest.

    The gas behind the discharge valve is that of the line, as nothing is delivered yet.

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] of the crank.
        highest: [Hz] up to which they are sought.
    """
    case = prepare(cylinder, mechanism, speed)
    named = []
    for side, (line, waves) in enumerate(zip(lines_of(case), waves_at_rest(cylinder), strict=True)):
        if line is None or waves is None:
            continue
        gas = line.gas(waves.temperature)
        at_line = resonances(line.network(gas), gas, highest)
        name = ("suction", "discharge")[side]
        for frequency, quality in zip(at_line.frequency, at_line.quality, strict=True):
            named.append(LineResonance(name, frequency, quality))
    return named
