r"""Derivatives of undamped modes along a direction, repeated eigenvalues included."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._fields import admissible
from ._eigen import CLUSTER, pencil
from ._layout import layout_of
from ._matrices import matrices
from ._model import RotorModel
from ._modes import Modes
from ._system import released


class ModeDerivatives(NamedTuple):
    """Derivatives of modes along one direction of the parameters.

    Attributes:
        modes: the modes, in the basis of each cluster that the direction selects.
        square: [rad2/s2] (m,) derivative of w^2, for one unit of the parameters.
        shape: [-] (m, nodes, dof) the same of the shapes.
    """

    modes: Modes
    square: Array
    shape: Array


def mode_derivatives(
    model: RotorModel, direction: RotorModel, count: int = 12, *, free: bool = False
) -> ModeDerivatives:
    r"""Derivatives of eigenvalues and eigenvectors along a direction, pairs that split included.

    Inside a cluster of equal eigenvalues the derivatives are the eigenvalues of
    Phi^T (K' - lambda M') Phi, whose eigenvectors give the basis Z in which the modes are
    differentiable; the part of the eigenvector derivative inside the cluster needs second
    derivatives: R. L. Dailey (1989), Eigenvector derivatives with repeated eigenvalues, AIAA J. 27.
    A pair that stays together keeps its basis but for the normalisation.

    Args:
        model: the model.
        direction: a model of the same construction whose numbers are the direction's components;
            zero where nothing changes.
        count: number of modes; the last cluster must be complete.
        free: leave out all links and magnetic pulls.
    """
    if free:
        model, direction = released(model), released(direction)  # pyright: ignore[reportAssignmentType]
    return _mode_derivatives(model, direction, count, free)


@eqx.filter_jit
def _mode_derivatives(model, direction, count, free) -> ModeDerivatives:
    numbers, rest = eqx.partition(model, eqx.is_inexact_array)
    tangent = eqx.filter(direction, eqx.is_inexact_array)

    def system(t):
        moved = jax.tree.map(lambda a, b: a + t * b, numbers, tangent)
        full = matrices(eqx.combine(moved, rest), 0.0, with_links=not free)
        return (full.stiffness + full.stiffness.T) / 2, full.mass, full.expand

    first = lambda t: jax.jvp(system, (t,), (jnp.ones_like(t),))[1]  # noqa: E731
    zero = jnp.asarray(0.0)
    (k, m, expand), (dk, dm, dexpand) = jax.jvp(system, (zero,), (jnp.ones(()),))
    ddk, ddm, _ = jax.jvp(first, (zero,), (jnp.ones(()),))[1]
    mu, x = pencil(k, m)
    x = x[:, :count] / jnp.sqrt(mu[:count])
    value = jnp.einsum("im,ij,jm->m", x, k, x)
    top = jnp.max(jnp.abs(value))
    same = jnp.abs(value[:, None] - value[None, :]) <= 1e3 * CLUSTER * top
    value = same @ value / jnp.sum(same, 1)

    # Rotate every cluster so that the first-order change is diagonal in it. Adding a spread far
    # beyond all derivatives keeps the clusters apart in one `eigh`.
    change = x.T @ dk @ x - 0.5 * (value[:, None] + value[None, :]) * (x.T @ dm @ x)
    change = jnp.where(same, change, 0.0)
    spread = 4 * count * (jnp.max(jnp.abs(change)) + 1e-300)
    group = jnp.argmax(same, 1)  # number of the first member of the cluster
    _, turn = jnp.linalg.eigh(change + spread * jnp.diag(group.astype(float)))
    x = x @ turn
    rate = jnp.einsum("im,ij,jm->m", x, dk, x) - value * jnp.einsum("im,ij,jm->m", x, dm, x)

    def outside(v, lam, dlam, own):
        """The part of x' that is M-orthogonal to the cluster, from a bordered system."""
        span = x * own
        matrix = k - lam * m + (m @ span) @ (m @ span).T * (1 + jnp.abs(lam))
        rhs = -(dk - lam * dm - dlam * m) @ v
        rhs = rhs - (m @ span) @ (span.T @ rhs)
        y = jnp.linalg.solve(matrix, rhs)
        return y - span @ (span.T @ (m @ y))

    out = jax.vmap(outside, (1, 0, 0, 0), 1)(x, value, rate, same.astype(float))
    gap = rate[None, :] - rate[:, None]  # lambda'_j - lambda'_i for column j
    apart = same & (jnp.abs(gap) > 1e-9 * (jnp.max(jnp.abs(rate)) + 1e-300))
    # Second-order balance inside the cluster: x_i^T (P'' x_j + 2 P' x_j') = 2 lambda'_j-terms.
    second = x.T @ ddk @ x - value * (x.T @ ddm @ x) - 2 * rate * (x.T @ dm @ x)
    second += 2 * (x.T @ dk @ out - value * (x.T @ dm @ out))
    norm = jnp.where(same, -0.5 * (x.T @ dm @ x), 0.0)
    dx = out + x @ jnp.where(apart, second / jnp.where(apart, 2 * gap, 1.0), norm)

    layout = layout_of(model)
    as_shape = lambda v: v.T.reshape(count, layout.n, model.dof)  # noqa: E731
    good = admissible(model)
    value, rate = (jnp.where(good, number, jnp.nan) for number in (value, rate))
    modes = Modes(value, as_shape(expand @ x))
    return ModeDerivatives(modes, rate, as_shape(expand @ dx + dexpand @ x))
