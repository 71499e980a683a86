"""Balances with sectors of a plane where no mass can go."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ._balance import Balance, balance
from ._influence import Influence


class Sector(NamedTuple):
    """A forbidden sector of one plane, from one angle to another in the direction of the spin.

    Attributes:
        plane: name of the plane.
        start, end: [rad]
    """

    plane: str
    start: float
    end: float


def outside_sectors(influence: Influence, sectors: Sequence[Sector]) -> Balance:
    """Least squares with no mass inside the sectors; the best of all such corrections.

    The optimum is free in a plane, on an edge of a sector or zero. Every combination of these is a
    linear least-squares problem, and the best of those whose answer is admissible is the optimum.

    Args:
        influence: the system; its numbers have to be concrete.
        sectors: at most a few, since the combinations multiply.

    Raises:
        BadInput: an unknown plane, or a sector of no width or of a full turn.
    """
    matrix, initial = (np.asarray(x) for x in influence.weighted)
    by_plane: list[list[Sector]] = [[] for _ in influence.planes]
    for sector in sectors:
        if sector.plane not in influence.planes:
            raise BadInput("plane", sector.plane, f"one of {', '.join(influence.planes)}")
        if not 0 < sector.end - sector.start < 2 * np.pi:
            raise BadInput("end", sector.end, "more than `start`, by less than a revolution")
        by_plane[influence.planes.index(sector.plane)].append(sector)
    choices = [
        [None, 0.0, *(np.exp(1j * a) for s in own for a in (s.start, s.end))] if own else [None]
        for own in by_plane
    ]
    best, lowest = np.zeros(len(choices), complex), np.inf
    for choice in itertools.product(*choices):
        correction = _on_faces(matrix, initial, choice)
        if correction is None or not _allowed(correction, choice, by_plane):
            continue
        size = np.linalg.norm(initial + matrix @ correction)
        if size < lowest:
            best, lowest = correction, size
    lowest = jnp.asarray(lowest)
    return balance(influence, jnp.asarray(best), lowest, lowest, "least squares outside sectors")


def _on_faces(matrix, initial, choice):
    """Least squares with each plane free, at zero or along a direction."""
    columns, direction = [], []
    for p, kind in enumerate(choice):
        for factor in (1.0, 1j) if kind is None else () if kind == 0 else (kind,):
            column = matrix[:, p] * factor
            columns.append(np.concatenate([column.real, column.imag]))
            direction.append((p, factor))
    correction = np.zeros(len(choice), complex)
    if not columns:
        return correction
    right = -np.concatenate([initial.real, initial.imag])
    sizes = np.linalg.lstsq(np.stack(columns, 1), right, rcond=1e-12)[0]
    for (p, factor), size in zip(direction, sizes, strict=True):
        if choice[p] is not None and size < 0:
            return None
        correction[p] += size * factor
    return correction


def _allowed(correction, choice, by_plane):
    for value, kind, own in zip(correction, choice, by_plane, strict=True):
        # An edge of one sector may lie inside another one.
        for sector in own:
            turned = (np.angle(value) - sector.start) % (2 * np.pi)
            slack = 0.0 if kind is None else 1e-9
            inside = slack < turned < sector.end - sector.start - slack
            if value != 0 and inside:
                return False
    return True
