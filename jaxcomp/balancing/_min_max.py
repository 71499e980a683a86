r"""The balance whose largest weighted vibration is smallest.

Lawson's method (C. L. Lawson 1961, Contributions to the theory of linear least maximum approximation,
thesis, University of California): least squares with row weights $\lambda_k$, $\sum\lambda_k = 1$,
which grow where the vibration is large. The weights are the multipliers of the dual problem, so that
every step carries its own proof: for any of them

$$\Big(\min_B \sum_k \lambda_k |r_k|^2\Big)^{1/2} \le \min_B \max_k |r_k| \le \max_k |r_k| .$$
"""

import jax.numpy as jnp
from jax import lax

from .._status import Status
from ._balance import Balance, balance
from ._influence import Influence


def min_max(influence: Influence, *, tolerance: float = 1e-6, max_steps: int = 20_000) -> Balance:
    """The least largest weighted vibration.

    Args:
        influence: the system.
        tolerance: [-] of the gap between the two sides of the proof, over the upper one.
        max_steps: after which to stop; the gap shows what was reached.
    """
    matrix, initial = influence.weighted
    scale = jnp.maximum(jnp.max(jnp.abs(initial)), 1e-300)
    rows = initial.size

    def solve(share):
        root = jnp.sqrt(share)
        solution = jnp.linalg.lstsq(root[:, None] * matrix, -root * initial / scale, rcond=1e-13)[0]
        rest = jnp.abs(matrix @ solution + initial / scale)
        return solution, rest, jnp.sqrt(jnp.sum(share * rest**2))

    def going_on(carry):
        _, _, highest, lowest, steps = carry
        open_ = highest - lowest > tolerance * highest
        return open_ & (highest > 1e-12) & (steps < max_steps)

    def advance(carry):
        share, best, highest, lowest, steps = carry
        solution, rest, below = solve(share)
        top = jnp.max(rest)
        best = jnp.where(top < highest, solution, best)
        # A row that ever gets no weight never gets any again: a trace of it stays.
        grown = jnp.maximum(share * rest, 1e-14 * top / rows)
        grown = grown / jnp.sum(grown)
        return grown, best, jnp.minimum(highest, top), jnp.maximum(lowest, below), steps + 1

    even = jnp.full(rows, 1.0 / rows)
    nothing = jnp.zeros(matrix.shape[1], complex)
    start = (even, nothing, jnp.asarray(1.0), jnp.asarray(0.0), jnp.asarray(0))
    _, best, highest, lowest, steps = lax.while_loop(going_on, advance, start)
    failure = Status.where(
        going_on((even, best, highest, lowest, jnp.minimum(steps, max_steps - 1))),
        Status.not_converged,
        Status.converged,
    )
    found = (best * scale, highest * scale, lowest * scale)
    return balance(influence, *found, "min-max", failure)
