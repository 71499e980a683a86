r"""A rotor model prepared for its solvers, and the products of its matrices with a motion.

Everything of a model that does not depend on the speed is collected once in a `System`, which all
verbs take in place of the model. Products go element by element (`structure_force`), which keeps
more digits than an assembled matrix; the full matrices of `matrices` serve the modes.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ._bodies import arm_matrix, body_matrices
from ._conventions import axis_numbers, from_planes, plane_numbers, to_planes
from ._damping import ModalDamping, ProportionalDamping
from ._inertia import disk_matrices, point_matrices
from ._lanes import Sorted, sort_structure
from ._layout import Layout, layout_of
from ._links import side_pull_stiffness
from ._model import RotorModel
from ._shaft import ElementMatrices, Node, element_matrices


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
    """Links at one spin speed, and the side pulls behind them.

    Attributes:
        stiffness: (l, dof, dof)
        damping: (l, dof, dof)
    """

    stiffness: Array
    damping: Array


class System(eqx.Module):
    """A rotor model with everything computed that does not depend on the speed.

    It stands for its model in every verb of `jaxcomp.rotor`, so that several of them share the
    preparation. Derivatives go through it to the numbers of the model.

    Attributes:
        model: the rotor model.
        layout: which node is connected to which; static.
        structure: matrices of shafts, disks, masses and bodies.
        places: those of shafts, disks and masses in the places of the structured solver.
        modal: (m, n, dof) M phi sqrt(2 zeta w) of modal damping, or None.
    """

    model: RotorModel
    layout: Layout = eqx.field(static=True)
    structure: Structure
    places: Sorted | None
    modal: Array | None

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The nodes in the order of every array over nodes."""
        return self.layout.names

    @property
    def dof(self) -> int:
        """Degrees of freedom of a node."""
        return self.layout.dof


def prepare(model: RotorModel | System) -> System:
    """Prepare a model; a `System` passes as it is."""
    return model if isinstance(model, System) else _prepare(model)


@eqx.filter_jit
def _prepare(model) -> System:
    system, modal = bare(model), None
    if isinstance(model.damping, ModalDamping):
        from ._modes import modal_damping_vectors  # the modes are built on this module

        modal = modal_damping_vectors(system)
    places = sort_structure(system.layout, system.structure)
    return System(model, system.layout, system.structure, places, modal)


def bare(model: RotorModel | System) -> System:
    """The prepared model without modal damping, which the undamped modes define."""
    if isinstance(model, System):
        return System(model.model, model.layout, model.structure, model.places, None)
    layout = layout_of(model)
    return System(model, layout, _structure(model, layout), None, None)


def _structure(model: RotorModel, layout: Layout) -> Structure:
    if model.shafts:
        elements = element_matrices(model.shafts)
    else:
        elements = ElementMatrices(*(jnp.zeros((0, *s)) for s in _ELEMENT_SHAPES))
    number = {name: i for i, name in enumerate(layout.names)}
    mass = polar = axial = jnp.zeros((layout.n, 2, 2))
    for disks in model.disks:
        at = np.array([number[node] for node in disks.nodes], int)
        m, g, a = disk_matrices(disks)
        mass, polar, axial = mass.at[at].add(m), polar.at[at].add(g), axial.at[at].add(a)
    for masses in model.masses:
        at = np.array([number[node] for node in masses.nodes], int)
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


_ELEMENT_SHAPES = ((), (2, 4), (2, 2), (4, 4), (4, 4), (2,), (4, 4))


def link_matrices(system: System, spin_speed: Float[Array, ""]) -> LinkMatrices:
    """Stiffness and damping of all links and side pulls at a spin speed [rad/s]."""
    dof, values, places, used = system.dof, [], [], 0
    for link in system.model.links:
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
    pulls = [side_pull_stiffness(p)[:, None, None] * lateral for p in system.model.side_pulls]
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


def follow(system: System, x: Array) -> Array:
    """Motion (n, dof) with the slaved nodes put where their bodies take them."""
    layout = system.layout
    if not layout.slaved.size:
        return x
    moved = jnp.einsum("sij,sj->si", system.structure.arms, x[layout.centre_of])
    return (x * _free(layout)).at[layout.slaved].add(moved)


def collect(system: System, f: Array) -> Array:
    """Forces (n, dof) with those on slaved nodes moved to their centres (transpose of `follow`)."""
    layout = system.layout
    if not layout.slaved.size:
        return f
    moved = jnp.einsum("sij,si->sj", system.structure.arms, f[layout.slaved])
    return (f * _free(layout)).at[layout.centre_of].add(moved)


