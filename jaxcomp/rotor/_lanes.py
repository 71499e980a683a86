r"""The dynamic stiffness of shafts, disks and masses in whirl lanes, sorted for elimination."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ._assembly import from_planes
from ._layout import BORDER, LEFT, NEXT, RIGHT, Layout
from ._operator import Operator
from ._shaft import deformation


class Lanes(NamedTuple):
    diagonal: Array  # (2, 2, m, s, lanes)
    next: Array  # (2, 2, m, s, lanes), Z_{j-1,j}
    left: Array  # (2, 2, m, s, lanes), towards the left border node
    right: Array  # (2, 2, s, lanes), from the last node towards the right border node
    border: Array  # (2 b, 2 b, lanes)


def lanes_of(layout: Layout, z: Operator) -> Lanes:
    """The dynamic stiffness of shafts, disks and masses, sorted into segments and border."""
    st, w, spin = z.structure, z.frequency, z.spin_speed
    el = st.elements
    shape = jax.vmap(deformation)(el.length)
    bend = jnp.einsum("eki,ekl,elj->eij", shape, el.lateral, shape)
    sort = lambda e, n: _sorted(layout, e, n)  # noqa: E731
    k = sort(bend, jnp.zeros_like(st.mass))
    m, g = sort(el.mass, st.mass), sort(el.polar, st.polar)
    alpha, beta = (0.0, 0.0) if st.damping is None else st.damping
    stiff, inert = (1.0, -(w**2))
    if st.damping is not None:
        stiff, inert = 1 + 1j * w * beta, -(w**2) + 1j * w * alpha

    def whirl(k, m, g):
        both = stiff * k + inert * m
        return jnp.stack([both + w * spin * g, both - w * spin * g], -1)

    lanes = Lanes(*map(whirl, k, m, g))
    if layout.dof == 6:
        bar = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
        bars = jnp.einsum("ea,fg,ab->efagb", el.axial, bar, jnp.eye(2)).reshape(-1, 4, 4)
        k, m = sort(bars, jnp.zeros_like(st.mass)), sort(el.axial_mass, st.axial_mass)
        axial = Lanes(*((stiff * a + inert * b)[..., None] for a, b in zip(k, m, strict=True)))
        lanes = Lanes(*(jnp.concatenate(pair, -1) for pair in zip(lanes, axial, strict=True)))
    empty = jnp.asarray(layout.segment == layout.n)[..., None]
    one = jnp.eye(2)[:, :, None, None, None]
    return lanes._replace(diagonal=jnp.where(empty, one, lanes.diagonal))


def _sorted(layout: Layout, elements: Array, nodes: Array) -> Lanes:
    """Element and node blocks of one matrix in one plane, in their places (lanes axis absent)."""
    b, (m, s) = len(layout.border), layout.segment.shape
    i, j = layout.pairs.T
    diagonal = jnp.concatenate([nodes, jnp.zeros((1, 2, 2))])
    diagonal = diagonal.at[i].add(elements[:, :2, :2]).at[j].add(elements[:, 2:, 2:])
    kind, first, second, turned = layout.slots.T
    off = elements[:, :2, 2:]
    off = jnp.where(turned[:, None, None] == 1, jnp.swapaxes(off, 1, 2), off)
    own = np.arange(b)
    border = jnp.zeros((b, b, 2, 2)).at[own, own].set(diagonal[layout.border])
    at = kind == BORDER
    border = border.at[first[at], second[at]].add(off[at])
    border = border.at[second[at], first[at]].add(jnp.swapaxes(off[at], 1, 2))

    def place(at):
        return jnp.zeros((m, s, 2, 2)).at[first[at], second[at]].add(off[at]).transpose(2, 3, 0, 1)

    right = kind == RIGHT
    return Lanes(
        diagonal[layout.segment].transpose(2, 3, 0, 1) if m else jnp.zeros((2, 2, m, s)),
        place(kind == NEXT),
        place(kind == LEFT),
        jnp.zeros((s, 2, 2)).at[second[right]].add(off[right]).transpose(1, 2, 0),
        border.transpose(0, 2, 1, 3).reshape(2 * b, 2 * b),
    )


def to_lanes(plane):
    """(n, planes, 2) -> (n, lanes, 2)."""
    x, y = plane[:, 0], plane[:, 1]
    lateral = np.sqrt(0.5) * jnp.stack([x + 1j * y, x - 1j * y], 1)
    return jnp.concatenate([lateral, plane[:, 2:]], 1)


def from_lanes(lanes, dof):
    p, q = lanes[:, 0], lanes[:, 1]
    lateral = np.sqrt(0.5) * jnp.stack([p + q, -1j * (p - q)], 1)
    return from_planes(jnp.concatenate([lateral, lanes[:, 2:]], 1), dof)
