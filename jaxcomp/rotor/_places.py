"""The blocks of a model in the places where the elimination along lines of nodes takes them."""

from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ._blocks import real_times_each
from ._conventions import add, take, trailing
from ._layout import BORDER, LEFT, NEXT, RIGHT, Layout

# components of a block turned over, and those of a symmetric one
TURNED = np.array([0, 2, 1, 3])
_SYMMETRIC = np.array([0, 1, 3])


class Places(NamedTuple):
    """Blocks of one plane in their places; the last axis is over terms or over components.

    Attributes:
        segment: (m, 11, c, .) diagonal, Z_{j-1,j}, and coupling to the left border node.
        right: (s, 4, .) from the last node of each segment towards the right border node.
        border: (r, 4, .) between border nodes, for the numbers of `border_blocks`.
    """

    segment: Array
    right: Array
    border: Array


@lru_cache(maxsize=64)
def border_blocks(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Blocks of the border that anything fills; of many border nodes few are coupled to each other.

    Returns:
        Numbers i b + j (r,) of the blocks, and the places of all numbers among them (b * b + 1,), r for
        those that stay empty and for the number b * b of what is left out.
    """
    b = len(layout.border)
    at = layout.slots[:, 0] == BORDER
    place = np.full(layout.n + 1, b)
    place[layout.border] = np.arange(b)
    # Neighbours by an element, by the segment between them or by a link: a magnetic pull is one.
    pairs = np.concatenate([layout.slots[at, 1:3], layout.ends.T, place[layout.links]])
    pairs = pairs[(pairs < b).all(1)]
    first, second = pairs.T
    diagonal = np.arange(b) * (b + 1)
    numbers = np.unique(np.concatenate([diagonal, first * b + second, second * b + first]))
    places = np.full(b * b + 1, len(numbers))
    places[numbers] = np.arange(len(numbers))
    return numbers, places


def sort_places(layout: Layout, elements: Array, inertia: Array) -> Places:
    """Bring the matrices of elements (e, 4, 4, .) and nodes (n, 2, 2, .) to their places."""
    b = len(layout.border)
    s = layout.last_nodes.shape[1]
    terms = inertia.shape[-1]
    m, c = layout.segment.shape
    blocks = elements.reshape(-1, 2, 2, 2, 2, terms)  # (e, end, component, end, component, .)
    ends = jnp.stack([blocks[:, 0, :, 0], blocks[:, 1, :, 1]], 1)
    # A row of zeros behind the last node is what empty places of the segments read.
    diagonal = add(jnp.concatenate([inertia, jnp.zeros((1, 2, 2, terms))]), layout.pairs, ends)
    diagonal = diagonal.reshape(-1, 4, terms)
    kind, first, second, turned = layout.slots.T
    # An element may run against its segment; its coupling is then the transposed block.
    off = jnp.where(turned[:, None, None, None] == 1, blocks[:, 1, :, 0], blocks[:, 0, :, 1])
    off = off.reshape(-1, 4, terms)
    zero = lambda rows: jnp.zeros((rows, 4, terms))  # noqa: E731
    at = kind == BORDER
    diagonal_rows = np.arange(b) * (b + 1)
    forth = first[at] * b + second[at]
    back = second[at] * b + first[at]
    joined = take(off, np.flatnonzero(at))
    values = jnp.concatenate([take(diagonal, layout.border), joined, joined[:, TURNED]])
    numbers, border_places = border_blocks(layout)
    rows = border_places[np.concatenate([diagonal_rows, forth, back])]
    border = add(zero(len(numbers)), rows, values)

    def place(which):
        rows = np.flatnonzero(kind == which)
        return add(zero(m * c), first[rows] * c + second[rows], take(off, rows))

    symmetric = take(diagonal, layout.segment.reshape(-1))[:, _SYMMETRIC]
    segment = jnp.concatenate([symmetric, place(NEXT), place(LEFT)], 1)
    rows = np.flatnonzero(kind == RIGHT)
    right = add(zero(s), second[rows], take(off, rows))
    return Places(jnp.moveaxis(segment.reshape(m, c, 11, terms), 2, 1), right, border)


def at_speed(layout: Layout, places: Places, coefficients: Array) -> Places:
    """The dynamic stiffness in its places, for the factors (terms, components, ...) of the terms."""
    sizes = [int(np.prod(p.shape[:-1])) for p in places]
    of_terms = jnp.concatenate([p.reshape(-1, p.shape[-1]) for p in places])
    flat = real_times_each(of_terms, coefficients)
    parts = []
    for part, place in zip(jnp.split(flat, np.cumsum(sizes)[:-1]), places, strict=True):
        parts.append(part.reshape(*place.shape[:-1], *part.shape[1:]))
    segment, right, border = parts
    # A unit pivot in empty places, over which the elimination runs without a division by zero.
    empty = np.zeros((*layout.segment.shape, 11))
    empty[layout.segment == layout.n] = np.eye(11)[0] + np.eye(11)[2]
    empty = trailing(np.moveaxis(empty, 2, 1), coefficients.ndim - 1)
    return Places(segment + empty, right, border)
