"""The dynamic stiffness of a rotor at a spin speed and a frequency, as products with a motion."""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact

from ._blocks import from_parts, in_parts, times_each
from ._conventions import add, take, to_components, to_planes_of_components, trailing
from ._layout import Layout
from ._system import System, collect, collected, follow, link_matrices
from ._ties import body_arms, reaction_matrix


class Operator(NamedTuple):
    """Z = K(W) - w^2 M + i w (C(W) + W G) on vectors (n, planes, 2).

    Slaved nodes and idle coordinates carry the identity, so that Z is square over all nodes. At a list of
    speeds everything has the speeds along a last axis.

    Attributes:
        system: the speed-independent part.
        stiffness: (l, dof, dof) of links and magnetic pulls at the spin speed.
        damping: (l, dof, dof)
        frequency: [rad/s] w.
        spin_speed: [rad/s] W.
    """

    system: System
    stiffness: Array
    damping: Array
    frequency: Array
    spin_speed: Array

    @property
    def links(self) -> Complex[Array, "l dof dof *speeds"]:
        """K + i w C of links and magnetic pulls."""
        return self.stiffness + 1j * self.frequency * self.damping

    @property
    def bodies(self) -> Complex[Array, "b dof dof *speeds"]:
        """-w^2 M + i w (alpha M + W G) of the bodies."""
        w = self.frequency
        mass, gyro = trailing(jnp.moveaxis(self.system.bodies, 1, 0), w.ndim)
        inert = -(w**2)
        if self.system.damping is not None:
            alpha, _ = self.system.damping
            # alpha alone: a rigid body has no stiffness that beta could act on
            inert = inert + 1j * w * alpha
        return inert * mass + 1j * w * self.spin_speed * gyro

    @property
    def coefficients(self) -> Array:
        """(q, l, ...) Factors of the terms in the components: stiffness, -w^2 of inertia, +-w W of polar.

        Real unless the structure itself is damped.
        """
        w = self.frequency
        stiff = jnp.ones_like(self.frequency)
        inert = -(w**2)
        turn = w * self.spin_speed
        if self.system.damping is not None:
            alpha, beta = self.system.damping
            stiff = stiff + 1j * w * beta
            inert = inert + 1j * w * alpha
        # + 0 makes the gyroscopic term complex where structural damping makes the others so.
        terms = jnp.stack([stiff, inert, turn + 0 * inert])
        # p whirls with the spin and q against it: the gyroscopic term has the other sign there
        lateral = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
        if self.system.dof == 4:
            return terms[:, None] * trailing(lateral, w.ndim)
        share = np.zeros((5, 3))
        share[:3, :2] = lateral
        share[3:, 2] = 1.0
        return take(terms, np.array([0, 1, 2, 0, 1]))[:, None] * trailing(share, w.ndim)


def operator_at(
    system: System, spin_speed: Float[Array, "*speeds"], frequency: Inexact[Array, "*speeds"]
) -> Operator:
    """The dynamic stiffness at a spin speed [rad/s] and an excitation frequency [rad/s], or a list."""
    spin_speed = jnp.asarray(spin_speed)
    links_at = partial(link_matrices, system)
    if spin_speed.ndim:
        links_at = jax.vmap(links_at, out_axes=-1)
    return Operator(system, *links_at(spin_speed), jnp.asarray(frequency), spin_speed)


def apply(
    z: Operator, x: Complex[Array, "n p 2 *speeds"], *, transpose=False, differentiated=False
) -> Complex[Array, "n p 2 *speeds"]:
    """Z x, or Z^T x.

    Args:
        z: the dynamic stiffness.
        x: [m], [rad] the motion.
        transpose: whether Z^T is meant.
        differentiated: whether derivatives by the matrices of elements will be taken.
    """
    system = z.system
    active = trailing(jnp.asarray(z.system.layout.moving), x.ndim - 3)
    # coordinates that do not move have the identity, see `Operator`
    inside = follow(system, jnp.where(active, x, 0.0))
    f = collect(system, _node_forces(z, inside, transpose, differentiated))
    if system.modal is not None:
        # C = sum v v^T is full and never formed: first the motion along every v, then the force along it.
        modal = jnp.einsum("mnpk,npk...->m...", system.modal, inside)
        f = f + 1j * z.frequency * jnp.einsum("mnpk,m...->npk...", system.modal, modal)
    return jnp.where(active, f, x)


