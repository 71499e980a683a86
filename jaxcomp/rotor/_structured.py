r"""Exact elimination along the lines of nodes, and a small border solved in full.

In the whirl coordinates of `_conventions` a circular shaft uncouples into "lanes": forward (p),
backward (q) and, with 6 degrees of freedom, axial-torsional. In each of them a node has two
coordinates, and a segment between two border nodes is a block tridiagonal matrix of symmetric
2 x 2 blocks, real unless the shaft itself is damped. Segments, lanes and speeds are eliminated side
by side; only the place along the segment is sequential:

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

from ._assembly import from_planes, to_planes
from ._conventions import plane_numbers
from ._layout import BORDER, LEFT, NEXT, RIGHT, Layout, layout_of
from ._model import RotorModel
from ._operator import Operator
from ._shaft import deformation
from ._two_by_two import inverse, of_block, product, product_t, times, times_t


class Factor(NamedTuple):
    """What the elimination of a model at one speed leaves.

    Attributes:
        pivot: D^{-1} of the interior nodes, components (m, s, lanes).
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


class _Lanes(NamedTuple):
    diagonal: Array  # (2, 2, m, s, lanes)
    next: Array  # (2, 2, m, s, lanes), Z_{j-1,j}
    left: Array  # (2, 2, m, s, lanes), towards the left border node
    right: Array  # (2, 2, s, lanes), from the last node towards the right border node
    border: Array  # (2 b, 2 b, lanes)


def factorise(model: RotorModel, z: Operator) -> Factor:
    """Eliminate the segments and factorise the border; modal damping is not handled here."""
    layout = layout_of(model)
    lanes = _lanes(layout, z)
    pivot, ahead, fill = _eliminate(lanes)
    back = product(pivot, fill)
    right = of_block(lanes.right)
    if layout.segment.size:
        end, end_fill = (tuple(c[-1] for c in t) for t in (pivot, fill))
        last = product(end, right)
        border = _close(layout, lanes.border, fill, back, right, last, end_fill)
    else:
        last, border = right, lanes.border

    inner, cross, reach, kept = [], [], [], []
    for lane, (free, keep) in zip(_groups(layout), _choices(layout), strict=True):
        a = jnp.moveaxis(border[..., lane], -1, 0)  # (lanes of this kind, 2 b, 2 b)
        lu = jax.scipy.linalg.lu_factor(a[:, free[:, None], free])
        coupling = a[:, free[:, None], keep]
        response = jax.vmap(jax.scipy.linalg.lu_solve)(lu, coupling) if free.size else coupling
        inner.append(lu)
        cross.append(coupling)
        reach.append(response)
        kept.append(a[:, keep[:, None], keep] - jnp.swapaxes(coupling, -1, -2) @ response)
    full = _unlane(kept) + _links_and_bodies(model, layout, z)
    motion = _border_motion(layout, z)
    small = motion.T @ full @ motion
    size = jnp.abs(jnp.diagonal(small))
    weight = 1 / jnp.sqrt(jnp.where(size > 0, size, 1.0))
    lu = jax.scipy.linalg.lu_factor(weight[:, None] * small * weight)
    return Factor(
        pivot, ahead, back, last, tuple(inner), tuple(cross), tuple(reach), lu, motion, weight
    )


def solve_factored(
    model: RotorModel, factor: Factor, load: Complex[Array, "n dof"], *, transpose: bool
) -> Complex[Array, "n dof"]:
    """Z^{-1} f or Z^{-T} f from the factors, without refinement."""
    layout = layout_of(model)
    if transpose:
        factor = _swapped(factor)
    active = jnp.asarray(layout.active)
    plane = to_planes(jnp.where(active, load, 0.0), layout.dof)
    lanes = jnp.concatenate([_to_lanes(plane), jnp.zeros_like(plane[:1])])  # dummy node at the end
    g = jnp.moveaxis(lanes[layout.border], 1, -1)  # (b, 2, lanes)
    if layout.segment.size:
        r = lanes[layout.segment]  # (m, s, lanes, 2)
        r = _forward(factor, (r[..., 0], r[..., 1]))
        g = _onto_border(layout, factor, g, r)
    y = _solve_border(layout, factor, g, 1 if transpose else 0)
    out = lanes.at[layout.border].set(jnp.moveaxis(y, -1, 1))
    if layout.segment.size:
        x = _backward(layout, factor, r, y)
        out = out.at[layout.segment].set(jnp.stack(x, -1), mode="drop")
    x = _from_lanes(out[:-1], layout.dof)
    return jnp.where(active, x, load)


