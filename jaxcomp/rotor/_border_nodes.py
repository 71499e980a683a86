"""The border of an elimination along lines of nodes, solved in full.

Coordinates of border nodes without links (slopes, mostly) are eliminated in the whirl components, while p
and q are still apart. What remains, joined by links and bodies, is solved in the planes by a dense
factorisation with pivoting.

Most border nodes are fixed to a rigid body and coupled to nothing else, or only where a magnetic pull
acts. What is zero by construction stays out of every product.
"""

from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from ._blocks import from_parts, in_parts, lu_factor, real_times_each
from ._conventions import add, take, to_components, to_planes_of_components, trailing
from ._inner import (
    DenseFactor,
    LevelFactor,
    Levels,
    factorise_inner,
    levels_of,
    load_inner,
    move_inner,
    solve_one,
    speeds_first,
)
from ._layout import BORDER, Layout
from ._operator import Operator
from ._places import border_blocks


class BorderFactor(NamedTuple):
    """Factors of a border at one speed, or at each of a list.

    Attributes:
        inner: those of the untouched border coordinates, per kind of component.
        lu: LU of the touched border coordinates, or of the independent ones among them; speeds first.
        motion: (touched, independent) touched border coordinates from the independent ones, or None for
            all.
        weight: (independent, *speeds) scaling of the border matrix.
    """

    inner: tuple[DenseFactor | LevelFactor, ...]
    lu: tuple
    motion: Array | None
    weight: Array


