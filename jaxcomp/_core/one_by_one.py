"""Samples of a batch one after the other."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax

Answer = TypeVar("Answer")


def one_by_one(function: Callable[..., Answer], *arguments) -> Answer:
    """Value of a function, which a batch computes for one sample after the other.

    Within `vmap` a loop runs until the last sample has ended, and every sample pays for it. So this is
    for what takes each its own number of steps.

    Args:
        function: of all that depends on the sample; what it is closed over must not.
        arguments: trees of arrays and of what is no array.
    """
    # the rule for batches takes arrays alone; the others are closed over, as they are the same for all
    arrays, static_part = eqx.partition(arguments, eqx.is_array)

    @jax.custom_batching.sequential_vmap
    def of_sample(arrays):
        return function(*eqx.combine(arrays, static_part))

    return of_sample(arrays)
