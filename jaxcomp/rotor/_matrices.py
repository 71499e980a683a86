r"""Full matrices of a model over its active degrees of freedom."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._conventions import plane_numbers
from ._model import RotorModel
from ._system import System, bare, follow, link_matrices, link_places


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


def matrices(
    model: RotorModel | System, spin_speed: Float[Array, ""] = 0.0, *, with_links: bool = True
) -> Matrices:
    """Full matrices of a model at a spin speed [rad/s], without modal damping.

    Args:
        model: the model, or the `System` prepared from it.
        spin_speed: [rad/s] at which the links are evaluated.
        with_links: false leaves out bearings, mounts and side pull (free-free).
    """
    return _matrices(model, jnp.asarray(spin_speed, float), with_links)


@eqx.filter_jit
def _matrices(model, spin_speed, with_links) -> Matrices:
    system = bare(model)
    layout, structure = system.layout, system.structure
    n, dof, el = layout.n, layout.dof, structure.elements
    bend = jnp.einsum("eki,ekl,elj->eij", el.shape, el.lateral, el.shape)
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
        kl, cl = (signs[:, None, None] * m[own] for m in link_matrices(system, spin_speed))
        k, c = k.at[at].add(kl, mode="drop"), c.at[at].add(cl, mode="drop")
    expand = expansion(system)
    reduced = (expand.T @ matrix @ expand for matrix in (m, c, g, k))
    return Matrices(*reduced, expand)


def expansion(system: System) -> Float[Array, "all active"]:
    """Motion of all nodes from the active degrees of freedom."""
    layout, n, dof = system.layout, system.layout.n, system.dof
    columns = np.eye(n * dof)[:, layout.active.reshape(-1)].reshape(n, dof, -1)
    full = jax.vmap(lambda x: follow(system, x), -1, -1)(jnp.asarray(columns))
    return full.reshape(n * dof, -1)


_BAR = np.array([[1.0, -1.0], [-1.0, 1.0]])


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
