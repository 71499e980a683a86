"""The blocks of a model in the places where the elimination along lines of nodes takes them."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ._conventions import add, take
from ._layout import BORDER, LEFT, NEXT, RIGHT, Layout

# components of a block turned over, and those of a symmetric one
TURNED = np.array([0, 2, 1, 3])
_SYMMETRIC = np.array([0, 1, 3])


class Places(NamedTuple):
    """Blocks of one plane in their places; the last axis is over terms or over components.

    Attributes:
        segment: (m, 11, c, .) diagonal, Z_{j-1,j}, and coupling to the left border node.
        right: (s, 4, .) from the last node of each segment towards the right border node.
        border: (b * b, 4, .) between border nodes.
    """

    segment: Array
    right: Array
    border: Array


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
    border = add(zero(b * b), np.concatenate([diagonal_rows, forth, back]), values)

    def place(which):
        rows = np.flatnonzero(kind == which)
        return add(zero(m * c), first[rows] * c + second[rows], take(off, rows))

    symmetric = take(diagonal, layout.segment.reshape(-1))[:, _SYMMETRIC]
    segment = jnp.concatenate([symmetric, place(NEXT), place(LEFT)], 1)
    rows = np.flatnonzero(kind == RIGHT)
    right = add(zero(s), second[rows], take(off, rows))
    return Places(jnp.moveaxis(segment.reshape(m, c, 11, terms), 2, 1), right, border)


def at_speed(layout: Layout, places: Places, coefficients: Array) -> Places:
    """The dynamic stiffness in its places, for the factors (terms, components) of the terms."""
    sizes = [int(np.prod(p.shape[:-1])) for p in places]
    flat = jnp.concatenate([p.reshape(-1, p.shape[-1]) for p in places]) @ coefficients
    parts = []
    for part, place in zip(jnp.split(flat, np.cumsum(sizes)[:-1]), places, strict=True):
        parts.append(part.reshape(*place.shape[:-1], part.shape[-1]))
    segment, right, border = parts
    # A unit pivot in empty places, over which the elimination runs without a division by zero.
    empty = np.zeros((*layout.segment.shape, 11))
    empty[layout.segment == layout.n] = np.eye(11)[0] + np.eye(11)[2]
    return Places(segment + np.moveaxis(empty, 2, 1)[..., None], right, border)
