r"""Exact elimination along the lines of nodes, and a small border solved in full.

In the whirl coordinates of `_conventions` a circular shaft uncouples into "whirl components": forward
(p), backward (q) and, with 6 degrees of freedom, axial-torsional. In each of them a node has two
coordinates, and a segment between two border nodes is a block tridiagonal matrix of symmetric
2 x 2 blocks, real unless the shaft itself is damped. Columns of segments, components and speeds are
eliminated side by side; only the place along the column is sequential:

    D_j' = D_j - N_j^T W_j,      W_j = D_{j-1}'^{-1} N_j,
    X_j  = E_j - W_j^T X_{j-1},                                 (coupling to the left border node)

with D the diagonal blocks and N_j = Z_{j-1,j}. What the segments leave on the border is solved in
`_border_nodes`.

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

from ._blocks import inverse, minus, product, product_t, times, times_t
from ._border_nodes import BorderFactor, factorise_border, solve_border
from ._conventions import add, take, to_components, to_planes_of_components, trailing
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
        border: factors of what the segments leave on the border.
    """

    segment: Array
    to_right: Array
    border: BorderFactor


def factorise(z: Operator) -> Factor:
    """Eliminate the segments and factorise the border; modal damping is not handled here."""
    layout = z.system.layout
    assert z.system.places is not None
    places = at_speed(layout, z.system.places, z.coefficients)
    segment, to_right, border = _eliminate(layout, places, _magnetic_pulls(layout, z))
    return Factor(segment, to_right, factorise_border(z, border))


def solve_factored(
    layout: Layout, factor: Factor, load: Complex[Array, "n p 2 *speeds"], *, transpose: bool
) -> Complex[Array, "n p 2 *speeds"]:
    """Z^{-1} f or Z^{-T} f from the factors, without refinement."""
    moving = trailing(jnp.asarray(layout.moving), load.ndim - 3)
    components = jnp.swapaxes(to_components(jnp.where(moving, load, 0.0), transpose), 1, 2)
    g = take(components, layout.border)
    m, c = layout.segment.shape
    b = len(layout.border)
    if not m:
        return _planes(layout, solve_border(layout, factor.border, g, transpose), load, transpose)
    components = jnp.concatenate([components, jnp.zeros_like(components[:1])])  # the dummy node
    r = jnp.moveaxis(take(components, layout.segment), 2, 1)  # (m, 2, c, components)
    r, on_left = _forward(layout, factor, r)
    near, far = layout.ends
    to_right = tuple(jnp.moveaxis(factor.to_right, 1, 0))
    on_right = jnp.stack(times_t(to_right, tuple(_at_ends(layout, r).swapaxes(0, 1))), 1)
    # A free end has the number behind the last border node, which `add` leaves out.
    on_border = jnp.concatenate([_at_ends(layout, on_left), on_right])
    g = add(g, np.concatenate([near, far]), -on_border)
    y = solve_border(layout, factor.border, g, transpose)
    x = _backward(layout, factor, r, y)
    # All nodes by one gather from border and segments.
    where = np.zeros(layout.n, int)
    where[layout.border] = np.arange(b)
    inside = layout.segment < layout.n
    where[layout.segment[inside]] = b + np.flatnonzero(inside)
    x = jnp.concatenate([y, jnp.moveaxis(x, 1, 2).reshape(m * c, *y.shape[1:])])
    return _planes(layout, take(x, where), load, transpose)


def _planes(layout: Layout, components: Array, load: Array, transpose: bool) -> Array:
    """From components to planes; coordinates that do not move take the load as it is."""
    x = to_planes_of_components(jnp.swapaxes(components, 1, 2), transpose)
    return jnp.where(trailing(jnp.asarray(layout.moving), x.ndim - 3), x, load)


def _at_ends(layout, x):
    """Values (m, k, c, components) at the last nodes of the segments, (s, k, components)."""
    m, k, c, *behind = x.shape
    rows = layout.last_nodes[0] * c + layout.last_nodes[1]
    return take(jnp.moveaxis(x, 1, 2).reshape(m * c, k, *behind), rows)


def _eliminate(layout, places, pulls):
    """Segments and their W of the right border node, and what is left on the border.

    Between two segments of a column N is zero, which starts the recursion afresh. `pulls` are rows
    and blocks that belong on the border as well.
    """
    b = len(layout.border)
    _, place = border_blocks(layout)
    loose = trailing(_held(layout), places.border.ndim - 3)
    if not layout.segment.size:
        border = add(places.border, place[pulls[0]], pulls[1])
        return places.segment, places.right, border + loose

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

    inside = _inside(layout, places.segment)
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
    border = add(places.border, rows, values) + loose
    return segment, jnp.stack(to_right, 1), border


def _inside(layout, x):
    """(m, c, ...) Zero where a segment begins, for values x (m, k, c, ...) at the nodes."""
    return trailing(jnp.asarray(~layout.opening, float), x.ndim - 3)


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
    speeds = k.ndim - 1
    components = np.zeros((4, layout.components))
    # entry (u, u) of a block, alike in p and q: a pull acts on displacements only
    components[0, :2] = 1.0
    blocks = jnp.concatenate([k, k, -k, -k])[:, None, None] * trailing(components, speeds)
    return np.concatenate(rows), blocks


def _forward(layout, factor, r):
    """Loads after the elimination, and their sum on the left border node of the segment."""

    def step(carry, row):
        before, on_left = carry
        load, blocks, inside = row
        load = jnp.stack(minus(load, times_t(blocks[_AHEAD], before)))
        on_left = inside * on_left + jnp.stack(times_t(blocks[_BACK], load))
        return (load, on_left), (load, on_left)

    inside = _inside(layout, r)
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
    motion = add(jnp.stack(motion, 2).reshape(m * c, *end.shape[1:]), rows, -end)
    motion = motion.reshape(m, c, *end.shape[1:])

    def step(carry, row):
        following, w_following = carry
        motion, w = row
        motion = jnp.stack(minus(motion, times(w_following, following)))
        return (motion, w), motion

    # W of an opening is zero as well, so that nothing leaks into the segment before it.
    start = jnp.zeros_like(r[0]), jnp.zeros_like(factor.segment[0, _AHEAD])
    rows_of_motion = jnp.moveaxis(motion, 2, 1), factor.segment[:, _AHEAD]
    return jax.lax.scan(step, start, rows_of_motion, reverse=True)[1]
