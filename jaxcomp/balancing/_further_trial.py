"""Trial positions that tell systems apart which were measured without phase."""

import itertools
from typing import NamedTuple

import numpy as np

from ._influence import Influence


class FurtherTrial(NamedTuple):
    """A run that tells alternatives apart.

    Attributes:
        plane: in which a trial weight is set.
        weight: [kg m] with its angle.
        row: number of the reading that tells.
        amplitudes: [m] that each system expects there, the first one first.
    """

    plane: str
    weight: complex
    row: int
    amplitudes: tuple[float, ...]


def further_trial(influence: Influence, size: float) -> FurtherTrial | None:
    """The trial position that tells a system best from its alternatives; `None` without any.

    Args:
        influence: of `amplitude_influence`.
        size: [kg m] of the trial weight.
    """
    systems = (influence, *influence.alternatives)
    if len(systems) == 1:
        return None
    # every 15 degrees: the run has to tell the systems apart, not to be the best of all that would
    angles = np.deg2rad(np.arange(0.0, 360.0, 15.0))
    best = None
    widest = -1.0
    for number, plane in enumerate(influence.planes):
        for angle in angles:
            weight = size * complex(np.exp(1j * angle))
            vibrations = [system.initial + system.matrix[:, number] * weight for system in systems]
            expected = np.abs(np.stack(vibrations))
            share = expected / np.abs(np.asarray(influence.initial))
            # The two systems that are hardest to tell apart decide, at the reading that tells them best.
            pairs = itertools.combinations(share, 2)
            spread = min(np.max(np.abs(first - second)) for first, second in pairs)
            # of equally good positions the first, whatever the last digit says on another machine
            if spread > widest * (1 + 1e-9):
                row = int(np.argmax(np.ptp(share, axis=0)))
                widest = spread
                best = FurtherTrial(plane, weight, row, tuple(expected[:, row].tolist()))
    return best
