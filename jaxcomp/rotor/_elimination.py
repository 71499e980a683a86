r"""Exact elimination along the lines of nodes, and a small border solved in full.

In the whirl coordinates of `_conventions` a circular shaft uncouples into "whirl components": forward
(p), backward (q) and, with 6 degrees of freedom, axial-torsional. In each of them a node has two
coordinates, and a segment between two border nodes is a block tridiagonal matrix of symmetric
2 x 2 blocks, real unless the shaft itself is damped. Columns of segments, components and speeds are
eliminated side by side; only the place along the column is sequential:

    D_j' = D_j - N_j^T W_j,      W_j = D_{j-1}'^{-1} N_j,
    X_j  = E_j - W_j^T X_{j-1},                                 (coupling to the left border node)

with D the diagonal blocks and N_j = Z_{j-1,j}. The border keeps what the segments leave on it. Its
coordinates without links (slopes, mostly) are eliminated in the components too, and what remains, joined
by links and bodies, is solved by a dense factorisation with pivoting.

Z^T has the components p and q exchanged, because its gyroscopic part changes sign.

Blocks are kept by components, (a, b, c, d) for [[a, b], [c, d]], (a, b, d) for a symmetric one and
(u, v) for a vector, so that every line of algebra is elementwise over segments, components and speeds:
this is what XLA turns into vector instructions, where small matrix products become one library call
each.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from ._blocks import (
    inverse,
    lu_factor,
    lu_solve,
    minus,
    product,
    product_t,
    real_times,
    times,
    times_real,
    times_t,
)
from ._conventions import add, take, to_components, to_planes_of_components
from ._layout import Layout
from ._operator import Operator
from ._places import TURNED, at_speed, border_blocks

# of a segment's blocks
_DIAGONAL = slice(0, 3)
_NEXT = slice(3, 7)
_LEFT = slice(7, 11)
_PIVOT = slice(0, 3)
_AHEAD = slice(3, 7)
_BACK = slice(7, 11)
_ON_LEFT = slice(11, 14)


class Factor(NamedTuple):
    """Factors that the elimination of a model at one speed leaves.

    Attributes:
        segment: (m, 14, c, components) D^{-1}, W, Y = D^{-1} X, and X^T Y summed up on the left border.
        to_right: (s, 4, components) W of the right border node.
        inner: LU of the untouched border coordinates, per kind of component.
        cross: their coupling to the touched ones, per kind of component.
        reach: their response to the touched ones, per kind of component.
        border: LU of the touched border coordinates.
        motion: (touched, free) touched border coordinates from the independent ones, or None for all.
        weight: (free,) scaling of the border matrix.
    """

    segment: Array
    to_right: Array
    inner: tuple
    cross: tuple
    reach: tuple
    border: tuple
    motion: Array | None
    weight: Array


def factorise(z: Operator) -> Factor:
    """Eliminate the segments and factorise the border; modal damping is not handled here."""
    layout = z.system.layout
    b = len(z.system.layout.border)
    assert z.system.places is not None
    places = at_speed(layout, z.system.places, z.coefficients)
    segment, to_right, border = _eliminate(layout, places, _magnetic_pulls(layout, z))
    _, place = border_blocks(layout)
    # A block of zeros behind the last one is what the empty places read.
    entries = jnp.concatenate([border, jnp.zeros_like(border[:1])]).reshape(-1, border.shape[-1])
    inner = []
    cross = []
    reach = []
    reduced = []
    for component, (free, keep) in _kinds(layout):
        # Untouched coordinates first: they are eliminated while p and q are still apart, in matrices of
        # half the size.
        order = np.concatenate([free, keep])
        f = len(free)
        row = order[:, None]
        column = order
        # Blocks of the border are four numbers each, row by row.
        entry = 4 * place[row // 2 * b + column // 2] + row % 2 * 2 + column % 2
        a = jnp.moveaxis(take(entries, entry)[..., component], -1, 0)
        lu = lu_factor(a[:, :f, :f])
        coupling = a[:, :f, f:]
        response = lu_solve(lu, coupling)
        inner.append(lu)
        cross.append(coupling)
        reach.append(response)
        reduced.append(a[:, f:, f:] - jnp.swapaxes(coupling, -1, -2) @ response)
    motion = None
    if layout.free.all():
        independent = jnp.eye(len(_touched_numbers(layout)))
        small = _in_planes(reduced)
    else:
        motion = independent = _border_motion(layout, z.system.arms)
        small = _condensed(reduced, motion)
    held = _held_in_one_plane(layout)
    if held.any():
        small = small + (independent.T * held) @ independent
    small = small + _links_and_bodies(layout, z, independent)
    # A unit diagonal lets the pivoting compare displacements with rotations, mounts with films.
    size = jnp.abs(jnp.diagonal(small))
    weight = 1 / jnp.sqrt(jnp.where(size > 0, size, 1.0))
    lu = lu_factor(weight[:, None] * small * weight)
    return Factor(segment, to_right, tuple(inner), tuple(cross), tuple(reach), lu, motion, weight)


def solve_factored(
    layout: Layout, factor: Factor, load: Complex[Array, "n p 2"], *, transpose: bool
) -> Complex[Array, "n p 2"]:
    """Z^{-1} f or Z^{-T} f from the factors, without refinement."""
    moving = jnp.asarray(layout.moving)
    components = jnp.swapaxes(to_components(jnp.where(moving, load, 0.0), transpose), 1, 2)
    g = take(components, layout.border)
    m, c = layout.segment.shape
    b = len(layout.border)
    if not m:
        return _planes(layout, _solve_border(layout, factor, g, transpose), load, transpose)
    components = jnp.concatenate([components, jnp.zeros_like(components[:1])])  # the dummy node
    r = jnp.moveaxis(take(components, layout.segment), 2, 1)  # (m, 2, c, components)
    r, on_left = _forward(layout, factor, r)
    near, far = layout.ends
    to_right = tuple(jnp.moveaxis(factor.to_right, 1, 0))
    on_right = jnp.stack(times_t(to_right, tuple(_at_ends(layout, r).swapaxes(0, 1))), 1)
    # A free end has the number behind the last border node, which `add` leaves out.
    on_border = jnp.concatenate([_at_ends(layout, on_left), on_right])
    g = add(g, np.concatenate([near, far]), -on_border)
    y = _solve_border(layout, factor, g, transpose)
    x = _backward(layout, factor, r, y)
    # All nodes by one gather from border and segments.
    where = np.zeros(layout.n, int)
    where[layout.border] = np.arange(b)
    inside = layout.segment < layout.n
    where[layout.segment[inside]] = b + np.flatnonzero(inside)
    x = jnp.concatenate([y, jnp.moveaxis(x, 1, 2).reshape(m * c, 2, -1)])
    return _planes(layout, take(x, where), load, transpose)


def _planes(layout: Layout, components: Array, load: Array, transpose: bool) -> Array:
    """From components to planes; coordinates that do not move take the load as it is."""
    x = to_planes_of_components(jnp.swapaxes(components, 1, 2), transpose)
    return jnp.where(jnp.asarray(layout.moving), x, load)


def _at_ends(layout, x):
    """Values (m, k, c, components) at the last nodes of the segments, (s, k, components)."""
    m, k, c, components = x.shape
    rows = layout.last_nodes[0] * c + layout.last_nodes[1]
    return take(jnp.moveaxis(x, 1, 2).reshape(m * c, k, components), rows)


def _eliminate(layout, places, pulls):
    """Segments and their W of the right border node, and what is left on the border.

    Between two segments of a column N is zero, which starts the recursion afresh. `pulls` are rows
    and blocks that belong on the border as well.
    """
    b = len(layout.border)
    _, place = border_blocks(layout)
    if not layout.segment.size:
        border = add(places.border, place[pulls[0]], pulls[1])
        return places.segment, places.right, border + _held(layout)

    def step(carry, row):
        pivot, fill, on_border = carry
        blocks, inside = row
        a, bb, d = blocks[_DIAGONAL]
        n, e = blocks[_NEXT], blocks[_LEFT]
        w = product(pivot, n)
        q = product_t(n, w)
        # Pivots of 2 x 2 blocks without exchanges of rows, which would widen the band; what digits
        # that costs the refinement in `_solve` brings back.
        pivot = inverse((a - q[0], bb - q[1], d - q[3]))
        fill = minus(e, product_t(w, fill))
        back = product(pivot, fill)
        on_left = product_t(fill, back)
        # The only sum that N = 0 at an opening does not start afresh.
        a, b, _, d = on_left
        sums = zip(on_border, (a, b, d), strict=True)
        on_border = tuple(inside * total + entry for total, entry in sums)
        return (pivot, fill, on_border), jnp.stack([*pivot, *w, *back, *on_border])

    inside = jnp.asarray(~layout.opening, float)[..., None]
    zero = jnp.zeros_like(places.segment[0, 0])
    # Any finite pivot will do, since the first node has N = 0.
    start = ((zero + 1, zero, zero + 1), (zero,) * 4, (zero,) * 3)
    segment = jax.lax.scan(step, start, (places.segment, inside))[1]
    ends = _at_ends(layout, segment).swapaxes(0, 1)
    right = places.right.swapaxes(0, 1)
    near, far = layout.ends
    # the last node of a segment is eliminated as all others, its neighbour being on the border
    to_right = product(ends[_PIVOT], right)
    on_near = ends[_ON_LEFT][np.array([0, 1, 1, 2])]
    on_far = jnp.stack(product_t(right, to_right))
    between = jnp.stack(product_t(right, ends[_BACK]))  # rows far, columns near
    joined = (near < b) & (far < b)
    # Row b * b does not exist, so that `add` leaves out what would act on a free end.
    rows = [
        np.where(near < b, near * (b + 1), b * b),
        np.where(far < b, far * (b + 1), b * b),
        np.where(joined, far * b + near, b * b),
        np.where(joined, near * b + far, b * b),
    ]
    values = jnp.concatenate([on_near, on_far, between, between[TURNED]], 1).swapaxes(0, 1)
    rows = place[np.concatenate([*rows, pulls[0]])]
    values = jnp.concatenate([-values, pulls[1]])
    border = add(places.border, rows, values) + _held(layout)
    return segment, jnp.stack(to_right, 1), border


def _held(layout):
    """(r, 4, components) A stiffness of one for the coordinates that nothing acts on."""
    b = len(layout.border)
    out = np.zeros((b, b, 4, layout.components))
    at = np.arange(b)
    for k in (0, 1):
        # Entries 0 and 3 of a block are its diagonal. In p and q a coordinate is loose if it is so in
        # both planes, of which each of them is a mixture.
        out[at, at, 3 * k, :2] = (layout.loose[:, 0, k] & layout.loose[:, 1, k])[:, None]
        if layout.dof == 6:
            out[at, at, 3 * k, 2] = layout.loose[:, 2, k]
    numbers, _ = border_blocks(layout)
    return out.reshape(b * b, 4, -1)[numbers]


def _held_in_one_plane(layout):
    """(touched,) The same for those of one lateral plane whose like in the other plane is acted on.

    The components p and q mix the two planes, so that this has to wait for the planes.
    """
    (_, (_, keep)), *axial = _kinds(layout)
    loose = np.swapaxes(layout.loose[:, :2], 0, 1).reshape(2, -1)[:, keep]
    alone = (loose & ~loose.all(0)).reshape(-1)
    return np.append(alone, np.zeros(sum(len(touched) for _, (_, touched) in axial))).astype(float)


def _magnetic_pulls(layout, z):
    """Border rows and blocks of the magnetic pulls, which are isotropic and stay within components."""
    b = len(layout.border)
    count = len(z.system.model.links)
    place = np.full(layout.n + 1, -1)
    place[layout.border] = np.arange(b)
    i, j = place[layout.links[count:]].T
    to_ground = (i < 0) | (j < 0)
    rows = [
        np.where(i < 0, b * b, i * (b + 1)),
        np.where(j < 0, b * b, j * (b + 1)),
        np.where(to_ground, b * b, i * b + j),
        np.where(to_ground, b * b, j * b + i),
    ]
    k = z.stiffness[count:, 0, 0]
    components = np.zeros((4, layout.components))
    # entry (u, u) of a block, alike in p and q: a pull acts on displacements only
    components[0, :2] = 1.0
    return np.concatenate(rows), jnp.concatenate([k, k, -k, -k])[:, None, None] * components


def _forward(layout, factor, r):
    """Loads after the elimination, and their sum on the left border node of the segment."""

    def step(carry, row):
        before, on_left = carry
        load, blocks, inside = row
        load = jnp.stack(minus(load, times_t(blocks[_AHEAD], before)))
        on_left = inside * on_left + jnp.stack(times_t(blocks[_BACK], load))
        return (load, on_left), (load, on_left)

    inside = jnp.asarray(~layout.opening, float)[..., None]
    zero = jnp.zeros_like(r[0])
    return jax.lax.scan(step, (zero, zero), (r, factor.segment, inside))[1]


def _backward(layout, factor, r, y):
    m, c = layout.segment.shape
    # A free end has the number behind the last border node, where it reads a motion of zero.
    ground = jnp.concatenate([y, jnp.zeros_like(y[:1])])
    near = jnp.moveaxis(take(ground, layout.left_of), 2, 0)  # (2, m, c, components)
    far = take(ground, layout.ends[1]).swapaxes(0, 1)
    blocks = jnp.moveaxis(factor.segment, 1, 0)
    a, b, d = blocks[_PIVOT]
    # x_j = D_j'^{-1} r_j - Y_j x_left - W_{j+1} x_{j+1}: the first two need no recursion, and are
    # taken for all nodes at once.
    motion = minus(times((a, b, b, d), jnp.moveaxis(r, 1, 0)), times(blocks[_BACK], near))
    end = jnp.stack(times(factor.to_right.swapaxes(0, 1), far), 1)  # (s, 2, components)
    rows = layout.last_nodes[0] * c + layout.last_nodes[1]
    motion = add(jnp.stack(motion, 2).reshape(m * c, 2, -1), rows, -end)
    motion = motion.reshape(m, c, 2, -1)

    def step(carry, row):
        following, w_following = carry
        motion, w = row
        motion = jnp.stack(minus(motion, times(w_following, following)))
        return (motion, w), motion

    # W of an opening is zero as well, so that nothing leaks into the segment before it.
    start = jnp.zeros_like(r[0]), jnp.zeros_like(factor.segment[0, _AHEAD])
    rows_of_motion = jnp.moveaxis(motion, 2, 1), factor.segment[:, _AHEAD]
    return jax.lax.scan(step, start, rows_of_motion, reverse=True)[1]


def _solve_border(layout, factor, g, transpose):
    """Motion (b, 2, components) of the border nodes."""
    b = len(layout.border)
    flat = jnp.moveaxis(g.reshape(2 * b, -1), -1, 0)  # (components, 2 b)
    reduced = []
    inside = []
    kinds = _kinds(layout)
    for k, (component, (free, keep)) in enumerate(kinds):
        load = take(flat[component].T, np.concatenate([free, keep])).T
        # In the components all blocks are symmetric and stand for Z^T too; only the border, where
        # links and bodies join p and q, has to be transposed.
        x = lu_solve(factor.inner[k], load[:, : len(free), None])[..., 0]
        crossed = real_times(jnp.swapaxes(factor.cross[k], 1, 2), x[..., None])[..., 0]
        reduced.append(load[:, len(free) :] - crossed)
        inside.append(x)
    # Links and bodies act along x and y: the rest of the border is solved in the planes.
    planes = [to_planes_of_components(reduced[0][None], transpose)[0], *reduced[1:]]
    rhs = jnp.concatenate([p.reshape(-1) for p in planes])
    if factor.motion is not None:
        rhs = real_times(factor.motion.T, rhs[:, None])[:, 0]
    y = lu_solve(factor.border, (factor.weight * rhs)[:, None], transpose)[:, 0]
    y = factor.weight * y
    if factor.motion is not None:
        y = real_times(factor.motion, y[:, None])[:, 0]
    out = []
    used = 0
    for k, (component, (free, keep)) in enumerate(kinds):
        touched = y[used : used + len(component) * len(keep)].reshape(len(component), -1)
        used += touched.size
        if k == 0:  # the lateral planes go back to the components p and q
            touched = to_components(touched[None], transpose)[0]
        untouched = inside[k] - real_times(factor.reach[k], touched[..., None])[..., 0]
        # from "untouched first" back to node by node
        order = np.argsort(np.concatenate([free, keep]))
        out.append(take(jnp.concatenate([untouched, touched], 1).T, order))
    return jnp.concatenate(out, 1).reshape(b, 2, -1)


def _kinds(layout):
    """Components of one kind (whirl, axial), with their untouched and touched border coordinates."""
    # p and q are both x and y: what a link touches in one plane it touches in both components.
    lateral = layout.touched[:, 0] | layout.touched[:, 1]
    kinds = [(np.array([0, 1]), _split(lateral))]
    if layout.dof == 6:
        kinds.append((np.array([2]), _split(layout.touched[:, 2])))
    return kinds


def _split(touched):
    """Numbers of the untouched coordinates (nodes, 2) and of the touched ones."""
    flat = touched.reshape(-1)
    return np.flatnonzero(~flat), np.flatnonzero(flat)


def _touched_numbers(layout):
    """Numbers (in n * dof, in the order of the planes) of the touched border coordinates.

    Their order: x plane, y plane, then axial and torsion.
    """
    choices = [keep for _, (_, keep) in _kinds(layout)]
    out = []
    for plane in range(layout.dof // 2):
        keep = choices[0 if plane < 2 else 1]
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
    blocks = jnp.concatenate([z.links[:count], z.bodies])
    push = times_real(blocks, stretch)
    rows = len(blocks) * dof
    return times_real(push.reshape(rows, -1).T, stretch.reshape(rows, -1)).T


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


def _condensed(reduced, motion):
    """A border in components on the coordinates that move it, see `_in_planes` for the planes.

    The whole border in planes is never formed: the components are multiplied by the motions of the
    planes, which are alike at all speeds, and only what comes of that is brought to planes.
    """
    k = reduced[0].shape[-1]
    free = motion.shape[1]
    lateral = jnp.concatenate([motion[:k], motion[k : 2 * k]], 1)
    p, q = times_real(reduced[0], lateral)  # (k, 2 free) each
    mean = (p + q) / 2
    half = 0.5j * (p - q)
    along = [mean[:, :free] + half[:, free:], mean[:, free:] - half[:, :free]]
    if len(reduced) > 1:
        along.append(times_real(reduced[1][0], motion[2 * k :]))
    return times_real(jnp.concatenate(along).T, motion).T


def _in_planes(reduced):
    """From components to planes: S_xx = S_yy = (S_p + S_q)/2, S_xy = -S_yx = i (S_p - S_q)/2."""
    p, q = reduced[0]
    mean = (p + q) / 2
    half = 0.5j * (p - q)
    out = jnp.block([[mean, half], [-half, mean]])
    if len(reduced) == 1:
        return out
    # axial and torsional motion has no planes: it keeps a block of its own
    return jax.scipy.linalg.block_diag(out, reduced[1][0])