def factorise_border(z: Operator, border: Array) -> BorderFactor:
    """Factorise the blocks (r, 4, components, *speeds) that the segments leave on the border.

    Args:
        z: the dynamic stiffness, whose links and bodies act on the border.
        border: the blocks for the numbers of `border_blocks`.
    """
    layout = z.system.layout
    b = len(layout.border)
    _, place = border_blocks(layout)
    # A block of zeros behind the last one is what the empty places read.
    entries = jnp.concatenate([border, jnp.zeros_like(border[:1])]).reshape(-1, *border.shape[2:])
    inner = []
    reduced = []
    for kind in border_kinds(layout):
        # Untouched coordinates first: they are eliminated while p and q are still apart, in matrices of
        # half the size.
        order = np.concatenate([kind.free, kind.keep[: kind.coupled]])
        row = order[:, None]
        column = order
        # Blocks of the border are four numbers each, row by row.
        entry = 4 * place[row // 2 * b + column // 2] + row % 2 * 2 + column % 2
        a = take(entries, entry)[:, :, kind.components]
        f = len(kind.free)
        of_kind, by_inner = factorise_inner(kind.levels, a[:f, :f], a[:f, f : f + kind.near])
        inner.append(of_kind)
        beyond = (0, kind.coupled - kind.near)
        fill = [beyond, beyond] + [(0, 0)] * (a.ndim - 2)
        reduced.append(a[f:, f:] - jnp.pad(by_inner, fill))
    motion = None
    if layout.free.all():
        independent = jnp.eye(len(_touched_numbers(layout)))
        small = _in_planes(reduced)
    else:
        motion = independent = _border_motion(layout, z.system.arms)
        small = _condensed(layout, reduced, motion)
    speeds = small.ndim - 2
    held = _held_in_one_plane(layout)
    if held.any():
        small = small + trailing((independent.T * held) @ independent, speeds)
    small = small + _links_and_bodies(layout, z, independent)
    # A unit diagonal lets the pivoting compare displacements with rotations, mounts with films.
    size = jnp.abs(jnp.einsum("ii...->i...", small))
    weight = 1 / jnp.sqrt(jnp.where(size > 0, size, 1.0))
    lu = lu_factor(speeds_first(weight[:, None] * small * weight))
    return BorderFactor(tuple(inner), lu, motion, weight)


def solve_border(
    layout: Layout, factor: BorderFactor, g: Complex[Array, "b 2 l *speeds"], transpose: bool
) -> Complex[Array, "b 2 l *speeds"]:
    """Motion of the border nodes for the loads on them, in components."""
    flat = g.reshape(2 * len(g), *g.shape[2:])
    planes = []
    inside = []
    kinds = border_kinds(layout)
    for k, kind in enumerate(kinds):
        load = take(flat, np.concatenate([kind.free, kind.keep]))[:, kind.components]
        f = len(kind.free)
        # In the components all blocks are symmetric and stand for Z^T too; only the border, where
        # links and bodies join p and q, has to be transposed.
        loads, crossed = load_inner(factor.inner[k], kind.levels, load[:f])
        inside.append(loads)
        near = f + kind.near
        reduced = jnp.concatenate([load[f:near] - crossed, load[near:]])
        # Links and bodies act along x and y: what is left of the border is solved in the planes.
        if k == 0:
            reduced = to_planes_of_components(reduced, transpose)
        rows = len(kind.components) * len(kind.keep)
        planes.append(jnp.swapaxes(reduced, 0, 1).reshape(rows, *g.shape[3:]))
    rhs = jnp.concatenate(planes)
    if factor.motion is not None:
        rhs = real_times_each(factor.motion.T, rhs)
    y = factor.weight * solve_one(factor.lu, factor.weight * rhs, transpose)
    if factor.motion is not None:
        y = real_times_each(factor.motion, y)
    out = []
    used = 0
    for k, kind in enumerate(kinds):
        components = len(kind.components)
        size = components * len(kind.keep)
        touched = y[used : used + size].reshape(components, len(kind.keep), *g.shape[3:])
        touched = jnp.swapaxes(touched, 0, 1)
        used += size
        if k == 0:  # the lateral planes go back to the components p and q
            touched = to_components(touched, transpose)
        near = touched[: kind.near]
        untouched = move_inner(factor.inner[k], kind.levels, inside[k], near)
        # from "untouched first" back to node by node
        order = np.argsort(np.concatenate([kind.free, kind.keep]))
        out.append(take(jnp.concatenate([untouched, touched]), order))
    return jnp.concatenate(out, 1).reshape(g.shape)


def _held_in_one_plane(layout):
    """(touched,) The same for those of one lateral plane whose like in the other plane is acted on.

    The components p and q mix the two planes, so that this has to wait for the planes.
    """
    lateral, *axial = border_kinds(layout)
    loose = np.swapaxes(layout.loose[:, :2], 0, 1).reshape(2, -1)[:, lateral.keep]
    alone = (loose & ~loose.all(0)).reshape(-1)
    return np.append(alone, np.zeros(sum(len(kind.keep) for kind in axial))).astype(float)


class BorderKind(NamedTuple):
    """Border coordinates in whirl components of one kind, lateral or axial.

    Attributes:
        components: numbers of the components.
        free: the untouched coordinates, numbers in 2 b.
        keep: the touched ones, first those that the untouched ones are coupled to.
        near: how many of the touched ones these are.
        coupled: how many of them, from the first, have any entry; the others are moved by bodies alone.
        levels: of the untouched ones, see `levels_of`.
    """

    components: np.ndarray
    free: np.ndarray
    keep: np.ndarray
    near: int
    coupled: int
    levels: Levels


@lru_cache(maxsize=64)
def border_kinds(layout: Layout) -> tuple[BorderKind, ...]:
    """The kinds of components, of which a model of 4 degrees of freedom has one."""
    # p and q are both x and y: what a link touches in one plane it touches in both components.
    touched = [layout.touched[:, 0] | layout.touched[:, 1]]
    components = [np.array([0, 1])]
    if layout.dof == 6:
        touched.append(layout.touched[:, 2])
        components.append(np.array([2]))
    kinds = []
    for of_kind, of_coordinates in zip(components, touched, strict=True):
        flat = of_coordinates.reshape(-1)
        free = np.flatnonzero(~flat)
        keep = np.flatnonzero(flat)
        filled = _filled(layout, of_kind[0])
        near = filled[np.ix_(free, keep)].any(0)
        coupled = near | filled[np.ix_(keep, keep)].any(0)
        if layout.free.all():  # no motion of bodies brings the others back
            coupled = np.ones_like(near)
        # a stable order, so that neighbours stay together
        order = np.argsort(2 - near - coupled, kind="stable")
        kind = BorderKind(
            components=of_kind,
            free=free,
            keep=keep[order],
            near=int(near.sum()),
            coupled=int(coupled.sum()),
            levels=levels_of(filled[np.ix_(free, free)]),
        )
        kinds.append(kind)
    return tuple(kinds)


def _filled(layout, component) -> np.ndarray:
    """(2 b, 2 b) Entries of the border in a component that are not zero by construction."""
    b = len(layout.border)
    blocks: np.ndarray = np.zeros((b, 2, b, 2), bool)
    place = np.full(layout.n + 1, b)
    place[layout.border] = np.arange(b)
    *_, link_axes, _, disks, masses = layout.key
    with_matrices = place[np.array([*layout.pairs.reshape(-1), *disks, *masses], int)]
    at = layout.slots[:, 0] == BORDER
    joined = np.concatenate([layout.slots[at, 1:3], layout.ends.T])
    for first, second in [*joined, *zip(with_matrices, with_matrices, strict=True)]:
        ends = [end for end in (first, second) if end < b]
        blocks[np.ix_(ends, (0, 1), ends)] = True
    for nodes, axes, _ in link_axes:
        # a magnetic pull, the link without axes, acts on displacements of the lateral components only
        if not axes and component < 2:
            ends = [end for end in place[list(nodes)] if end < b]
            blocks[np.ix_(ends, (0,), ends, (0,))] = True
    loose = layout.loose[:, 2] if component == 2 else layout.loose[:, 0] & layout.loose[:, 1]
    return blocks.reshape(2 * b, 2 * b) | np.diag(loose.reshape(-1))


def _touched_numbers(layout):
    """Numbers (in n * dof, in the order of the planes) of the touched border coordinates.

    Their order: x plane, y plane, then axial and torsion.
    """
    kinds = border_kinds(layout)
    out = []
    for plane in range(layout.dof // 2):
        keep = kinds[0 if plane < 2 else 1].keep
        out.append(layout.border[keep // 2] * layout.dof + 2 * plane + keep % 2)
    return np.concatenate(out).astype(int)


def _border_motion(layout, arms):
    """Touched border coordinates from the independent ones among them."""
    numbers = _touched_numbers(layout)
    free = layout.moving.reshape(-1)[numbers]
    # independent coordinates stand for themselves; the arms fill the rows of those that follow
    fixed = jnp.asarray(np.diag(layout.free.reshape(-1)[numbers] * 1.0))
    return _scattered(layout, fixed, *layout.ties.nodes, arms)[:, free]


def _links_and_bodies(layout, z, independent):
    """Stiffness of links and bodies on the independent coordinates of the border."""
    count = len(z.system.model.links)
    numbers = _touched_numbers(layout)
    dof = layout.dof
    place = np.full((layout.n + 1) * dof, len(numbers))
    place[numbers] = np.arange(len(numbers))
    place = place.reshape(-1, dof)
    # The ground, and a coordinate that no link acts on, read a motion of zero.
    independent = jnp.concatenate([independent, jnp.zeros_like(independent[:1])])
    ends = take(independent, place[layout.links[:count]])  # (l, 2, dof, free)
    # Links resist relative motions, which are subtracted before anything else, and bodies their own.
    stretch = jnp.concatenate([ends[:, 0] - ends[:, 1], take(independent, place[layout.centres])])
    blocks = jnp.concatenate([z.links[:count], z.bodies])[:, :, :, None]
    speeds = blocks.ndim - 4
    push = from_parts(jnp.sum(in_parts(blocks) * trailing(stretch[:, None], speeds), 3))
    rows = len(blocks) * dof  # push (l, dof, free, *speeds)
    columns = stretch.reshape(rows, stretch.shape[-1])
    return real_times_each(columns.T, push.reshape(rows, *push.shape[2:]))


def _scattered(layout, matrix, rows, columns, blocks):
    """A matrix over the touched border coordinates with blocks (., dof, dof) of nodes added to it."""
    dof = layout.dof
    size = len(matrix)
    place = np.full((layout.n + 1) * dof, -1)
    place[_touched_numbers(layout)] = np.arange(size)
    rows = place[rows[:, None] * dof + np.arange(dof)][:, :, None]
    columns = place[columns[:, None] * dof + np.arange(dof)][:, None, :]
    # Ground and untouched coordinates have no place: behind the matrix, where `add` leaves them out.
    at = np.where((rows < 0) | (columns < 0), size**2, rows * size + columns)
    return add(matrix.reshape(-1), at, blocks).reshape(size, size)


def _condensed(layout, reduced, motion):
    """A border in components on the coordinates that move it, see `_in_planes` for the planes.

    The whole border in planes is never formed: the components are multiplied by the motions of the
    planes, which are alike at all speeds, and only what comes of that is brought to planes.
    """
    kinds = border_kinds(layout)
    free = motion.shape[1]
    rows = []
    first = 0
    for plane in range(layout.dof // 2):
        kind = kinds[0 if plane < 2 else 1]
        rows.append(motion[first : first + kind.coupled])
        first += len(kind.keep)
    lateral = jnp.concatenate(rows[:2], 1)
    whirl = jnp.swapaxes(real_times_each(lateral.T, reduced[0]), 0, 1)  # (k, 2 free, 2, *speeds)
    mean = (whirl[:, :, 0] + whirl[:, :, 1]) / 2
    half = 0.5j * (whirl[:, :, 0] - whirl[:, :, 1])
    along = [mean[:, :free] + half[:, free:], mean[:, free:] - half[:, :free]]
    if len(reduced) > 1:
        axial = real_times_each(rows[2].T, reduced[1][:, :, 0])
        along.append(jnp.swapaxes(axial, 0, 1).astype(half.dtype))
    return real_times_each(jnp.concatenate(rows).T, jnp.concatenate(along))


def _in_planes(reduced):
    """From components to planes: S_xx = S_yy = (S_p + S_q)/2, S_xy = -S_yx = i (S_p - S_q)/2."""
    p = reduced[0][:, :, 0]
    q = reduced[0][:, :, 1]
    mean = (p + q) / 2
    half = 0.5j * (p - q)
    of_planes = [[mean, half], [-half, mean]]
    out = jnp.concatenate([jnp.concatenate(row, 1) for row in of_planes])
    if len(reduced) == 1:
        return out
    # axial and torsional motion has no planes: it keeps a block of its own
    axial = reduced[1][:, :, 0]
    behind = [(0, 0)] * (out.ndim - 2)
    after = (0, len(axial))
    before = (len(out), 0)
    return jnp.pad(out, [after, after, *behind]) + jnp.pad(axial, [before, before, *behind])
