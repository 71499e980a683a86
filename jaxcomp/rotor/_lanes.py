r"""The dynamic stiffness of shafts, disks and masses in whirl lanes, sorted for elimination."""

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ._conventions import from_planes
from ._layout import BORDER, LEFT, NEXT, RIGHT, Layout

if TYPE_CHECKING:
    from ._system import Structure


class Lanes(NamedTuple):
    """Blocks in their places; in matrices of one plane the axis over lanes is absent."""

    diagonal: Array  # (2, 2, m, c, lanes)
    next: Array  # (2, 2, m, c, lanes), Z_{j-1,j}
    left: Array  # (2, 2, m, c, lanes), towards the left border node
    right: Array  # (2, 2, s, lanes), from the last node towards the right border node
    border: Array  # (2 b, 2 b, lanes)


class Sorted(NamedTuple):
    """Stiffness, inertia and polar inertia in one plane, and the axial-torsional pair."""

    stiffness: Lanes
    mass: Lanes
    polar: Lanes
    axial: tuple[Lanes, Lanes] | None


def sort_structure(layout: Layout, structure: "Structure") -> Sorted:
    """Bring the elements to their places, once for all speeds."""
    el, none = structure.elements, jnp.zeros_like(structure.mass)
    bend = jnp.einsum("eki,ekl,elj->eij", el.shape, el.lateral, el.shape)
    axial = None
    if layout.dof == 6:
        bar = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
        bars = jnp.einsum("ea,fg,ab->efagb", el.axial, bar, jnp.eye(2)).reshape(-1, 4, 4)
        axial = (
            _sorted(layout, bars, none),
            _sorted(layout, el.axial_mass, structure.axial_mass),
        )
    return Sorted(
        _sorted(layout, bend, none),
        _sorted(layout, el.mass, structure.mass),
        _sorted(layout, el.polar, structure.polar),
        axial,
    )


def lanes_of(layout: Layout, places: Sorted, damping, frequency, spin_speed) -> Lanes:
    """The dynamic stiffness of shafts, disks and masses, sorted into segments and border.

    Args:
        layout: where everything belongs.
        places: the matrices in their places.
        damping: (alpha, beta) or None, in which case the lanes are real.
        frequency: [rad/s] w.
        spin_speed: [rad/s] W.
    """
    w, stiff, inert = frequency, 1.0, -(frequency**2)
    if damping is not None:
        stiff, inert = 1 + 1j * w * damping[1], inert + 1j * w * damping[0]

    def whirl(k, m, g):
        both = stiff * k + inert * m
        return jnp.stack([both + w * spin_speed * g, both - w * spin_speed * g], -1)

    lanes = Lanes(*map(whirl, places.stiffness, places.mass, places.polar))
    if places.axial is not None:
        bars = zip(*places.axial, strict=True)
        axial = Lanes(*((stiff * k + inert * m)[..., None] for k, m in bars))
        lanes = Lanes(*(jnp.concatenate(pair, -1) for pair in zip(lanes, axial, strict=True)))
    empty = jnp.asarray(layout.segment == layout.n)[..., None]
    one = jnp.eye(2)[:, :, None, None, None]
    return lanes._replace(diagonal=jnp.where(empty, one, lanes.diagonal))


def _sorted(layout: Layout, elements: Array, nodes: Array) -> Lanes:
    """Element and node blocks of one matrix in one plane, in their places (lanes axis absent)."""
    b, s, (m, c) = len(layout.border), layout.last.shape[1], layout.segment.shape
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
        return jnp.zeros((m, c, 2, 2)).at[first[at], second[at]].add(off[at]).transpose(2, 3, 0, 1)

    right = kind == RIGHT
    return Lanes(
        diagonal[layout.segment].transpose(2, 3, 0, 1) if m else jnp.zeros((2, 2, m, c)),
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
