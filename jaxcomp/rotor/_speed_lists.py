"""Lists of speeds filled up to a few lengths, so that a few compiled programs serve lists of any length.

A program is compiled for one shape. Only a call outside of `jit`, `vmap` and `grad` is filled up: within
them the shape is that of the user's own program, which padding would slow down and spare nothing.
"""

from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

_Tree = TypeVar("_Tree")


def filled_length(count: int, batch_size: int | float = np.inf) -> int:
    """Length of the list that stands for one of `count` speeds.

    Args:
        count: number of speeds, at least one.
        batch_size: speeds solved side by side; absent: all.

    Returns:
        A power of two up to one batch, then batches in a number of three binary digits.
    """
    if count <= batch_size:
        return int(min(1 << (count - 1).bit_length(), batch_size))
    # All of 2 to 8 batches, then 10, 12, 14, 16, 20: at most a quarter is added, by 4 lengths an octave.
    batches = -(-count // int(batch_size))
    step = 1 << max(batches.bit_length() - 3, 0)
    return -(-batches // step) * step * int(batch_size)


def filled(speeds: Float[Array, " n"], batch_size: int | float = np.inf) -> Float[np.ndarray, " m"]:
    """[rad/s] The speeds with the last of them repeated up to the length of `filled_length`.

    Args:
        speeds: [rad/s] (n,), not traced.
        batch_size: speeds solved side by side; absent: all.
    """
    return filled_along(speeds, filled_length(len(speeds), batch_size))


def filled_along(values: Array, length: int, axis: int = 0) -> np.ndarray:
    """Values with the last of them along an axis repeated up to a length.

    Args:
        values: not traced.
        length: along `axis`.
        axis: of the speeds.
    """
    widths = [(0, 0)] * np.ndim(values)
    widths[axis] = (0, length - np.shape(values)[axis])
    # in NumPy, because each length would be a program of its own
    return np.pad(np.asarray(values), widths, mode="edge")


@eqx.filter_jit  # one program instead of one for each field
def without_filling(result: _Tree, count: int, axis: int = 0) -> _Tree:
    """A result of filled speeds at the first `count` of them.

    Args:
        result: arrays with the speeds along `axis`.
        count: number of speeds.
        axis: of the speeds.
    """
    return jax.tree.map(lambda a: jax.lax.slice_in_dim(a, 0, count, axis=axis), result)
