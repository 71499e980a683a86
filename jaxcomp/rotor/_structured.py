r"""Exact elimination along the lines of nodes, and a small border solved in full.

In the whirl coordinates of `_conventions` a circular shaft uncouples into "lanes": forward (p),
backward (q) and, with 6 degrees of freedom, axial-torsional. In each of them a node has two
coordinates, and a segment between two border nodes is a block tridiagonal matrix of symmetric
2 x 2 blocks, real unless the shaft itself is damped. Columns of segments, lanes and speeds are
eliminated side by side; only the place along the column is sequential:

    D_j' = D_j - N_j^T W_j,      W_j = D_{j-1}'^{-1} N_j,
    X_j  = E_j - W_j^T X_{j-1},                                 (coupling to the left border node)

with D the diagonal blocks and N_j = Z_{j-1,j}. The border keeps what the segments leave on it. Its
coordinates without links (slopes, mostly) are eliminated in the lanes too, and what remains, joined
by links and bodies, is solved by a dense factorisation with pivoting.

Z^T has the lanes p and q exchanged, because its gyroscopic part changes sign.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from ._border import (
    add_side_pulls,
    border_choices,
    border_motion,
    close_segments,
    hold_loose,
    lane_kinds,
    lane_vector,
    links_and_bodies,
    unlane,
    unlane_vector,
)
from ._conventions import to_planes
from ._lanes import Lanes, from_lanes, lanes_of, to_lanes
from ._layout import Layout
from ._system import Operator
from ._two_by_two import inverse, of_block, product, product_t, times, times_t


class Factor(NamedTuple):
    """What the elimination of a model at one speed leaves.

    Attributes:
        pivot: D^{-1} of the interior nodes, components (m, c, lanes).
        ahead: W of the interior nodes.
        back: Y = D^{-1} X, response of the interior nodes to the left border node.
        last: W of the right border node, (s, lanes).
        inner: LU of the untouched border coordinates, per kind of lane.
        cross: their coupling to the touched ones, per kind of lane.
        reach: their response to the touched ones, per kind of lane.
        border: LU of the touched border coordinates.
        motion: (touched, free) touched border coordinates from the independent ones.
        weight: (free,) scaling of the border matrix.
    """

    pivot: tuple
    ahead: tuple
    back: tuple
    last: tuple
    inner: tuple
    cross: tuple
    reach: tuple
    border: tuple
    motion: Array
    weight: Array


def factorise(z: Operator) -> Factor:
    """Eliminate the segments and factorise the border; modal damping is not handled here."""
    layout, structure = z.system.layout, z.system.structure
    lanes = lanes_of(layout, z.system.places, structure.damping, z.frequency, z.spin_speed)
    pivot, ahead, fill, left = _eliminate(layout, lanes)
    back = product(pivot, fill)
    right = of_block(lanes.right)
    if layout.segment.size:
        at_end = lambda t: tuple(c[*layout.last] for c in t)  # noqa: E731
        last = product(at_end(pivot), right)
        border = close_segments(layout, lanes.border, at_end(left), right, last, at_end(fill))
    else:
        last, border = right, lanes.border
    border = hold_loose(layout, add_side_pulls(layout, z, border))

    inner, cross, reach, kept = [], [], [], []
    for lane, (free, keep) in zip(lane_kinds(layout), border_choices(layout), strict=True):
        a = jnp.moveaxis(border[..., lane], -1, 0)  # (lanes of this kind, 2 b, 2 b)
        lu = jax.scipy.linalg.lu_factor(a[:, free[:, None], free])
        coupling = a[:, free[:, None], keep]
        response = jax.vmap(jax.scipy.linalg.lu_solve)(lu, coupling) if free.size else coupling
        inner.append(lu)
        cross.append(coupling)
        reach.append(response)
        kept.append(a[:, keep[:, None], keep] - jnp.swapaxes(coupling, -1, -2) @ response)
    full = unlane(kept) + links_and_bodies(layout, z)
    motion = border_motion(layout, z)
    small = motion.T @ full @ motion
    size = jnp.abs(jnp.diagonal(small))
    weight = 1 / jnp.sqrt(jnp.where(size > 0, size, 1.0))
    lu = jax.scipy.linalg.lu_factor(weight[:, None] * small * weight)
    return Factor(
        pivot, ahead, back, last, tuple(inner), tuple(cross), tuple(reach), lu, motion, weight
    )


def solve_factored(
    layout: Layout, factor: Factor, load: Complex[Array, "n dof"], *, transpose: bool
) -> Complex[Array, "n dof"]:
    """Z^{-1} f or Z^{-T} f from the factors, without refinement."""
    if transpose:
        factor = _swapped(factor)
    active = jnp.asarray(layout.active)
    plane = to_planes(jnp.where(active, load, 0.0), layout.dof)
    lanes = jnp.concatenate([to_lanes(plane), jnp.zeros_like(plane[:1])])  # dummy node at the end
    g = jnp.moveaxis(lanes[layout.border], 1, -1)  # (b, 2, lanes)
    if layout.segment.size:
        r = lanes[layout.segment]  # (m, c, lanes, 2)
        r, to_left = _forward(layout, factor, (r[..., 0], r[..., 1]))
        g = _onto_border(layout, factor, g, r, to_left)
    y = _solve_border(layout, factor, g, 1 if transpose else 0)
    out = lanes.at[layout.border].set(jnp.moveaxis(y, -1, 1))
    if layout.segment.size:
        x = _backward(layout, factor, r, y)
        out = out.at[layout.segment].set(jnp.stack(x, -1), mode="drop")
    x = from_lanes(out[:-1], layout.dof)
    return jnp.where(active, x, load)


def _eliminate(layout, lanes: Lanes):
    """Pivots, W, X, and what the segments up to here leave on their left border nodes.

    Between two segments of a column N is zero, which starts the recursion afresh.
    """

    def step(carry, here):
        pivot, fill, left = carry
        (a, b, _, d), n, e, inside = here
        w = product(pivot, n)
        q = product_t(n, w)
        pivot = inverse((a - q[0], b - q[1], d - q[3]))
        fill = _minus(e, product_t(w, fill))
        own = product_t(fill, product(pivot, fill))
        left = tuple(inside * past + new for past, new in zip(left, own, strict=True))
        return (pivot, fill, left), (pivot, w, fill, left)

    inside = jnp.asarray(~layout.opening, float)[..., None]
    xs = (*(of_block(x) for x in (lanes.diagonal, lanes.next, lanes.left)), inside)
    zero = jnp.zeros(lanes.diagonal.shape[3:], lanes.diagonal.dtype)
    start = ((zero + 1, zero, zero + 1), (zero,) * 4, (zero,) * 4)
    return jax.lax.scan(step, start, xs)[1]


def _forward(layout, factor, r):
    """Loads after the elimination, and their sum on the left border node of the segment."""

    def step(carry, here):
        before, left = carry
        now, w, y, inside = here
        now = _minus(now, times_t(w, before))
        left = tuple(inside * a + b for a, b in zip(left, times_t(y, now), strict=True))
        return (now, left), (now, left)

    inside = jnp.asarray(~layout.opening, float)[..., None]
    zero = (jnp.zeros_like(r[0][0]),) * 2
    return jax.lax.scan(step, (zero, zero), (r, factor.ahead, factor.back, inside))[1]


def _onto_border(layout, factor, g, r, to_left):
    (left, far), at_end = layout.ends, lambda t: tuple(c[*layout.last] for c in t)
    g = g.at[left].add(-jnp.stack(at_end(to_left), 1), mode="drop")
    return g.at[far].add(-jnp.stack(times_t(factor.last, at_end(r)), 1), mode="drop")


def _backward(layout, factor, r, y):
    ground = jnp.concatenate([y, jnp.zeros_like(y[:1])])
    left, far = (jnp.moveaxis(ground[e], -2, 0) for e in (layout.left_of, layout.ends[1]))
    own = times((factor.pivot[0], factor.pivot[1], factor.pivot[1], factor.pivot[2]), r)
    c = _minus(own, times(factor.back, tuple(left)))
    end = times(factor.last, tuple(far))
    c = tuple(a.at[*layout.last].add(-b) for a, b in zip(c, end, strict=True))

    def step(carry, here):
        following, w_following = carry
        now, w = here
        now = _minus(now, times(w_following, following))
        return (now, w), now

    zero = jnp.zeros_like(c[0][0])
    start = ((zero, zero), tuple(jnp.zeros_like(w[0]) for w in factor.ahead))
    return jax.lax.scan(step, start, (c, factor.ahead), reverse=True)[1]


def _minus(a, b):
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _solve_border(layout, factor, g, trans):
    b, keep_free = len(layout.border), border_choices(layout)
    flat = jnp.moveaxis(g.reshape(2 * b, -1), -1, 0)  # (lanes, 2 b)
    kept, inside = [], []
    for k, (lane, (free, keep)) in enumerate(zip(lane_kinds(layout), keep_free, strict=True)):
        x = _lu_solve(factor.inner[k], flat[lane][:, free])
        kept.append(flat[lane][:, keep] - jnp.einsum("afk,af->ak", factor.cross[k], x))
        inside.append(x)
    rhs = factor.weight * (factor.motion.T @ unlane_vector(kept))
    y = factor.motion @ (factor.weight * jax.scipy.linalg.lu_solve(factor.border, rhs, trans=trans))
    sizes = [len(keep) for _, keep in keep_free]
    out = jnp.zeros_like(flat)
    for k, (lane, (free, keep)) in enumerate(zip(lane_kinds(layout), keep_free, strict=True)):
        own = lane_vector(y, sizes, k)
        rest = inside[k] - jnp.einsum("afk,ak->af", factor.reach[k], own)
        out = out.at[lane[:, None], keep].set(own).at[lane[:, None], free].set(rest)
    return jnp.moveaxis(out, 0, -1).reshape(b, 2, -1)


def _swapped(factor: Factor) -> Factor:
    """The factors of Z^T, but for the border's own LU."""
    count = factor.ahead[0].shape[-1]
    order = np.array([1, 0, 2])[:count]
    lanes = lambda t: jax.tree.map(lambda c: c[..., order], t)  # noqa: E731
    flip = lambda t: (jax.tree.map(lambda c: c[::-1], t[0]), *t[1:])  # noqa: E731
    return factor._replace(
        pivot=lanes(factor.pivot),
        ahead=lanes(factor.ahead),
        back=lanes(factor.back),
        last=lanes(factor.last),
        inner=flip(factor.inner),
        cross=flip(factor.cross),
        reach=flip(factor.reach),
    )


def _lu_solve(lu, b):
    """A real factorisation applied to complex right-hand sides, one a lane."""
    if not b.shape[-1]:
        return b
    if jnp.iscomplexobj(lu[0]):
        return jax.vmap(jax.scipy.linalg.lu_solve)(lu, b)
    parts = jax.vmap(jax.scipy.linalg.lu_solve)(lu, jnp.stack([b.real, b.imag], -1))
    return parts[..., 0] + 1j * parts[..., 1]
