r"""Corrections that exist: out of a stock, split over holes."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._core.errors import BadInput
from .._core.status import Status
from ._balance import Balance, balance
from ._influence import Influence


def discrete(
    influence: Influence,
    options: Sequence[np.ndarray],
    *,
    most: int = 2_000_000,
) -> Balance:
    """The best correction out of a finite stock for each plane, in the weighted sum of squares.

    Branch and bound over the planes: with the first planes chosen, least squares over the others
    without any stock is a bound that no choice of theirs gets below, so that branches above the
    best known choice are left out unseen. With `most` nodes spent, the best so far is returned, with
    the smallest bound of what is left.

    Args:
        influence: the system; its numbers have to be concrete.
        options: [kg m] for each plane the complex unbalances in stock; put a zero among them if
            the plane may stay empty.
        most: combinations to look at.

    Raises:
        BadInput: a plane without a stock, a number that is not finite, or another number of stocks
            than of planes.
    """
    matrix, initial, stocks = _concrete(influence, options)
    # The plane of the largest influence first: its choices differ most, so that bounds bite early.
    spread = np.array([np.ptp(np.abs(stock)) for stock in stocks])
    order = np.argsort(-np.linalg.norm(matrix, axis=0) * spread)
    # What the planes still to come can take off: projectors onto the complements of their columns.
    later_basis = []
    for level in range(1, len(order)):
        later_basis.append(np.linalg.qr(matrix[:, order[level:]])[0])
    later_basis.append(np.zeros((matrix.shape[0], 0)))
    best, lowest = _greedy(matrix, initial, stocks)
    nodes = 0
    unseen_bound = np.inf
    # A stack: depth first there is soon a whole combination, by which the other branches are measured.
    waiting = [(0.0, initial, ())]
    while waiting:
        below, vibration, choices = waiting.pop()
        # a better combination may have come since this branch was put on the stack
        if below >= lowest:
            continue
        # not broken off: the least bound of all that waits is what the result can still claim
        if nodes >= most:
            unseen_bound = min(unseen_bound, below)
            continue
        level = len(choices)
        plane = order[level]
        vibrations = vibration[:, None] + matrix[:, plane, None] * stocks[plane]
        # By Pythagoras what the planes to come cannot reach stays; rounding may make it negative.
        basis = later_basis[level]
        inside = basis.conj().T @ vibrations
        bounds = np.sqrt(
            np.maximum(np.sum(np.abs(vibrations) ** 2, 0) - np.sum(np.abs(inside) ** 2, 0), 0)
        )
        nodes += stocks[plane].size
        if level + 1 == len(order):
            at = int(np.argmin(bounds))
            if bounds[at] < lowest:
                lowest = float(bounds[at])
                best = np.zeros(len(order), complex)
                for p, i in zip(order, (*choices, at), strict=True):
                    best[p] = stocks[p][i]
            continue
        # The most promising branch ends up on top of the stack.
        for i in np.argsort(-bounds):
            if bounds[i] < lowest:
                waiting.append((float(bounds[i]), vibrations[:, i], (*choices, int(i))))
    bound = jnp.asarray(min(lowest, unseen_bound))
    lowest = jnp.asarray(lowest)
    failure = Status.where(bound < lowest, Status.not_converged, Status.converged)
    return balance(influence, jnp.asarray(best), lowest, bound, "discrete", failure)


def _concrete(
    influence: Influence, options: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Matrix, vibration before and stocks as numbers, each stock without repetitions."""
    matrix, initial = (np.asarray(x) for x in influence.weighted)
    stocks = [np.unique(np.asarray(stock, complex)) for stock in options]
    if len(stocks) != len(influence.planes) or not all(s.size for s in stocks):
        raise BadInput(
            "options", len(stocks), f"a stock for each of {len(influence.planes)} planes"
        )
    if not all(np.all(np.isfinite(numbers)) for numbers in (matrix, initial, *stocks)):
        raise BadInput("options", "with a number that is none", "of finite numbers")
    return matrix, initial, stocks


def _greedy(matrix, initial, stocks):
    """Each plane's best choice given the others, until none changes."""
    # A first best, near the answer without stocks: the lower it is, the more branches fall at once.
    free = -np.linalg.lstsq(matrix, initial, rcond=1e-12)[0]
    nearest = []
    for stock, unbalance in zip(stocks, free, strict=True):
        nearest.append(stock[np.argmin(np.abs(stock - unbalance))])
    picked = np.array(nearest)
    lowest = np.inf
    while True:
        for p, stock in enumerate(stocks):
            # with this plane's own choice taken off again, what remains is for the best of its stock
            by_others = initial + matrix @ picked - matrix[:, p] * picked[p]
            sizes = np.linalg.norm(by_others[:, None] + matrix[:, p, None] * stock, axis=0)
            picked[p] = stock[np.argmin(sizes)]
        size = float(np.linalg.norm(initial + matrix @ picked))
        if size >= lowest:
            return picked, size
        lowest = size


def stock(masses: Sequence[float], angles: Sequence[float], radius: float) -> np.ndarray:
    """[kg m] All unbalances of single masses at single places, and none at all.

    Args:
        masses: [kg] in stock.
        angles: [rad] of the places.
        radius: [m] of the places.
    """
    places = np.exp(1j * np.asarray(angles, float))
    return np.append(np.outer(np.asarray(masses, float), places).ravel() * radius, 0.0)


class Split(NamedTuple):
    """Masses in holes that stand for one correction.

    Attributes:
        masses: [kg] (holes,) in the order of the holes.
        error: [kg m] what the holes leave of the correction, where a mass is at its limit.
    """

    masses: np.ndarray
    error: complex


def split(
    correction: complex, angles: Sequence[float], radius: float, largest: float = np.inf
) -> Split:
    """Divide a correction over holes: the masses that come closest to it.

    Without a limit only the two holes beside it are used, which takes the least mass; where a hole
    is full, the neighbours take over.

    Args:
        correction: [kg m] with its angle.
        angles: [rad] of the holes.
        radius: [m] of the holes.
        largest: [kg] in one hole.

    Raises:
        BadInput: no hole, a radius or a limit that is not positive.
    """
    at = np.asarray(angles, float)
    if not (np.isfinite(correction) and np.all(np.isfinite(at))):
        raise BadInput("correction", correction, "finite, as must be the angles")
    for field, value in (("radius", radius), ("largest", largest), ("angles", at.size)):
        if not value > 0:
            raise BadInput(field, value, "> 0")
    from scipy.optimize import lsq_linear, nnls

    arms = radius * np.stack([np.cos(at), np.sin(at)])
    target = np.array([complex(correction).real, complex(correction).imag])
    # In units of the one mass that would do in a hole at the right angle.
    scale = max(abs(complex(correction)) / radius, 1e-300)
    # A trace of the mass itself makes the answer the lightest one.
    light = 1e-7 * radius
    system = np.vstack([arms, light * np.ones(at.size)])
    right = np.append(target / scale, 0.0)
    # An active-set method empties holes exactly. With a limit the solver comes from inside of the
    # bounds and leaves a trace of mass in every hole.
    if np.isinf(largest):
        masses = nnls(system, right)[0]
    else:
        masses = lsq_linear(system, right, (0.0, largest / scale), tol=1e-14).x
    masses = np.where(masses < 1e-9, 0.0, masses) * scale
    error = target - arms @ masses
    return Split(masses, complex(error[0], error[1]))
