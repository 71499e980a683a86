"""Frequencies at which the pipes of a machine ring by themselves, before any cycle is solved."""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from .._core.fields import rebuilt
from ..piping import PipeGas, resonances
from ..piping._network import Network
from ..piping._resonances import NAMED_RESONANCES, lowest_resonances
from ._cylinder import Cylinder, prepare
from ._waves import LINES, lines_of, waves_at_rest


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


class _LineAtRest(NamedTuple):
    """The pipes of a line with their gas."""

    name: str
    network: Network
    gas: PipeGas


def _lines_at_rest(cylinder: Cylinder, mechanism, speed, count: int) -> Iterator[_LineAtRest]:
    """Networks of both lines. The gas behind the discharge valve is that of the line, as nothing is
    delivered yet, and before the suction valve it is that which comes.

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] of the crank.
        count: of cylinders.
    """
    suction = cylinder.suction
    if suction.warming is not None:
        # the pipes have the gas as it comes, whatever warms it behind them
        cylinder = rebuilt(cylinder, suction=rebuilt(suction, warming=None))
    case = prepare(cylinder, mechanism, speed)
    # the square law of orifices is linear about the usual flow of all cylinders together
    case = eqx.tree_at(lambda case: case.swept, case, count * case.swept)
    lines = zip(LINES, lines_of(case), waves_at_rest(cylinder), strict=True)
    for name, line, waves in lines:
        if line is not None and waves is not None:
            gas = line.gas(waves.temperature)
            yield _LineAtRest(name, line.network(gas), gas)


def line_resonances(
    cylinder: Cylinder, mechanism, speed: float, highest: float, count: int = 1
) -> list[LineResonance]:
    """Resonances of all pipes of a machine, of either line from the lowest.

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] of the crank.
        highest: [Hz] up to which they are sought.
        count: of cylinders.
    """
    listed = []
    for name, network, gas in _lines_at_rest(cylinder, mechanism, speed, count):
        at_line = resonances(network, gas, highest)
        for frequency, quality in zip(at_line.frequency, at_line.quality, strict=True):
            listed.append(LineResonance(name, frequency, quality))
    return listed


def named_resonances(
    cylinder: Cylinder, mechanism, speed: Float[Array, ""], count: int = 1
) -> dict[str, LineResonance]:
    """The lowest resonances of all pipes by `Cylinder.resonance_names`, also within `jit`.

    Args:
        cylinder: gas, valves and lines.
        mechanism: the piston's motion.
        speed: [rad/s] of the crank.
        count: of cylinders.

    Returns:
        Those of which damping leaves no peak are infinite.
    """
    of_lines = []
    for name, network, gas in _lines_at_rest(cylinder, mechanism, speed, count):
        lowest = lowest_resonances(network, gas, NAMED_RESONANCES)
        for frequency, quality in zip(lowest.frequency, lowest.quality, strict=True):
            of_lines.append(LineResonance(name, frequency, quality))
    return dict(zip(cylinder.resonance_names, of_lines, strict=True))
