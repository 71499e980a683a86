"""Combinations of parameters that readings tell more or less."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._bounded_least_squares import LeastSquares, Parameter
from ._parameter_words import in_words

# What a combination of parameters moves chi-square by over its whole range, below which it is weak.
_WEAK = 1.0
# Singular value over the largest, below which nothing tells a combination.
_UNIDENTIFIABLE = 1e-8
# Entries of a direction that are named, over its largest, and how many of them: nobody reads ten.
_NAMED = 0.05
_MOST_NAMED = 3


class Direction(NamedTuple):
    """A combination of parameters that the readings tell more or less.

    Attributes:
        singular: singular value of the residuals' slopes over t, without priors.
        entries: of the combination, one a parameter, in t; of unit length.
        weak: whether a move over the whole prior or range changes chi-square by less than 1.
        unidentifiable: whether nothing tells it.
        words: such as "c up 10 % with n up 4.3 % and f down 2.8 %", of its three largest entries.
        effect: [-] change of all residuals together, in standard deviations, at that finite move.
    """

    singular: float
    entries: NDArray
    weak: bool
    unidentifiable: bool
    words: str
    effect: float


def directions_of(problem: LeastSquares, t: NDArray, slope: NDArray) -> Iterator[Direction]:
    """Combinations of parameters by how well the readings alone tell them."""
    unit = _units(problem.parameters)
    _, singular, rows = np.linalg.svd(slope * unit, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(t.size - singular.size)])
    for number, (value, entries) in enumerate(zip(singular, rows, strict=True), 1):
        # how far the combination goes until the first parameter leaves its reach
        far = np.min(problem.reach / unit / np.maximum(np.abs(entries), 1e-12))
        # A direction has no sign of its own: the largest entry goes up in words.
        entries = entries * np.sign(entries[np.argmax(np.abs(entries))])
        move = 0.1 / np.abs(entries).max() * entries
        weak = bool(value * far < _WEAK)
        unidentifiable = bool(value <= _UNIDENTIFIABLE * max(singular[0], 1e-300))
        effect = float(value * np.linalg.norm(move))
        worst_known = number == t.size
        if (weak or unidentifiable or worst_known) and not problem.interrupted:
            # of the finite move where it is told
            readings = slope.shape[0]
            moved, _ = problem.at(t + move * unit)
            unmoved, _ = problem.at(t)
            finite = float(np.linalg.norm(moved[:readings] - unmoved[:readings]))
            # by the slopes where the machine so moved has no solution at some point
            if np.isfinite(finite):
                effect = finite
        yield Direction(
            singular=float(value),
            entries=entries,
            weak=weak,
            unidentifiable=unidentifiable,
            words=_words(problem.parameters, move * unit),
            effect=effect,
        )


def _words(parameters: Sequence[Parameter], move: NDArray) -> str:
    """A move in t in words: the largest first, and how many others go along."""
    size = np.abs(move / _units(parameters))
    order = np.argsort(-size, kind="stable")
    named = [n for n in order if size[n] >= _NAMED * size.max()]
    parts = []
    for n in named[:_MOST_NAMED]:
        parameter = parameters[n]
        sense = "up" if move[n] > 0 else "down"
        amount = f"{abs(move[n]):.2g} {parameter.unit}".strip()
        if parameter.log:
            amount = f"{100 * abs(move[n]):.2g} %"
        parts.append(f"{in_words(parameter.name)} {sense} {amount}")
    words = parts[0]
    if len(parts) > 1:
        words += f" with {' and '.join(parts[1:])}"
    omitted = len(named) - len(parts)
    if omitted:
        noun = "others" if omitted > 1 else "other"
        words += f", and {omitted} {noun} by less"
    return words


def _units(parameters: Sequence[Parameter]) -> NDArray:
    """Unit of each parameter in t: ln p as it is, so that 0.1 is 10 %; linear ones in their reach."""
    units = []
    for parameter in parameters:
        if parameter.log:
            units.append(1.0)
        else:
            units.append(parameter.reach)
    return np.array(units)