def _lanes(layout: Layout, z: Operator) -> _Lanes:
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

    lanes = _Lanes(*map(whirl, k, m, g))
    if layout.dof == 6:
        bar = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
        bars = jnp.einsum("ea,fg,ab->efagb", el.axial, bar, jnp.eye(2)).reshape(-1, 4, 4)
        k, m = sort(bars, jnp.zeros_like(st.mass)), sort(el.axial_mass, st.axial_mass)
        axial = _Lanes(*((stiff * a + inert * b)[..., None] for a, b in zip(k, m, strict=True)))
        lanes = _Lanes(*(jnp.concatenate(pair, -1) for pair in zip(lanes, axial, strict=True)))
    empty = jnp.asarray(layout.segment == layout.n)[..., None]
    one = jnp.eye(2)[:, :, None, None, None]
    return lanes._replace(diagonal=jnp.where(empty, one, lanes.diagonal))


def _sorted(layout: Layout, elements: Array, nodes: Array) -> _Lanes:
    """Element and node blocks of one matrix in one plane, in their places (lanes axis absent)."""
    n, b, (m, s) = layout.n, len(layout.border), layout.segment.shape
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
    return _Lanes(
        diagonal[layout.segment].transpose(2, 3, 0, 1) if m else jnp.zeros((2, 2, m, s)),
        place(kind == NEXT),
        place(kind == LEFT),
        jnp.zeros((s, 2, 2)).at[second[right]].add(off[right]).transpose(1, 2, 0),
        border.transpose(0, 2, 1, 3).reshape(2 * b, 2 * b),
    )


def _eliminate(lanes: _Lanes):
    """Pivots, W and X of all interior nodes."""

    def step(carry, here):
        pivot, fill = carry
        (a, b, _, d), n, e = here
        w = product(pivot, n)
        q = product_t(n, w)
        pivot = inverse((a - q[0], b - q[1], d - q[3]))
        fill = tuple(own - past for own, past in zip(e, product_t(w, fill), strict=True))
        return (pivot, fill), (pivot, w, fill)

    xs = tuple(of_block(x) for x in (lanes.diagonal, lanes.next, lanes.left))
    zero = jnp.zeros(lanes.diagonal.shape[3:], lanes.diagonal.dtype)
    start = ((zero + 1, zero, zero + 1), (zero,) * 4)
    _, out = jax.lax.scan(step, start, xs)
    return out


def _close(layout, border, fill, back, right, last, end_fill):
    """Add to the border matrix what the segments leave on their two ends."""
    b, (left, far) = len(layout.border), layout.ends
    to_left = tuple(-jnp.sum(c, 0) for c in product_t(fill, back))
    to_far = tuple(-c for c in product_t(right, last))
    across = tuple(-c for c in product_t(last, end_fill))  # rows far, columns left
    blocks = border.reshape(b, 2, b, 2, -1).transpose(0, 2, 1, 3, 4)
    shaped = lambda t: jnp.stack(t).reshape(2, 2, *t[0].shape).transpose(2, 0, 1, 3)  # noqa: E731
    blocks = blocks.at[left, left].add(shaped(to_left), mode="drop")
    blocks = blocks.at[far, far].add(shaped(to_far), mode="drop")
    both = (left < b) & (far < b)
    cross = shaped(across)[both]
    blocks = blocks.at[far[both], left[both]].add(cross)
    blocks = blocks.at[left[both], far[both]].add(jnp.swapaxes(cross, 1, 2))
    return blocks.transpose(0, 2, 1, 3, 4).reshape(border.shape)


