r"""Solution of Z x = f with evidence, and its derivatives by the adjoint.

The factorisation only has to be good, not perfect: two sweeps of iterative refinement with the
element-by-element product of `_system` remove what an elimination without global pivoting loses.
The last correction is the evidence. Derivatives come from the solve itself: dx = Z^{-1}(df - dZ x)
forwards, and one solve with the transposed Z backwards; the factorisation is not differentiated.
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from .._fields import BadInput
from ._structured import factorise, solve_factored
from ._system import Operator, apply, dense, scale

Solver = Literal["structured", "dense"]
STATUS_WORDS = ("ok", "singular", "inaccurate", "not finite")
OK, SINGULAR, INACCURATE, NOT_FINITE = range(4)

# A relative correction beyond these after refinement means that fewer than seven (three) digits
# hold. The amplification is the ratio of response to load with Z scaled to a unit diagonal: at
# 1e13 a rounding of the data moves the answer by a per mille.
INACCURATE_CORRECTION, SINGULAR_CORRECTION, SINGULAR_AMPLIFICATION = 1e-7, 1e-3, 1e13
_SWEEPS = 2


class Solution(NamedTuple):
    """Answer and evidence.

    Attributes:
        x: [m], [rad] (n, dof), slaved nodes not yet filled in.
        correction: [-] relative size of the last correction: the relative error left before it.
        amplification: [-] scaled response over scaled load, a lower bound of the condition number.
        status: number of the word in `STATUS_WORDS`.
    """

    x: Array
    correction: Array
    amplification: Array
    status: Array


def make_solver(z: Operator, solver: Solver = "structured"):
    """Factorise Z once and return the function that solves for one load (n, dof).

    Args:
        z: its dynamic stiffness.
        solver: "structured" or "dense"; modal damping makes the matrix full, so that "structured"
            stands for "dense" there.

    Raises:
        BadInput: an unknown solver.
    """
    if solver not in ("structured", "dense"):
        raise BadInput("solver", solver, "one of ('structured', 'dense')")
    frozen = jax.tree.map(_frozen, z)
    weight = jnp.sqrt(scale(frozen))
    if solver == "dense" or z.system.modal is not None:
        plain, transposed = _dense_solvers(frozen, weight)
    else:
        factor = factorise(frozen)
        plain = lambda b: solve_factored(z.system.layout, factor, b, transpose=False)  # noqa: E731
        transposed = lambda b: solve_factored(z.system.layout, factor, b, transpose=True)  # noqa: E731

    def refined(base):
        def run(product, b):
            x, first = base(b), None
            for _ in range(_SWEEPS):
                change = base(b - product(x))
                x = x + change
            first = _ratio(jnp.linalg.norm(weight * change), jnp.linalg.norm(weight * x))
            return x, first

        return run

    def solve(load: Complex[Array, "n dof"]) -> Solution:
        x, correction = jax.lax.custom_linear_solve(
            lambda x: apply(z, x),
            load.astype(complex),
            refined(plain),
            refined(transposed),
            has_aux=True,
        )
        correction, seen = jax.lax.stop_gradient((correction, x))
        size = jnp.linalg.norm(jax.lax.stop_gradient(load) / weight)
        amplification = _ratio(jnp.linalg.norm(weight * seen), size)
        return Solution(x, correction, amplification, _status(seen, correction, amplification))

    return solve


def status_words(status: Int[Array, "*batch"]) -> list | str:
    """The words behind status numbers, in nested lists of the same shape."""
    if jnp.ndim(status) == 0:
        return STATUS_WORDS[int(status)]
    return [status_words(s) for s in status]


def _status(x, correction, amplification) -> Int[Array, ""]:
    word = jnp.where(correction > INACCURATE_CORRECTION, INACCURATE, OK)
    bad = (correction > SINGULAR_CORRECTION) | (amplification > SINGULAR_AMPLIFICATION)
    word = jnp.where(bad, SINGULAR, word)
    finite = jnp.all(jnp.isfinite(x)) & jnp.isfinite(correction) & jnp.isfinite(amplification)
    return jnp.where(finite, word, NOT_FINITE)


def _ratio(a: Float[Array, ""], b: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.where(a == 0, 0.0, a / jnp.where(b == 0, 1.0, b))


def _frozen(leaf):
    # The law of a link may hold anything, which `stop_gradient` would not take.
    return jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf


def _dense_solvers(z, weight):
    layout = z.system.layout
    d = 1 / weight.reshape(-1)
    lu = jax.scipy.linalg.lu_factor(d[:, None] * dense(z) * d)

    def by(trans):
        def solve(b):
            x = d * jax.scipy.linalg.lu_solve(lu, d * b.reshape(-1), trans=trans)
            return x.reshape(layout.n, layout.dof)

        return solve

    return by(0), by(1)
