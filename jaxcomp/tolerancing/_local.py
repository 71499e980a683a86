r"""Mean and deviation from derivatives at the mean design.

With d = x - mean(x), covariance S and y ~ y_0 + g d + d' H d / 2 (Hahn and Shapiro 1967, Statistical
Models in Engineering, ch. 7):

    mean = y_0 + tr(H S)/2,    variance = g' S g + tr(H S H S)/2 + sum_i k_i (H_ii s_i^2)^2 / 4

with s_i the deviation and k_i the excess kurtosis of variable i. The first order stops at y_0 and g' S g.
Exact for a quadratic function of symmetric independent variables, or of correlated normal ones.
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..design import Problem
from ..design._goal import solved

Curvature = Literal["differences", "exact"] | None
# Of a standard deviation: so wide that solvers' residuals do not count, and narrower than the scatter.
_STEP = 0.5
# Designs that are solved with their slopes at a time.
BATCH = 8


class Local(NamedTuple):
    """Quantities near one design.

    Attributes:
        value: [SI] (quantities,)
        slope: [SI] (quantities, variables)
        curvature: [SI] (quantities, variables, variables), or `None`.
        ok: whether all of it can be relied on.
    """

    value: Float[Array, " quantities"]
    slope: Float[Array, "quantities variables"]
    curvature: Float[Array, "quantities variables variables"] | None
    ok: bool


class Moments(NamedTuple):
    """Mean and standard deviation.

    Attributes:
        mean, deviation: [SI] (quantities,)
    """

    mean: Float[np.ndarray, " quantities"]
    deviation: Float[np.ndarray, " quantities"]


def local(problem: Problem, point, deviation, curvature: Curvature) -> Local:
    """Values, slopes and curvature at a design.

    Args:
        problem: what is asked.
        point: [SI] (variables,)
        deviation: [SI] (variables,) of the scatter, the scale of differences.
        curvature: "differences" of slopes half a deviation to both sides, "exact" by products of
            the Hessian with unit vectors (which compiles five times as long), or `None`.
    """
    if curvature != "differences":
        found = solved(problem, jnp.asarray(point)[None], BATCH)
        second, fine = (None, True) if curvature is None else _exact(problem, jnp.asarray(point))
        return Local(found.values[0], found.slope[0], second, bool(found.ok[0] & fine))
    step = _STEP * jnp.diag(deviation)
    points = jnp.concatenate([point[None], point + step, point - step])
    found = solved(problem, points, BATCH)
    ahead, behind = jnp.split(found.slope[1:], 2)
    bent = (ahead - behind) / (2 * _STEP * deviation)[:, None, None]
    bent = jnp.moveaxis(bent, 0, 2)
    return Local(
        found.values[0],
        found.slope[0],
        (bent + jnp.swapaxes(bent, 1, 2)) / 2,
        bool(jnp.all(found.ok)),
    )


def first_order(at: Local, covariance) -> Moments:
    """Moments from value and slope."""
    variance = jnp.einsum("qi,ij,qj->q", at.slope, covariance, at.slope)
    return Moments(np.asarray(at.value), np.sqrt(np.asarray(variance)))


def second_order(at: Local, covariance, excess) -> Moments:
    """Moments from value, slope and curvature.

    Args:
        at: with curvature.
        covariance: [SI] (variables, variables)
        excess: [-] (variables,) excess kurtosis.
    """
    assert at.curvature is not None
    bent = at.curvature @ covariance
    mean = at.value + jnp.trace(bent, axis1=1, axis2=2) / 2
    variance = jnp.sum(_parts(at, covariance, excess), -1)
    return Moments(np.asarray(mean), np.sqrt(np.maximum(np.asarray(variance), 0)))


def shares(at: Local, covariance, excess) -> Float[np.ndarray, "quantities variables"]:
    """[-] Share of each variable in the variance; what two have in common is split evenly.

    They sum to one. A share is negative where a correlation makes a variable take scatter away.
    """
    parts = np.asarray(_parts(at, covariance, excess))
    total = parts.sum(-1, keepdims=True)
    return np.where(total > 0, parts / np.where(total > 0, total, 1.0), 0.0)


def _parts(at: Local, covariance, excess):
    """Variance by variable, up to the order that is known."""
    parts = at.slope * (at.slope @ covariance)
    if at.curvature is None:
        return parts
    bent = at.curvature @ covariance
    alone = jnp.diagonal(at.curvature, axis1=1, axis2=2) * jnp.diagonal(covariance)
    both = jnp.diagonal(bent @ bent, axis1=1, axis2=2)
    return parts + both / 2 + excess * alone**2 / 4


@eqx.filter_jit
def _exact(problem: Problem, point) -> tuple[Array, Bool[Array, ""]]:
    def values(x):
        answer = problem(x)
        return answer.values, answer.ok

    slope = jax.jacrev(values, has_aux=True)

    def product(direction):
        _, moved, ok = jax.jvp(slope, (point,), (direction,), has_aux=True)
        return moved, ok

    bent, ok = jax.lax.map(product, jnp.eye(point.size))
    bent = jnp.moveaxis(bent, 0, 2)
    return bent, jnp.all(ok) & jnp.all(jnp.isfinite(bent))
