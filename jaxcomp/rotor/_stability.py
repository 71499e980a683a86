r"""Static stability limit of the unbalanced magnetic pull."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import BadInput
from ._eigen import eigh
from ._matrices import matrices
from ._model import RotorModel


def magnetic_pull_limit(model: RotorModel, spin_speed: Float[Array, ""] = 0.0) -> Float[Array, ""]:
    r"""[-] Factor on the magnetic pull at which the model becomes statically unstable.

    The smallest s with K_0 - s K_pull singular, K_0 the symmetric stiffness without the pull: one
    over the largest eigenvalue of K_pull in the metric of K_0. Below one the model as it stands is
    unstable. Not a number if the model without magnetic pull is not held.

    Args:
        model: the model, with magnetic pull.
        spin_speed: [rad/s] at which the links are evaluated.

    Raises:
        BadInput: there is no magnetic pull.
    """
    if not model.magnetic_pulls:
        raise BadInput("magnetic_pulls", "()", "at least one magnetic pull")
    return _limit(model, jnp.asarray(spin_speed, float))


@eqx.filter_jit
def _limit(model, spin_speed):
    pulls = lambda m: [pull.stiffness for pull in m.magnetic_pulls]  # noqa: E731
    without = eqx.tree_at(pulls, model, [jnp.zeros_like(v) for v in pulls(model)])
    k0 = matrices(without, spin_speed).stiffness
    k = matrices(model, spin_speed).stiffness
    k0, pull = (k0 + k0.T) / 2, (k0 - k + (k0 - k).T) / 2
    weight = 1 / jnp.sqrt(jnp.diagonal(k0))
    low = jnp.linalg.cholesky(weight[:, None] * k0 * weight)
    half = jax.scipy.linalg.solve_triangular(low, weight[:, None] * pull * weight, lower=True)
    a = jax.scipy.linalg.solve_triangular(low, half.T, lower=True)
    return 1 / eigh((a + a.T) / 2)[0][-1]
