r"""From the tables to matrices: the structure of a model, and its full matrices.

The speed-independent part is collected once in a `Structure`. Products with it go element by
element (`structure_force`), which keeps more digits than an assembled matrix; the full matrices of
`matrices` serve the modes and the dense reference.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ._bodies import arm_matrix, body_matrices
from ._conventions import axis_numbers, plane_numbers
from ._damping import ProportionalDamping
from ._inertia import disk_matrices, point_matrices
from ._layout import Layout, layout_of
from ._links import side_pull_stiffness
from ._model import RotorModel, node_index
from ._shaft import ElementMatrices, deformation, element_matrices


class Structure(NamedTuple):
    """Everything of a model that does not depend on the speed.

    Attributes:
        elements: beam elements in plane coordinates, all tables in one.
        mass: (n, 2, 2) concentrated inertia on (u, phi) of the nodes.
        polar: (n, 2, 2) concentrated polar inertia.
        axial_mass: (n, 2, 2) concentrated inertia on (u_z, th_z).
        arms: (slaved, dof, dof) motion of slaved nodes from their centre.
        bodies: (bodies, 2, dof, dof) inertia and gyroscopic matrix of the rigid bodies.
        damping: (alpha, beta) of the proportional damping, or None.
    """

    elements: ElementMatrices
    mass: Array
    polar: Array
    axial_mass: Array
    arms: Array
    bodies: Array
    damping: tuple[Array, Array] | None


class LinkMatrices(NamedTuple):
    """Links at one spin speed.

    Attributes:
        stiffness: (l, dof, dof)
        damping: (l, dof, dof)
    """

    stiffness: Array
    damping: Array


class Matrices(NamedTuple):
    """Full matrices over the active degrees of freedom, and their motion from those.

    Attributes:
        mass: [kg, kg m, kg m2] (a, a)
        damping: [N s/m] (a, a), [N s] and [N m s] where rotations enter; without the gyroscopic part.
        gyroscopic: [kg m2] (a, a), to be multiplied by the spin speed.
        stiffness: [N/m] (a, a), [N] and [N m] where rotations enter; links included.
        expand: [-, m] (n * dof, a) motion of all nodes from the active degrees of freedom.
    """

    mass: Array
    damping: Array
    gyroscopic: Array
    stiffness: Array
    expand: Array


def structure_of(model: RotorModel) -> Structure:
    """Collect the speed-independent part of a model."""
    layout = layout_of(model)
    if model.shafts:
        elements = element_matrices(model.shafts)
    else:
        elements = ElementMatrices(*(jnp.zeros((0, *s)) for s in _ELEMENT_SHAPES))
    mass = polar = axial = jnp.zeros((layout.n, 2, 2))
    for disks in model.disks:
        at = np.array([node_index(model, node) for node in disks.nodes], int)
        m, g, a = disk_matrices(disks)
        mass, polar, axial = mass.at[at].add(m), polar.at[at].add(g), axial.at[at].add(a)
    for masses in model.masses:
        at = np.array([node_index(model, node) for node in masses.nodes], int)
        m = point_matrices(masses)
        mass, axial = mass.at[at].add(m), axial.at[at].add(m)
    dof = layout.dof
    arms = [arm_matrix(body.arm, dof) for body in model.bodies]
    bodies = [jnp.stack(body_matrices(body, dof)) for body in model.bodies]
    damping = None
    if isinstance(model.damping, ProportionalDamping):
        damping = (model.damping.mass_factor, model.damping.stiffness_factor)
    return Structure(
        elements,
        mass,
        polar,
        axial,
        jnp.concatenate([jnp.zeros((0, dof, dof)), *arms]),
        jnp.stack(bodies) if bodies else jnp.zeros((0, 2, dof, dof)),
        damping,
    )


def link_matrices(model: RotorModel, spin_speed: Float[Array, ""]) -> LinkMatrices:
    """Stiffness and damping of all links and side pulls at a spin speed [rad/s]."""
    dof, values, places, used = model.dof, [], [], 0
    for link in model.links:
        k, c = link.law.coefficients(spin_speed)
        own, there = axis_numbers(dof, link.axes)
        place = np.full((dof, dof), -1)
        size = len(link.axes)
        place[np.ix_(there, there)] = (
            used + np.arange(size**2).reshape(size, size)[np.ix_(own, own)]
        )
        values.append(jnp.stack([k, c]).reshape(2, -1))
        places.append(place)
        used += size**2
    # One gather for all links, whose last value is the zero of the places that no law fills.
    table = jnp.concatenate([*values, jnp.zeros((2, 1))], 1)
    stiffness, damping = table[:, np.array(places, int).reshape(-1, dof, dof)]
    lateral = np.zeros((dof, dof))
    lateral[0, 0] = lateral[1, 1] = 1.0
    pulls = [side_pull_stiffness(pull)[:, None, None] * lateral for pull in model.side_pulls]
    stiffness = jnp.concatenate([stiffness, *pulls])
    return LinkMatrices(stiffness, jnp.zeros_like(stiffness).at[: len(damping)].set(damping))


def link_places(layout: Layout, count: int | None = None):
    """Nodes of the rows and columns of four blocks a link, and their signs: aa, bb, ab, ba.

    The ground has the number beyond the last node. With `count` only the first links.
    """
    a, b = layout.links[:count].T
    one = np.ones(len(a))
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
    return rows, columns, np.concatenate([one, one, -one, -one])


def to_planes(x: Array, dof: int) -> Array:
    """(n, dof) -> (n, planes, 2), see `_conventions`."""
    numbers, signs = plane_numbers(dof)
    return x[:, numbers] * signs


def from_planes(x: Array, dof: int) -> Array:
    """(n, planes, 2) -> (n, dof)."""
    numbers, signs = plane_numbers(dof)
    order = np.argsort(numbers.reshape(-1))
    return (x * signs).reshape(x.shape[0], -1)[:, order]


def follow(structure: Structure, layout: Layout, x: Array) -> Array:
    """Motion (n, dof) with the slaved nodes put where their bodies take them."""
    if not layout.slaved.size:
        return x
    moved = jnp.einsum("sij,sj->si", structure.arms, x[layout.centre_of])
    return (x * _free(layout)).at[layout.slaved].add(moved)


def collect(structure: Structure, layout: Layout, f: Array) -> Array:
    """Forces (n, dof) with those on slaved nodes moved to their centres (transpose of `follow`)."""
    if not layout.slaved.size:
        return f
    moved = jnp.einsum("sij,si->sj", structure.arms, f[layout.slaved])
    return (f * _free(layout)).at[layout.centre_of].add(moved)


def structure_force(
    model: RotorModel,
    structure: Structure,
    links: LinkMatrices | None,
    x: Complex[Array, "n dof"],
    frequency: Float[Array, ""],
    spin_speed: Float[Array, ""],
) -> Complex[Array, "n dof"]:
    r"""[N], [N m] (K - w^2 M + i w (C + W G)) x, element by element.

    The nodes' motion must be complete (see `follow`), and forces on slaved nodes stay there.
    Without `links` the model is free.
    """
    layout, dof = layout_of(model), model.dof
    w, spin = frequency, spin_speed
    alpha, beta = (0.0, 0.0) if structure.damping is None else structure.damping
    stiff, inert, gyro = 1 + 1j * w * beta, -(w**2) + 1j * w * alpha, 1j * w * spin
    el, (i, j) = structure.elements, layout.pairs.T
    plane = to_planes(x, dof)
    f = jnp.zeros_like(plane)

    at = jnp.concatenate([plane[i], plane[j]], -1)  # (e, planes, 4)
    shape = jax.vmap(deformation)(el.length)
    (u1, p1, u2, p2), half = jnp.moveaxis(at[:, :2], -1, 0), el.length[:, None] / 2
    bent = jnp.stack([p2 - p1, (u2 - u1) - half * (p1 + p2)], -1)
    load = stiff * jnp.einsum("eki,ekl,epl->epi", shape, el.lateral, bent)
    load += inert * jnp.einsum("eij,epj->epi", el.mass, at[:, :2])
    turned = gyro * jnp.einsum("eij,epj->epi", el.polar, at[:, :2])
    load += jnp.stack([turned[:, 1], -turned[:, 0]], 1)
    node = inert * jnp.einsum("nij,npj->npi", structure.mass, plane[:, :2])
    turned = gyro * jnp.einsum("nij,npj->npi", structure.polar, plane[:, :2])
    node += jnp.stack([turned[:, 1], -turned[:, 0]], 1)
    if dof == 6:
        pull = stiff * el.axial * (at[:, 2, 2:] - at[:, 2, :2])
        bar = jnp.concatenate([-pull, pull], -1)
        bar += inert * jnp.einsum("eij,ej->ei", el.axial_mass, at[:, 2])
        load = jnp.concatenate([load, bar[:, None]], 1)
        end = inert * jnp.einsum("nij,nj->ni", structure.axial_mass, plane[:, 2])
        node = jnp.concatenate([node, end[:, None]], 1)
    f = f.at[i].add(load[..., :2]).at[j].add(load[..., 2:]) + node
    f = from_planes(f, dof)

    if links is not None and layout.links.size:
        push, (a, b) = link_force(model, links, x, frequency), layout.links.T
        f = f.at[a].add(push).at[b].add(-push, mode="drop")
    if structure.bodies.shape[0]:
        z = inert * structure.bodies[:, 0] + gyro * structure.bodies[:, 1]
        f = f.at[layout.centres].add(jnp.einsum("bij,bj->bi", z, x[layout.centres]))
    return f


def link_force(
    model: RotorModel,
    links: LinkMatrices,
    x: Complex[Array, "n dof"],
    frequency: Float[Array, ""],
) -> Complex[Array, "l dof"]:
    """[N], [N m] Force of each link on its second node or the ground, (K + i w C)(x_a - x_b)."""
    ground = jnp.concatenate([x, jnp.zeros_like(x[:1])])
    a, b = layout_of(model).links.T
    relative = ground[a] - ground[b]
    return jnp.einsum("lij,lj->li", links.stiffness + 1j * frequency * links.damping, relative)


def matrices(
    model: RotorModel, spin_speed: Float[Array, ""] = 0.0, *, with_links: bool = True
) -> Matrices:
    """Full matrices of a model at a spin speed [rad/s], without modal damping.

    Args:
        model: the model.
        spin_speed: [rad/s] at which the links are evaluated.
        with_links: false leaves out bearings, mounts and side pull (free-free).
    """
    return _matrices(model, jnp.asarray(spin_speed, float), with_links)


@eqx.filter_jit
def _matrices(model, spin_speed, with_links) -> Matrices:
    layout, structure = layout_of(model), structure_of(model)
    n, dof, el = layout.n, model.dof, structure.elements
    shape = jax.vmap(deformation)(el.length)
    bend = jnp.einsum("eki,ekl,elj->eij", shape, el.lateral, shape)
    lateral = [
        _plane_matrix(layout, e, p)
        for e, p in ((bend, None), (el.mass, structure.mass), (el.polar, structure.polar))
    ]
    numbers, signs = plane_numbers(dof)
    x, y = (numbers[p] + dof * np.arange(n)[:, None] for p in (0, 1))
    x, y, s = x.reshape(-1), y.reshape(-1), np.tile(signs[1], n)
    zero = jnp.zeros((n * dof, n * dof))
    both = lambda k: zero.at[np.ix_(x, x)].set(k).at[np.ix_(y, y)].set(s[:, None] * k * s)  # noqa: E731
    k, m = both(lateral[0]), both(lateral[1])
    g = zero.at[np.ix_(x, y)].set(lateral[2] * s).at[np.ix_(y, x)].set(-s[:, None] * lateral[2])
    if dof == 6:
        a = (numbers[2] + dof * np.arange(n)[:, None]).reshape(-1)
        bars = jnp.einsum("ea,fg,ab->efagb", el.axial, _BAR, jnp.eye(2)).reshape(-1, 4, 4)
        k = k.at[np.ix_(a, a)].set(_plane_matrix(layout, bars, None))
        m = m.at[np.ix_(a, a)].set(_plane_matrix(layout, el.axial_mass, structure.axial_mass))
    for number, (inertia, spin) in zip(layout.centres, structure.bodies, strict=True):
        at = np.ix_(*(number * dof + np.arange(dof),) * 2)
        m, g = m.at[at].add(inertia), g.at[at].add(spin)
    alpha, beta = (0.0, 0.0) if structure.damping is None else structure.damping
    c = alpha * m + beta * k
    if with_links:
        rows, columns, signs = link_places(layout)
        own = np.concatenate([np.arange(len(layout.links))] * 4)
        rows, columns = (at[:, None] * dof + np.arange(dof) for at in (rows, columns))
        at = (rows[:, :, None], columns[:, None, :])
        kl, cl = (signs[:, None, None] * m[own] for m in link_matrices(model, spin_speed))
        k, c = k.at[at].add(kl, mode="drop"), c.at[at].add(cl, mode="drop")
    expand = expansion(layout, structure)
    reduced = (expand.T @ matrix @ expand for matrix in (m, c, g, k))
    return Matrices(*reduced, expand)


def expansion(layout: Layout, structure: Structure) -> Float[Array, "all active"]:
    """Motion of all nodes from the active degrees of freedom."""
    n, dof = layout.n, layout.dof
    columns = np.eye(n * dof)[:, layout.active.reshape(-1)].reshape(n, dof, -1)
    full = jax.vmap(lambda x: follow(structure, layout, x), -1, -1)(jnp.asarray(columns))
    return full.reshape(n * dof, -1)


_ELEMENT_SHAPES = ((), (2, 2), (4, 4), (4, 4), (2,), (4, 4))
_BAR = np.array([[1.0, -1.0], [-1.0, 1.0]])


def _free(layout):
    free = np.ones((layout.n, 1))
    free[layout.slaved] = 0.0
    return free


def _plane_matrix(layout, elements, nodes):
    """(2 n, 2 n) matrix of one plane from element (e, 4, 4) and node (n, 2, 2) blocks."""
    n = layout.n
    full = jnp.zeros((n, n, 2, 2))
    i, j = layout.pairs.T
    for a, p in ((i, 0), (j, 2)):
        for b, q in ((i, 0), (j, 2)):
            full = full.at[a, b].add(elements[:, p : p + 2, q : q + 2])
    if nodes is not None:
        full = full.at[np.arange(n), np.arange(n)].add(nodes)
    return full.transpose(0, 2, 1, 3).reshape(2 * n, 2 * n)
