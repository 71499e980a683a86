r"""The dynamic stiffness at one spin speed and one frequency, as a product and as a diagonal."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ._assembly import (
    LinkMatrices,
    Structure,
    collect,
    follow,
    link_matrices,
    structure_force,
    structure_of,
)
from ._conventions import plane_numbers
from ._damping import ModalDamping
from ._lanes import Sorted, sort_structure
from ._layout import layout_of
from ._model import RotorModel
from ._shaft import deformation


class Operator(NamedTuple):
    """Z = K(W) - w^2 M + i w (C(W) + W G) on vectors (n, dof).

    Slaved nodes and idle coordinates carry the identity, so that Z is square over all nodes.

    Attributes:
        structure: speed-independent part.
        sorted: its matrices in the places of the structured solver.
        links: links at the spin speed.
        modal: (m, n, dof) M phi sqrt(2 zeta w) of modal damping, or None.
        frequency: [rad/s] w.
        spin_speed: [rad/s] W.
    """

    structure: Structure
    sorted: Sorted
    links: LinkMatrices
    modal: Array | None
    frequency: Array
    spin_speed: Array


def operator_at(
    model: RotorModel,
    prepared: "Prepared",
    spin_speed: Float[Array, ""],
    frequency: Float[Array, ""],
) -> Operator:
    """The dynamic stiffness at a spin speed [rad/s] and an excitation frequency [rad/s]."""
    links = link_matrices(model, spin_speed)
    structure, places, modal = prepared
    frequency, spin_speed = jnp.asarray(frequency), jnp.asarray(spin_speed)
    return Operator(structure, places, links, modal, frequency, spin_speed)


class Prepared(NamedTuple):
    """The speed-independent fields of an `Operator`."""

    structure: Structure
    sorted: Sorted
    modal: Array | None


def prepare(model: RotorModel) -> Prepared:
    """The speed-independent part of a model, computed once for many speeds."""
    modal = None
    if isinstance(model.damping, ModalDamping):
        from ._modes import modal_damping_vectors  # the modes are built on this module

        modal = modal_damping_vectors(model)
    structure = structure_of(model)
    return Prepared(structure, sort_structure(layout_of(model), structure), modal)


def apply(model: RotorModel, z: Operator, x: Complex[Array, "n dof"]) -> Complex[Array, "n dof"]:
    """Z x."""
    layout = layout_of(model)
    active = jnp.asarray(layout.active)
    inside = follow(z.structure, layout, jnp.where(active, x, 0.0))
    f = structure_force(model, z.structure, z.links, inside, z.frequency, z.spin_speed)
    f = collect(z.structure, layout, f)
    if z.modal is not None:
        modal = jnp.einsum("mnd,nd->m", z.modal, inside)
        f = f + 1j * z.frequency * jnp.einsum("mnd,m->nd", z.modal, modal)
    return jnp.where(active, f, x)


def scale(model: RotorModel, z: Operator) -> Float[Array, "n dof"]:
    """Positive diagonal by which Z is made dimensionless: |K_ii| + w |C_ii| + w^2 M_ii."""
    layout, dof, el = layout_of(model), model.dof, z.structure.elements
    w, (i, j) = z.frequency, layout.pairs.T
    shape = jax.vmap(deformation)(el.length)
    bend = jnp.einsum("eki,ekl,eli->ei", shape, el.lateral, shape)
    lateral = bend + w**2 * jnp.einsum("eii->ei", el.mass)
    node = w**2 * jnp.einsum("nii->ni", z.structure.mass)
    node = node.at[i].add(lateral[:, :2]).at[j].add(lateral[:, 2:])
    out = jnp.zeros((layout.n, dof))
    numbers, _ = plane_numbers(dof)
    out = out.at[:, numbers[0]].set(node).at[:, numbers[1]].set(node)
    if dof == 6:
        bars = w**2 * jnp.einsum("eii->ei", el.axial_mass)
        end = w**2 * jnp.einsum("nii->ni", z.structure.axial_mass)
        end = end.at[i].add(el.axial + bars[:, :2]).at[j].add(el.axial + bars[:, 2:])
        out = out.at[:, numbers[2]].set(end)
    a, b = layout.links.T
    own = jnp.abs(jnp.einsum("lii->li", z.links.stiffness))
    own += w * jnp.abs(jnp.einsum("lii->li", z.links.damping))
    out = out.at[a].add(own).at[b].add(own, mode="drop")
    if layout.slaved.size:
        moved = jnp.einsum("sij,si->sj", z.structure.arms**2, out[layout.slaved])
        out = out.at[layout.centre_of].add(moved)
        own = w**2 * jnp.einsum("bii->bi", z.structure.bodies[:, 0])
        out = out.at[layout.centres].add(own)
    return jnp.where(jnp.asarray(layout.active) & (out > 0), out, 1.0)


def dense(model: RotorModel, z: Operator) -> Complex[Array, "all all"]:
    """Z as a full matrix over all nodes, column by column; the reference for the solvers."""
    layout = layout_of(model)
    size = layout.n * layout.dof
    unit = np.eye(size).reshape(size, layout.n, layout.dof) + 0j
    columns = jax.vmap(lambda x: apply(model, z, x))(jnp.asarray(unit))
    return columns.reshape(size, size).T
