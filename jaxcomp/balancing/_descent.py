"""Balancing for any differentiable objective, by gradients."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

if TYPE_CHECKING:
    import optax


class Descent(NamedTuple):
    """How a descent ended.

    Attributes:
        correction: [kg m] (planes,)
        objective: [SI] of whatever unit the callable has.
        slope: [-] largest derivative left, times the scale over the objective.
        steps: that were made.
        converged: whether the slope fell below the tolerance.
    """

    correction: Complex[Array, " planes"]
    objective: Float[Array, ""]
    slope: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def descend(
    objective: Callable[[Complex[Array, " planes"]], Float[Array, ""]],
    start: Complex[Array, " planes"],
    scale: Float[Array, ""] | float,
    *,
    tolerance: float = 1e-9,
    max_steps: int = 2000,
    optimiser: "optax.GradientTransformation | None" = None,
) -> Descent:
    """Make an objective of the corrections small.

    Args:
        objective: real function of the complex corrections; it may hold the response of a machine,
            its efficiency, or anything else that JAX can differentiate.
        start: [kg m] (planes,)
        scale: [kg m] size of a usual correction, the unit of the steps.
        tolerance: [-] of the largest derivative times the scale, over the objective at the start.
        max_steps: after which to stop.
        optimiser: of optax; L-BFGS with a line search if absent.
    """
    import optax

    method = optax.lbfgs() if optimiser is None else optimiser
    scale = jnp.asarray(scale, float)

    def value(pair):
        return objective(scale * (pair[0] + 1j * pair[1])) / size

    begin = jnp.asarray(start, complex) / scale
    pair = jnp.stack([begin.real, begin.imag])
    size = jnp.asarray(1.0)
    first = jax.lax.stop_gradient(value(pair))
    size = jnp.where(first > 0, first, 1.0)

    def going_on(carry):
        _, _, slope, steps = carry
        return (slope > tolerance) & (steps < max_steps)

    def advance(carry):
        pair, state, _, steps = carry
        now, slope = jax.value_and_grad(value)(pair)
        if optimiser is None:
            change, state = method.update(slope, state, pair, value=now, grad=slope, value_fn=value)
        else:
            change, state = method.update(slope, state, pair)
        return pair + change, state, jnp.max(jnp.abs(slope)), steps + 1

    start_ = (pair, method.init(pair), jnp.asarray(jnp.inf), jnp.asarray(0))
    pair, _, slope, steps = jax.lax.while_loop(going_on, advance, start_)
    correction = scale * (pair[0] + 1j * pair[1])
    return Descent(correction, objective(correction), slope, steps, slope <= tolerance)