def _node_forces(z: Operator, x: Complex[Array, "n p 2 *speeds"], transpose, differentiated=False):
    """Forces on all nodes, each where it acts, for the motion of all nodes; without modal damping."""
    layout = z.system.layout
    links = z.links
    bodies = z.bodies
    if transpose:
        links = jnp.swapaxes(links, 1, 2)
        bodies = jnp.swapaxes(bodies, 1, 2)
    f = add_links(layout, elastic_force(z, x, transpose, differentiated), links, x)
    if not len(bodies):
        return f
    of_bodies = take(x, layout.centres).reshape(-1, layout.dof, *x.shape[3:])
    of_bodies = times_each(bodies, of_bodies).reshape(-1, *x.shape[1:])
    return add(f, layout.centres, of_bodies)


def elastic_force(
    z: Operator, x: Inexact[Array, "n p 2 *speeds"], transpose: bool, differentiated: bool = False
):
    """Forces of shafts, disks and masses, in components and back."""
    system = z.system
    pairs = system.layout.pairs
    behind = x.shape[3:]
    components = to_components(x, transpose)
    terms = z.coefficients
    # Without the first term: disks and masses have no stiffness.
    times = _real_times_vectors
    if differentiated and behind:
        times = _real_times_columns
    f = _inertia_forces(times, system.inertia[..., 1:], terms[1:], components)
    if len(pairs):
        ends = take(components, pairs)  # (e, 2, l, 2, *speeds)
        # Relative rotation and transverse deformation, subtracted before anything else.
        difference = ends[:, 1] - ends[:, 0]
        turn = ends[:, 0, :, 1] + ends[:, 1, :, 1]
        half = trailing(system.half, len(behind))
        bent = jnp.stack([difference[:, :, 1], difference[:, :, 0] - half * turn], 2)
        stiff = 1.0 if system.damping is None else terms[0, 0]
        load = stiff * times(system.strain, bent)
        # Without the stiffness, which has acted through the deformations.
        if system.dof == 4:
            inertia = system.elements[..., 1:]
            terms = terms[1:]
        else:
            inertia = system.elements[..., [1, 2, 4]]
            terms = terms[np.array([1, 2, 4])]
        at = jnp.moveaxis(ends, 1, 2).reshape(len(pairs), -1, 4, *behind)
        load = load + _inertia_forces(times, inertia, terms, at)
        f = add(f, pairs, jnp.moveaxis(load.reshape(*at.shape[:2], 2, 2, *behind), 2, 1))
    return to_planes_of_components(f, transpose)


def _inertia_forces(times, matrices, terms, x):
    """Forces (m, l, i, ...) by matrices (m, i, j, q) with factors (q, l, ...), motions (m, l, j, ...)."""
    # Term by term, since a matrix at each speed would cost as much to put together as to multiply.
    forces = []
    for number, term in enumerate(terms):
        forces.append(term[:, None] * times(matrices[:, None, ..., number], x))
    return sum(forces[1:], forces[0])


def _real_times_vectors(matrices, x):
    """Products of real matrices (m, l, i, j) and complex vectors (m, l, j, ...)."""
    # Elementwise and no product of matrices, each of which is too small for a call of a library. In
    # parts, because JAX would make the matrices complex.
    parts = in_parts(x)[:, :, :, None]
    return from_parts(jnp.sum(trailing(matrices, x.ndim - 3) * parts, 4))


def _real_times_columns(matrices, x):
    """Products as those of `_real_times_vectors`, with derivatives that are products of matrices as well.

    Sums over the speeds would not become vector instructions.
    """
    speeds = x.shape[3:]
    columns = jnp.stack([x.real, x.imag], 3).reshape(*x.shape[:3], 2 * math.prod(speeds))
    matrices = jnp.broadcast_to(matrices, (*x.shape[:2], *matrices.shape[2:]))
    products = (matrices @ columns).reshape(*matrices.shape[:3], 2, *speeds)
    return jax.lax.complex(products[:, :, :, 0], products[:, :, :, 1])


