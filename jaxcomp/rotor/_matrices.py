r"""Full matrices of a model over its active degrees of freedom."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._conventions import add, from_planes, to_planes
from ._model import RotorModel
from ._system import System, bare, follow, link_matrices, released


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
        with_links: false leaves out bearings, mounts, pins and magnetic pull (free-free).
    """
    model = model if with_links else released(model)
    return _matrices(model, jnp.asarray(spin_speed, float), with_links)


@eqx.filter_jit
def _matrices(model, spin_speed, with_links) -> Matrices:
    system = bare(model)
    layout = system.layout
    n, dof, (i, j), terms = layout.n, layout.dof, layout.pairs.T, system.inertia.shape[-1]
    ends = system.elements.reshape(-1, 2, 2, 2, 2, terms)
    blocks = jnp.moveaxis(ends, 3, 2).reshape(-1, 2, 2, terms)  # four an element
    own = np.arange(n) * (n + 1)
    at = np.stack([i * n + i, i * n + j, j * n + i, j * n + j], -1).reshape(-1)
    blocks = add(jnp.zeros((n * n, 2, 2, terms)), at, blocks)
    blocks = add(blocks, own, system.inertia).reshape(n, n, 2, 2, terms)
    planes = _PLANES[:terms, : dof // 2, : dof // 2]
    k, m, g = (
        jnp.einsum("nmijq,qab->nmaibj", blocks[..., q], planes[q]).reshape(n, n, dof, dof)
        for q in (_STIFFNESS[: terms // 2], _INERTIA[: terms // 2], _POLAR)
    )
    bodies = layout.centres
    m, g = (x.at[bodies, bodies].add(system.bodies[:, q]) for q, x in enumerate((m, g)))
    alpha, beta = (0.0, 0.0) if system.damping is None else system.damping
    c = alpha * m + beta * k
    if with_links:
        a, b = layout.links.T
        links = jnp.stack(link_matrices(system, spin_speed))
        rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
        links = jnp.concatenate([links, links, -links, -links], 1)
        k, c = (x.at[rows, columns].add(y, mode="drop") for x, y in zip((k, c), links, strict=True))
    expand = expansion(system)
    square = lambda x: x.swapaxes(1, 2).reshape(n * dof, n * dof)  # noqa: E731
    reduced = (expand.T @ square(matrix) @ expand for matrix in (m, c, g, k))
    full = expand.T.reshape(-1, n, dof // 2, 2)
    full = jax.vmap(lambda x: from_planes(x, dof))(full).reshape(len(full), -1).T
    return Matrices(*reduced, full)


def expansion(system: System) -> Float[Array, "all active"]:
    """Coordinates of all nodes, in the order of the planes, from the active degrees of freedom."""
    layout, dof = system.layout, system.dof
    units = np.eye(layout.n * dof)[layout.active.reshape(-1)].reshape(-1, layout.n, dof)
    full = jax.vmap(lambda x: follow(system, to_planes(x, dof)))(jnp.asarray(units))
    return full.reshape(len(units), -1).T


# Which planes the terms of a `System` belong to; the polar inertia couples x and y.
_PLANES = np.zeros((5, 3, 3))
_PLANES[:2, :2, :2] = np.eye(2)
_PLANES[2, 0, 1], _PLANES[2, 1, 0] = 1.0, -1.0
_PLANES[3:, 2, 2] = 1.0
_STIFFNESS, _INERTIA, _POLAR = np.array([0, 3]), np.array([1, 4]), np.array([2])