def _forward(factor, r):
    def step(carry, here):
        (r1, r2), w = here
        past = times_t(w, carry)
        now = (r1 - past[0], r2 - past[1])
        return now, now

    zero = jnp.zeros_like(r[0][0])
    return jax.lax.scan(step, (zero, zero), (r, factor.ahead))[1]


def _onto_border(layout, factor, g, r):
    left, far = layout.ends
    to_left = jnp.stack([jnp.sum(c, 0) for c in times_t(factor.back, r)], 1)  # (s, 2, lanes)
    to_far = jnp.stack(times_t(factor.last, tuple(c[-1] for c in r)), 1)
    return g.at[left].add(-to_left, mode="drop").at[far].add(-to_far, mode="drop")


def _backward(layout, factor, r, y):
    ground = jnp.concatenate([y, jnp.zeros_like(y[:1])])
    left, far = (tuple(jnp.moveaxis(ground[e], 1, 0)) for e in layout.ends)
    own = times((factor.pivot[0], factor.pivot[1], factor.pivot[1], factor.pivot[2]), r)
    c = tuple(a - b for a, b in zip(own, times(factor.back, left), strict=True))

    def step(following, here):
        (c1, c2), w = here
        past = times(w, following)
        now = (c1 - past[0], c2 - past[1])
        return now, now

    # x_j needs W of the place after it; behind the last one stands the right border node.
    ahead = tuple(
        jnp.concatenate([w[1:], end[None]])
        for w, end in zip(factor.ahead, factor.last, strict=True)
    )
    return jax.lax.scan(step, far, (c, ahead), reverse=True)[1]


def _solve_border(layout, factor, g, trans):
    b, keep_free = len(layout.border), _choices(layout)
    flat = jnp.moveaxis(g.reshape(2 * b, -1), -1, 0)  # (lanes, 2 b)
    kept, inside = [], []
    for k, (lane, (free, keep)) in enumerate(zip(_groups(layout), keep_free, strict=True)):
        x = _lu_solve(factor.inner[k], flat[lane][:, free])
        kept.append(flat[lane][:, keep] - jnp.einsum("afk,af->ak", factor.cross[k], x))
        inside.append(x)
    rhs = factor.weight * (factor.motion.T @ _unlane_vector(kept))
    y = factor.motion @ (factor.weight * jax.scipy.linalg.lu_solve(factor.border, rhs, trans=trans))
    sizes = [len(keep) for _, keep in keep_free]
    out = jnp.zeros_like(flat)
    for k, (lane, (free, keep)) in enumerate(zip(_groups(layout), keep_free, strict=True)):
        own = _lane_vector(y, sizes, k)
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


def _groups(layout):
    """Numbers of the whirl lanes and of the axial lane."""
    return (np.array([0, 1]),) + ((np.array([2]),) if layout.dof == 6 else ())


def _choices(layout):
    """Untouched and touched border coordinates (of 2 b), for each kind of lane."""
    lateral = layout.touched[:, 0] | layout.touched[:, 1]
    kinds = [lateral] + ([layout.touched[:, 2]] if layout.dof == 6 else [])
    return [(np.flatnonzero(~t.reshape(-1)), np.flatnonzero(t.reshape(-1))) for t in kinds]


