"""Larger and smaller of numbers, with derivatives that rounding cannot lose.

JAX's own `maximum`, `minimum`, `clip`, `max` and `min` find the operand that a derivative belongs to by
asking which one equals the result. Where XLA computes an operand twice, in two kernels of which one fuses
a product with a sum, it equals the result but for its last bit, and the derivative is zero or no number,
without a word (jax-ml/jax issue 40564). Here the operands are compared with each other, so that rounding
decides only between numbers that are as good as equal.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


def _of_two(choose: Callable, is_first: Callable) -> Callable:
    """A choice between two numbers, whose derivative follows from their comparison."""

    @jax.custom_jvp
    def extreme(a, b):
        return choose(a, b)

    @extreme.defjvp
    def _(primals, tangents):
        # by the function itself, so that derivatives of the next order follow this rule as well
        return extreme(*primals), jnp.where(is_first(*primals), *tangents)

    # traced once for each pair of shapes: a rule traced at every call takes six times as long
    @partial(jax.jit, inline=True)
    def of_numbers(a: ArrayLike, b: ArrayLike) -> Array:
        # both of one type before the rule, whose tangents have to be of the type of the result
        dtype = jnp.result_type(a, b)
        if not jnp.issubdtype(dtype, jnp.floating):
            return choose(a, b)
        return extreme(jnp.asarray(a, dtype), jnp.asarray(b, dtype))

    return of_numbers


def _of_many(choose: Callable, place_of: Callable) -> Callable:
    """A choice among numbers along an axis, whose derivative is that of the number at its place."""

    @partial(jax.custom_jvp, nondiff_argnums=(1,))
    def extreme(values, axis):
        return choose(values, axis)

    @extreme.defjvp
    def _(axis, primals, tangents):
        (values,) = primals
        (tangent,) = tangents
        return extreme(values, axis), _at_place(tangent, place_of(values, axis), axis)

    @partial(jax.jit, inline=True, static_argnums=1)
    def of_array(values: Array, axis: int | None) -> Array:
        # integers have no derivatives; their tangents are of a type in which no place is looked up
        if not jnp.issubdtype(values.dtype, jnp.floating):
            return choose(values, axis)
        return extreme(values, axis)

    return of_array


def _at_place(tangent, place, axis: int | None):
    """The tangent at a place along an axis."""
    if axis is None:
        # without an axis the place counts through the array row by row
        return tangent.ravel()[place]
    return jnp.take_along_axis(tangent, jnp.expand_dims(place, axis), axis).squeeze(axis)


_larger = _of_two(jnp.maximum, jnp.greater_equal)
_smaller = _of_two(jnp.minimum, jnp.less_equal)
_largest = _of_many(jnp.max, jnp.argmax)
_smallest = _of_many(jnp.min, jnp.argmin)


def maximum(a: ArrayLike, b: ArrayLike) -> Array:
    """The larger of two numbers, elementwise; of equal ones the derivative is that of the first.

    Args:
        a: a number or an array.
        b: likewise, of a shape that broadcasts.
    """
    return _larger(a, b)


def minimum(a: ArrayLike, b: ArrayLike) -> Array:
    """The smaller of two numbers, elementwise; of equal ones the derivative is that of the first.

    Args:
        a: a number or an array.
        b: likewise, of a shape that broadcasts.
    """
    return _smaller(a, b)


def clip(x: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """A number within two bounds, elementwise.

    Args:
        x: a number or an array.
        low: the lower bound.
        high: the upper bound, which decides where it is below the other.
    """
    # the number first in both: on a bound the derivative is its own, and not that of the bound
    return minimum(maximum(x, low), high)


def max_of(values: Array, axis: int | None = None) -> Array:
    """The largest of numbers; of equal ones the derivative is that of the first.

    Args:
        values: an array.
        axis: over which; over all for `None`.
    """
    return _largest(values, axis)


def min_of(values: Array, axis: int | None = None) -> Array:
    """The smallest of numbers; of equal ones the derivative is that of the first.

    Args:
        values: an array.
        axis: over which; over all for `None`.
    """
    return _smallest(values, axis)