def add_links(layout: Layout, f: Array, links: Array, x: Array) -> Array:
    """Forces with those of the links added, whose motion is relative."""
    if not len(links):
        return f
    push = link_force(layout, links, x)
    return add(f, layout.links, jnp.stack([push, -push], 1).reshape(-1, 2, *x.shape[1:]))


def link_force(layout: Layout, links: Array, x: Array) -> Array:
    """[N], [N m] (l, dof, ...) Force of links on their second node or the ground, from K (x_a - x_b)."""
    # the ground, whose number is that behind the last node, reads a motion of zero
    ground = jnp.concatenate([x, jnp.zeros_like(x[:1])])
    ends = take(ground, layout.links).reshape(-1, 2, layout.dof, *x.shape[3:])
    return times_each(links, ends[:, 0] - ends[:, 1])


def scale(z: Operator) -> Float[Array, "n p 2 *speeds"]:
    """Positive diagonal by which Z is made dimensionless: |K_ii| + w |C_ii| + w^2 M_ii."""
    system = z.system
    w = z.frequency
    layout = system.layout
    dof = system.dof
    square = w**2
    node = jnp.einsum("niiq->niq", system.inertia)
    of_elements = jnp.einsum("eiiq->eiq", system.elements).reshape(-1, 2, 2, node.shape[-1])
    node = trailing(add(node, layout.pairs, of_elements), w.ndim)
    lateral = node[:, :, 0] + square * node[:, :, 1]
    planes = [lateral, lateral]
    if dof == 6:
        planes.append(node[:, :, 3] + square * node[:, :, 4])
    out = jnp.stack(planes, 1)
    # The gyroscopic term couples one plane with the other and has no part in the diagonal.
    of_links = jnp.einsum("lii...->li...", jnp.abs(z.stiffness) + w * jnp.abs(z.damping))
    of_links = jnp.stack([of_links, of_links], 1)
    out = add(out, layout.links, of_links.reshape(-1, 2, *out.shape[1:]))
    if not layout.free.all():
        node, master = layout.ties.nodes
        # The diagonal of A^T D A.
        at = take(out, node).reshape(-1, dof, *out.shape[3:])
        moved = times_each(jnp.swapaxes(system.arms, 1, 2) ** 2, at)
        out = add(out, master, moved.reshape(-1, *out.shape[1:]))
    of_bodies = square * trailing(jnp.einsum("bii->bi", system.bodies[:, 0]), w.ndim)
    out = add(out, layout.centres, of_bodies.reshape(-1, *out.shape[1:]))
    moving = trailing(jnp.asarray(layout.moving), w.ndim)
    return jnp.where(moving & (out > 0), out, 1.0)


def dense(z: Operator) -> Complex[Array, "all all"]:
    """Z as a full matrix over all coordinates, column by column; the reference for the solvers."""
    shape = z.system.layout.moving.shape
    size = int(np.prod(shape))
    unit = jnp.asarray(np.eye(size).reshape(size, *shape) + 0j)
    return jax.vmap(lambda x: apply(z, x))(unit).reshape(size, size).T


def reactions(
    z: "Operator", x: Complex[Array, "n p 2 *speeds"], force: Complex[Array, "n p 2 *speeds"]
) -> Complex[Array, "links dof *speeds"]:
    """[N], [N m] Force of each held link on its second node or the ground; zero for the others.

    From the motion of all nodes, and the load before it is collected.
    """
    system = z.system
    layout = z.system.layout
    dof = layout.dof
    holds = layout.ties.holds
    arms = body_arms(system.model.bodies, dof)
    nodes = np.array(layout.slaved, int).reshape(-1, 2).T
    # Only bodies collect here: the forces on lost coordinates are what the conditions have to hold.
    free = np.ones((layout.n, 1, 1))
    free[nodes[0]] = 0.0
    unbalanced = collected(force - _node_forces(z, x, False), free, *nodes, arms)
    unbalanced = unbalanced.reshape(-1, *x.shape[3:])
    lost = []
    at = []
    for hold in holds:
        lost.append(hold.node * dof + hold.coordinate)
        at.append(hold.link * dof + hold.coordinate)
    held = reaction_matrix(layout.ties, layout.slaved, arms) @ take(unbalanced, np.array(lost))
    out = jnp.zeros((len(system.model.links) * dof, *x.shape[3:]), complex)
    return add(out, np.array(at), held).reshape(-1, dof, *x.shape[3:])