def _touched_numbers(layout):
    """Degree of freedom (in n * dof) and sign of the touched border coordinates.

    Their order: x plane, y plane, then axial and torsion.
    """
    numbers, signs = plane_numbers(layout.dof)
    choices = _choices(layout)
    out, sign = [], []
    for plane in range(len(numbers)):
        keep = choices[0 if plane < 2 else 1][1]
        out.append(layout.border[keep // 2] * layout.dof + numbers[plane][keep % 2])
        sign.append(signs[plane][keep % 2])
    return np.concatenate(out).astype(int), np.concatenate(sign)


def _border_motion(layout, z):
    """Touched border coordinates from the independent ones among them."""
    numbers, sign = _touched_numbers(layout)
    slaved = np.isin(numbers // layout.dof, layout.slaved)
    eye = jnp.eye(len(numbers))
    if not slaved.any():
        return eye[:, ~slaved]
    place = np.full(layout.n * layout.dof, -1)
    place[numbers] = np.arange(len(numbers))
    motion = eye
    for k, (node, centre) in enumerate(zip(layout.slaved, layout.centre_of, strict=True)):
        rows, columns = (place[i * layout.dof + np.arange(layout.dof)] for i in (node, centre))
        arm = sign[rows][:, None] * z.structure.arms[k] * sign[columns]
        motion = motion.at[np.ix_(rows, rows)].set(0.0).at[np.ix_(rows, columns)].set(arm)
    return motion[:, ~slaved]


def _links_and_bodies(model, layout, z):
    """Stiffness of links and bodies on the touched border coordinates."""
    numbers, sign = _touched_numbers(layout)
    place = np.full((layout.n + 1) * layout.dof, len(numbers))
    place[numbers] = np.arange(len(numbers))
    factor = np.append(sign, 1.0)
    dofs = np.arange(layout.dof)
    w, full = z.frequency, jnp.zeros((len(numbers),) * 2, complex)

    def add(full, rows, columns, block, toward):
        rows, columns = place[rows * layout.dof + dofs], place[columns * layout.dof + dofs]
        signed = toward * factor[rows][:, None] * block * factor[columns]
        return full.at[rows[:, None], columns].add(signed, mode="drop")

    blocks = z.links.stiffness + 1j * w * z.links.damping
    for (a, b), block in zip(layout.links, blocks, strict=True):
        full = add(add(full, a, a, block, 1), b, b, block, 1)
        full = add(add(full, a, b, block, -1), b, a, block, -1)
    inert = -(w**2) if z.structure.damping is None else -(w**2) + 1j * w * z.structure.damping[0]
    for node, (mass, gyro) in zip(layout.centres, z.structure.bodies, strict=True):
        full = add(full, node, node, inert * mass + 1j * w * z.spin_speed * gyro, 1)
    return full


def _unlane(kept):
    """From lanes to planes: S_xx = S_yy = (S_p + S_q)/2, S_xy = -S_yx = i (S_p - S_q)/2."""
    p, q = kept[0]
    mean, half = (p + q) / 2, 0.5j * (p - q)
    out = jnp.block([[mean, half], [-half, mean]])
    return out if len(kept) == 1 else jax.scipy.linalg.block_diag(out, kept[1][0])


def _unlane_vector(kept):
    (p, q), root = kept[0], np.sqrt(0.5)
    return jnp.concatenate([root * (p + q), -1j * root * (p - q), *(k[0] for k in kept[1:])])


def _lane_vector(y, sizes, kind):
    if kind == 1:
        return y[None, 2 * sizes[0] :]
    x, y = y[: sizes[0]], y[sizes[0] : 2 * sizes[0]]
    return np.sqrt(0.5) * jnp.stack([x + 1j * y, x - 1j * y])


def _to_lanes(plane):
    """(n, planes, 2) -> (n, lanes, 2)."""
    x, y = plane[:, 0], plane[:, 1]
    lateral = np.sqrt(0.5) * jnp.stack([x + 1j * y, x - 1j * y], 1)
    return jnp.concatenate([lateral, plane[:, 2:]], 1)


def _from_lanes(lanes, dof):
    p, q = lanes[:, 0], lanes[:, 1]
    lateral = np.sqrt(0.5) * jnp.stack([p + q, -1j * (p - q)], 1)
    return from_planes(jnp.concatenate([lateral, lanes[:, 2:]], 1), dof)


def _lu_solve(lu, b):
    """A real factorisation applied to complex right-hand sides, one a lane."""
    if not b.shape[-1]:
        return b
    if jnp.iscomplexobj(lu[0]):
        return jax.vmap(jax.scipy.linalg.lu_solve)(lu, b)
    parts = jax.vmap(jax.scipy.linalg.lu_solve)(lu, jnp.stack([b.real, b.imag], -1))
    return parts[..., 0] + 1j * parts[..., 1]
