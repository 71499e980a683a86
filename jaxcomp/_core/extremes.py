"""Larger and smaller of numbers, with derivatives that rounding cannot lose.

JAX's own `maximum`, `minimum`, `clip`, `max` and `min` find the operand that a derivative belongs to by
asking which one equals the result. Where XLA computes an operand twice, in two kernels of which one fuses
a product with a sum, it equals the result but for its last bit, and the derivative is zero or no number,
without a word (jax-ml/jax issue 40564). Here the operands are compared with each other, so that rounding
decides only between numbers that are as good as equal.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


def maximum(a: ArrayLike, b: ArrayLike) -> Array:
    """The larger of two numbers, elementwise; of equal ones the derivative is that of the first.

    Args:
        a: a number or an array.
        b: likewise, of a shape that broadcasts.
    """
    dtype = jnp.result_type(a, b)
    if not jnp.issubdtype(dtype, jnp.floating):
        return jnp.maximum(a, b)
    return _maximum(jnp.asarray(a, dtype), jnp.asarray(b, dtype))


def minimum(a: ArrayLike, b: ArrayLike) -> Array:
    """The smaller of two numbers, elementwise; of equal ones the derivative is that of the first.

    Args:
        a: a number or an array.
        b: likewise, of a shape that broadcasts.
    """
    dtype = jnp.result_type(a, b)
    if not jnp.issubdtype(dtype, jnp.floating):
        return jnp.minimum(a, b)
    return _minimum(jnp.asarray(a, dtype), jnp.asarray(b, dtype))


def clip(x: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """A number within two bounds, elementwise.

    Args:
        x: a number or an array.
        low: the lower bound.
        high: the upper bound, which decides where it is below the other.
    """
    return minimum(maximum(x, low), high)


def max_of(values: Array, axis: int | None = None) -> Array:
    """The largest of numbers; of equal ones the derivative is that of the first.

    Args:
        values: an array.
        axis: over which; over all for `None`.
    """
    if not jnp.issubdtype(values.dtype, jnp.floating):
        return jnp.max(values, axis)
    return _largest(values, axis)


def min_of(values: Array, axis: int | None = None) -> Array:
    """The smallest of numbers; of equal ones the derivative is that of the first.

    Args:
        values: an array.
        axis: over which; over all for `None`.
    """
    if not jnp.issubdtype(values.dtype, jnp.floating):
        return jnp.min(values, axis)
    return _smallest(values, axis)


@jax.custom_jvp
def _maximum(a, b):
    return jnp.maximum(a, b)


@_maximum.defjvp
def _maximum_jvp(primals, tangents):
    a, b = primals
    return _maximum(a, b), jnp.where(a >= b, *tangents)


@jax.custom_jvp
def _minimum(a, b):
    return jnp.minimum(a, b)


@_minimum.defjvp
def _minimum_jvp(primals, tangents):
    a, b = primals
    return _minimum(a, b), jnp.where(a <= b, *tangents)


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _largest(values, axis):
    return jnp.max(values, axis)


@_largest.defjvp
def _largest_jvp(axis, primals, tangents):
    (values,) = primals
    (tangent,) = tangents
    return _largest(values, axis), _at_place(tangent, jnp.argmax(values, axis), axis)


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _smallest(values, axis):
    return jnp.min(values, axis)


@_smallest.defjvp
def _smallest_jvp(axis, primals, tangents):
    (values,) = primals
    (tangent,) = tangents
    return _smallest(values, axis), _at_place(tangent, jnp.argmin(values, axis), axis)


def _at_place(tangent, place, axis: int | None):
    """The tangent at a place along an axis."""
    if axis is None:
        return tangent.ravel()[place]
    return jnp.take_along_axis(tangent, jnp.expand_dims(place, axis), axis).squeeze(axis)
