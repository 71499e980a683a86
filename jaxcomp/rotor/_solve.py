r"""Solution of Z x = f with evidence, and its derivatives by the adjoint.

The factorisation only has to be good, not perfect: one or two steps of iterative refinement with the
element-by-element product of `_operator` remove what an elimination without global pivoting loses.
The last correction bounds the error. Derivatives come from the solve itself: dx = Z^{-1}(df - dZ x)
forwards, and one solve with the transposed Z backwards; the factorisation is not differentiated.
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from .._core.errors import BadInput
from ._blocks import from_parts, in_parts, lu_factor, lu_solve
from ._elimination import factorise, solve_factored
from ._operator import Operator, apply, dense, scale

Solver = Literal["structured", "dense"]
STATUS_WORDS = (
    "ok", "singular", "inaccurate", "not finite", "out of bounds", "without a periodic state",
)  # fmt: skip
OK, SINGULAR, INACCURATE, NOT_FINITE, OUT_OF_BOUNDS = range(5)
NO_CRANK = 5  # by itself, for the pages of the reference

# A relative correction beyond these after refinement means that fewer than seven (three) digits
# hold. The amplification is the ratio of response to load with Z scaled to a unit diagonal: at
# 1e13 a rounding of the data moves the answer by a per mille.
INACCURATE_CORRECTION = 1e-7
SINGULAR_CORRECTION = 1e-3
SINGULAR_AMPLIFICATION = 1e13
# Refinement ends once a correction is below the root of the rounding: the error contracts by this
# ratio or better in every step. Two steps are enough for any system that is not reported as singular.
_SMALL_CORRECTION = 1e-8
_STEPS = 3


class Solution(NamedTuple):
    """Motion, with the figures that tell how far it can be relied on.

    Attributes:
        x: [m], [rad] (n, planes, 2, *speeds), slaved nodes not yet filled in.
        correction: [-] relative size of the last correction: the relative error left before it.
        amplification: [-] scaled response over scaled load, a lower bound of the condition number.
        status: number of the word in `STATUS_WORDS`.
    """

    x: Array
    correction: Array
    amplification: Array
    status: Array


def make_solver(z: Operator, solver: Solver = "structured"):
    """Factorise Z once and return the function that solves for one load (n, planes, 2).

    Modal damping makes the matrix full, so that "structured" stands for "dense" there.

    Raises:
        BadInput: an unknown solver.
    """
    if solver not in ("structured", "dense"):
        raise BadInput("solver", solver, "one of ('structured', 'dense')")
    frozen = jax.tree.map(_frozen, z)
    # Motions times this, and loads over it, have one unit: metres and radians become comparable.
    weight = jnp.sqrt(scale(frozen))
    if solver == "dense" or z.system.modal is not None:
        base = _dense_solver(frozen, weight)
    else:
        factor = factorise(frozen)

        def base(b, transpose):
            return solve_factored(z.system.layout, factor, b, transpose=transpose)

    def refined(b, transpose):
        return _refined(frozen, base, weight, b, transpose)

    def forward(_, b):
        x, correction = refined(from_parts(b), False)
        return in_parts(x), correction

    def backward(_, b):
        # In real and imaginary parts the transpose of Z is that of its conjugate.
        x, correction = refined(from_parts(b).conj(), True)
        return in_parts(x.conj()), correction

    def solve(load: Complex[Array, "n p 2 *speeds"]) -> Solution:
        # In parts, because a checkpoint of JAX keeps no complex numbers.
        x, correction = jax.lax.custom_linear_solve(
            lambda x: in_parts(apply(z, from_parts(x), differentiated=True)),
            in_parts(load.astype(complex)),
            forward,
            backward,
            has_aux=True,
        )
        x = from_parts(x)
        correction, motion, load_value = jax.lax.stop_gradient((correction, x, load))
        # not a quotient of the load, because XLA would divide complex numbers
        amplification = _ratio(_size(weight * motion), _size(load_value * (1 / weight)))
        status = _status(motion, correction, amplification)
        outside = jnp.logical_not(z.system.admissible) & (status != NOT_FINITE)
        status = jnp.where(outside, OUT_OF_BOUNDS, status)
        return Solution(x, correction, amplification, status)

    return solve


def _refined(z, base, weight, b, transpose):
    """Solution of Z x = b and the relative size of its last correction."""

    def residual(x, count):
        # the first step starts from zero, where nothing has to be subtracted
        return jax.lax.cond(
            count == 0, lambda x: b, lambda x: b - apply(z, x, transpose=transpose), x
        )

    def step(state):
        x, correction, count = state
        change = base(residual(x, count), transpose)
        refined = x + change
        relative = _ratio(_size(weight * change), _size(weight * refined))
        if correction.ndim:
            # a speed that needs no further step keeps its motion while others go on
            ends = correction <= _SMALL_CORRECTION
            refined = jnp.where(ends, x, refined)
            relative = jnp.where(ends, correction, relative)
        return refined, relative, count + 1

    def goes_on(state):
        _, correction, count = state
        return (correction > _SMALL_CORRECTION).any() & (count < _STEPS)

    # From zero, so that the first step is the plain solution and the later ones refine it.
    start = jnp.zeros_like(b), jnp.ones_like(weight[0, 0, 0]), 0
    return jax.lax.while_loop(goes_on, step, start)[:2]


def _size(x):
    return jnp.sqrt(jnp.sum(x.real**2 + x.imag**2, (0, 1, 2)))


def status_words(status: Int[Array, "*batch"]) -> list | str:
    """The words behind status numbers, in nested lists of the same shape."""
    if jnp.ndim(status) == 0:
        return STATUS_WORDS[int(status)]
    return [status_words(s) for s in status]


def _status(x, correction, amplification) -> Int[Array, "*speeds"]:
    word = jnp.where(correction > INACCURATE_CORRECTION, INACCURATE, OK)
    bad = (correction > SINGULAR_CORRECTION) | (amplification > SINGULAR_AMPLIFICATION)
    word = jnp.where(bad, SINGULAR, word)
    finite = (
        jnp.all(jnp.isfinite(x), (0, 1, 2)) & jnp.isfinite(correction) & jnp.isfinite(amplification)
    )
    return jnp.where(finite, word, NOT_FINITE)


def _ratio(a: Float[Array, "*speeds"], b: Float[Array, "*speeds"]) -> Float[Array, "*speeds"]:
    # No load has no response: 0/0 counts as zero, since a NaN would make the status "not finite".
    return jnp.where(a == 0, 0.0, a / jnp.where(b == 0, 1.0, b))


def _frozen(leaf):
    # The law of a link may hold anything, which `stop_gradient` would not take.
    return jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf


def _dense_solver(z, weight):
    # of a unit diagonal, as the structured solver has its border
    d = 1 / weight.reshape(-1)
    lu = lu_factor(d[:, None] * dense(z) * d)

    def solve(b, transpose):
        return (d * lu_solve(lu, (d * b.reshape(-1))[:, None], transpose)[:, 0]).reshape(b.shape)

    return solve
