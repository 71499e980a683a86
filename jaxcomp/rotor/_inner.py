"""Border coordinates without links, eliminated while the whirl components are still apart.

One speed, or a few, take one dense factorisation of a library. At many speeds the coordinates go level by
level, each coupled to the one before and the one behind alone: as in the segments of `_elimination`,
with levels in the place of nodes, and with every line of algebra elementwise over components and speeds.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from ._blocks import lu_factor, lu_solve
from ._conventions import take, trailing

# From this many speeds side by side, and this many levels, levels are faster.
_SPEEDS = 8
_LEVELS = 4


class DenseFactor(NamedTuple):
    """Factors of all untouched coordinates together.

    Attributes:
        lu: their LU, speeds first.
        cross: (untouched, near, components, *speeds) coupling to the touched ones that have any.
        reach: the same of the response to them.
    """

    lu: tuple
    cross: Array
    reach: Array


class LevelFactor(NamedTuple):
    """Factors of the untouched coordinates level by level, see `levels_of`.

    Attributes:
        pivot: (levels, width, width, components, *speeds) D^{-1}.
        before: the same of W, by the level before.
        back: (levels, width, near, components, *speeds) Y = D^{-1} X for the near coordinates.
    """

    pivot: Array
    before: Array
    back: Array


class Levels(NamedTuple):
    """Coordinates in levels such that neighbours are in one level or in adjacent ones.

    Attributes:
        numbers: (levels, width) of the coordinates, one behind the last in empty places.
        places: (f,) of the coordinates in the levels, one after the other.
    """

    numbers: np.ndarray
    places: np.ndarray


def factorise_inner(
    levels: Levels, inner: Array, cross: Array
) -> tuple[DenseFactor | LevelFactor, Array]:
    """Factors, and what the untouched coordinates take from the near ones' stiffness (near, near, ...).

    Args:
        levels: of `levels_of`.
        inner: (f, f, components, *speeds) stiffness of the untouched coordinates, symmetric.
        cross: (f, near, components, *speeds) coupling to the touched ones that have any.
    """
    speeds = inner.shape[3:]
    if len(levels.numbers) < _LEVELS or not speeds or speeds[0] < _SPEEDS:
        lu = lu_factor(speeds_first(inner))
        reach = speeds_last(lu_solve(lu, speeds_first(cross)))
        return DenseFactor(lu, cross, reach), _product_t(cross, reach)
    f = len(inner)
    numbers = levels.numbers
    width = numbers.shape[1]
    empty = (numbers == f).astype(float)
    # A row and column of zeros behind the last one is what empty places read, and a unit pivot in them.
    wide = jnp.pad(inner, [(0, 1), (0, 1)] + [(0, 0)] * (inner.ndim - 2))
    flat = wide.reshape((f + 1) ** 2, *inner.shape[2:])
    columns = numbers[:, None]
    pivots = take(flat, numbers[:, :, None] * (f + 1) + columns)
    pivots = pivots + trailing(empty[:, :, None] * np.eye(width), inner.ndim - 2)
    before = np.concatenate([np.full((1, width), f), numbers[:-1]])
    ahead = take(flat, before[:, :, None] * (f + 1) + columns)
    near = take(jnp.concatenate([cross, jnp.zeros_like(cross[:1])]), numbers)

    def step(carry, row):
        pivot, fill, on_near = carry
        diagonal, ahead, near = row
        w = _product(pivot, ahead)
        pivot = _inverse(diagonal - _product_t(ahead, w))
        fill = near - _product_t(w, fill)
        back = _product(pivot, fill)
        return (pivot, fill, on_near + _product_t(fill, back)), (pivot, w, back)

    # Any finite pivot will do, since the first level has no coupling to one before.
    start = (
        jnp.zeros_like(pivots[0]),
        jnp.zeros_like(near[0]),
        jnp.zeros_like(near[0, :1]) + jnp.zeros_like(near[0, 0])[:, None],
    )
    carry, factors = jax.lax.scan(step, start, (pivots, ahead, near))
    return LevelFactor(*factors), carry[2]


def load_inner(
    factor: DenseFactor | LevelFactor, levels: Levels, load: Array
) -> tuple[Array, Array]:
    """Loads (f, ...) after the elimination, and what they put on the near coordinates."""
    if isinstance(factor, DenseFactor):
        motion = solve_one(factor.lu, load)
        return motion, jnp.sum(factor.cross * motion[:, None], 0)
    # a load of zero behind the last one is what empty places read
    loads = take(jnp.concatenate([load, jnp.zeros_like(load[:1])]), levels.numbers)

    def step(before, row):
        load, w = row
        load = load - _product_t(w, before[:, None])[:, 0]
        return load, load

    loads = jax.lax.scan(step, jnp.zeros_like(loads[0]), (loads, factor.before))[1]
    return loads, jnp.sum(factor.back * loads[:, :, None], (0, 1))


def move_inner(
    factor: DenseFactor | LevelFactor, levels: Levels, loads: Array, near: Array
) -> Array:
    """Motion (f, ...) for loads of `load_inner` and a motion of the near coordinates."""
    if isinstance(factor, DenseFactor):
        return loads - jnp.sum(factor.reach * near, 1)
    motion = jnp.sum(factor.pivot * loads[:, None], 2) - jnp.sum(factor.back * near, 2)

    def step(carry, row):
        following, w_following = carry
        motion, w = row
        motion = motion - _product(w_following, following[:, None])[:, 0]
        return (motion, w), motion

    start = jnp.zeros_like(motion[0]), jnp.zeros_like(factor.before[0])
    motion = jax.lax.scan(step, start, (motion, factor.before), reverse=True)[1]
    return take(motion.reshape(levels.numbers.size, *motion.shape[2:]), levels.places)


def speeds_first(a: Array) -> Array:
    """Matrices (m, n, ...) as a library takes them, (..., m, n)."""
    return jnp.moveaxis(a, (0, 1), (-2, -1))


def speeds_last(a: Array) -> Array:
    """The way back of `speeds_first`."""
    return jnp.moveaxis(a, (-2, -1), (0, 1))


def solve_one(lu: tuple, load: Array, transpose: bool = False) -> Array:
    """Solution for one load (n, ...) with LU factors of speeds first."""
    return speeds_last(lu_solve(lu, speeds_first(load[:, None]), transpose))[:, 0]


def levels_of(coupled: Bool[np.ndarray, "f f"]) -> Levels:
    """Levels of the fewest coordinates.

    Args:
        coupled: whether two coordinates are coupled, symmetric.
    """
    f = len(coupled)
    without_level = set(range(f))
    levels: list[list[int]] = []
    while without_level:
        # Of all beginnings the one with the narrowest levels, whose width is the size of the pivots.
        choices = []
        for start in sorted(without_level):
            choices.append(_levels_from(coupled, start))
        best = min(choices, key=lambda choice: (max(map(len, choice)), len(choice)))
        levels += best
        for level in best:
            without_level -= set(level)
    numbers = np.full((len(levels), max(map(len, levels), default=0)), f)
    for number, level in enumerate(levels):
        numbers[number, : len(level)] = level
    # empty places have the greatest number and come last
    return Levels(numbers, np.argsort(numbers.reshape(-1), kind="stable")[:f])


def _levels_from(coupled, start: int) -> list[list[int]]:
    """Coordinates by their distance from one of them, as far as they are coupled at all."""
    levels = [[start]]
    reached = np.zeros(len(coupled), bool)
    reached[start] = True
    while True:
        adjacent = coupled[levels[-1]].any(0) & ~reached
        if not adjacent.any():
            return levels
        reached |= adjacent
        levels.append(np.flatnonzero(adjacent).tolist())


def _product(a, b):
    """A B for matrices (i, j, ...) and (j, k, ...)."""
    # Term by term, because a sum over an axis would not be one vector instruction after the other.
    terms = [a[:, j, None] * b[j] for j in range(len(b))]
    return sum(terms[1:], terms[0])


def _product_t(a, b):
    """A^T B for matrices (j, i, ...) and (j, k, ...)."""
    if not len(a):
        return jnp.zeros((a.shape[1], *b.shape[1:]), a.dtype)
    terms = [a[j][:, None] * b[j] for j in range(len(b))]
    return sum(terms[1:], terms[0])


def _inverse(a):
    """Inverse of a symmetric matrix (s, s, ...), without exchanges of rows as in `_elimination`."""
    numbers = np.arange(len(a))
    for k in range(len(a)):
        pivot = 1 / a[k, k]
        on_row = trailing(numbers == k, a.ndim - 2)
        row = jnp.where(on_row, pivot, a[k] * pivot)
        column = jnp.where(on_row, 0.0, a[:, k])
        # the column becomes what the inverse has there, and the row is the scaled one
        cleared = jnp.where(on_row, 0.0, a)
        a = jnp.where(on_row[:, None], row, cleared - column[:, None] * row)
    return a