def structure_force(
    system: System,
    links: LinkMatrices | None,
    x: Complex[Array, "n dof"],
    frequency: Float[Array, ""],
    spin_speed: Float[Array, ""],
) -> Complex[Array, "n dof"]:
    r"""[N], [N m] (K - w^2 M + i w (C + W G)) x, element by element.

    The nodes' motion must be complete (see `follow`), and forces on slaved nodes stay there.
    Without `links` the model is free.
    """
    layout, structure, dof = system.layout, system.structure, system.dof
    w, spin = frequency, spin_speed
    alpha, beta = (0.0, 0.0) if structure.damping is None else structure.damping
    stiff, inert, gyro = 1 + 1j * w * beta, -(w**2) + 1j * w * alpha, 1j * w * spin
    el, (i, j) = structure.elements, layout.pairs.T
    plane = to_planes(x, dof)
    f = jnp.zeros_like(plane)

    at = jnp.concatenate([plane[i], plane[j]], -1)  # (e, planes, 4)
    (u1, p1, u2, p2), half = jnp.moveaxis(at[:, :2], -1, 0), el.length[:, None] / 2
    bent = jnp.stack([p2 - p1, (u2 - u1) - half * (p1 + p2)], -1)
    load = stiff * jnp.einsum("eki,ekl,epl->epi", el.shape, el.lateral, bent)
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
        push, (a, b) = link_force(system, links, x, frequency), layout.links.T
        f = f.at[a].add(push).at[b].add(-push, mode="drop")
    if structure.bodies.shape[0]:
        z = inert * structure.bodies[:, 0] + gyro * structure.bodies[:, 1]
        f = f.at[layout.centres].add(jnp.einsum("bij,bj->bi", z, x[layout.centres]))
    return f


def link_force(
    system: System,
    links: LinkMatrices,
    x: Complex[Array, "n dof"],
    frequency: Float[Array, ""],
) -> Complex[Array, "l dof"]:
    """[N], [N m] Force of each link on its second node or the ground, (K + i w C)(x_a - x_b)."""
    ground = jnp.concatenate([x, jnp.zeros_like(x[:1])])
    a, b = system.layout.links.T
    relative = ground[a] - ground[b]
    return jnp.einsum("lij,lj->li", links.stiffness + 1j * frequency * links.damping, relative)


def _free(layout):
    free = np.ones((layout.n, 1))
    free[layout.slaved] = 0.0
    return free


class Operator(NamedTuple):
    """Z = K(W) - w^2 M + i w (C(W) + W G) on vectors (n, dof).

    Slaved nodes and idle coordinates carry the identity, so that Z is square over all nodes.

    Attributes:
        system: the speed-independent part.
        links: links at the spin speed.
        frequency: [rad/s] w.
        spin_speed: [rad/s] W.
    """

    system: System
    links: LinkMatrices
    frequency: Array
    spin_speed: Array


def operator_at(
    system: System, spin_speed: Float[Array, ""], frequency: Float[Array, ""]
) -> Operator:
    """The dynamic stiffness at a spin speed [rad/s] and an excitation frequency [rad/s]."""
    links = link_matrices(system, spin_speed)
    return Operator(system, links, jnp.asarray(frequency), jnp.asarray(spin_speed))


def apply(z: Operator, x: Complex[Array, "n dof"]) -> Complex[Array, "n dof"]:
    """Z x."""
    system = z.system
    active = jnp.asarray(system.layout.active)
    inside = follow(system, jnp.where(active, x, 0.0))
    f = structure_force(system, z.links, inside, z.frequency, z.spin_speed)
    f = collect(system, f)
    if system.modal is not None:
        modal = jnp.einsum("mnd,nd->m", system.modal, inside)
        f = f + 1j * z.frequency * jnp.einsum("mnd,m->nd", system.modal, modal)
    return jnp.where(active, f, x)


def scale(z: Operator) -> Float[Array, "n dof"]:
    """Positive diagonal by which Z is made dimensionless: |K_ii| + w |C_ii| + w^2 M_ii."""
    layout, structure, dof = z.system.layout, z.system.structure, z.system.dof
    w, el, (i, j) = z.frequency, structure.elements, layout.pairs.T
    bend = jnp.einsum("eki,ekl,eli->ei", el.shape, el.lateral, el.shape)
    lateral = bend + w**2 * jnp.einsum("eii->ei", el.mass)
    node = w**2 * jnp.einsum("nii->ni", structure.mass)
    node = node.at[i].add(lateral[:, :2]).at[j].add(lateral[:, 2:])
    out = jnp.zeros((layout.n, dof))
    numbers, _ = plane_numbers(dof)
    out = out.at[:, numbers[0]].set(node).at[:, numbers[1]].set(node)
    if dof == 6:
        bars = w**2 * jnp.einsum("eii->ei", el.axial_mass)
        end = w**2 * jnp.einsum("nii->ni", structure.axial_mass)
        end = end.at[i].add(el.axial + bars[:, :2]).at[j].add(el.axial + bars[:, 2:])
        out = out.at[:, numbers[2]].set(end)
    a, b = layout.links.T
    own = jnp.abs(jnp.einsum("lii->li", z.links.stiffness))
    own += w * jnp.abs(jnp.einsum("lii->li", z.links.damping))
    out = out.at[a].add(own).at[b].add(own, mode="drop")
    if layout.slaved.size:
        moved = jnp.einsum("sij,si->sj", structure.arms**2, out[layout.slaved])
        out = out.at[layout.centre_of].add(moved)
        own = w**2 * jnp.einsum("bii->bi", structure.bodies[:, 0])
        out = out.at[layout.centres].add(own)
    return jnp.where(jnp.asarray(layout.active) & (out > 0), out, 1.0)


def dense(z: Operator) -> Complex[Array, "all all"]:
    """Z as a full matrix over all nodes, column by column; the reference for the solvers."""
    layout = z.system.layout
    size = layout.n * layout.dof
    unit = np.eye(size).reshape(size, layout.n, layout.dof) + 0j
    columns = jax.vmap(lambda x: apply(z, x))(jnp.asarray(unit))
    return columns.reshape(size, size).T
