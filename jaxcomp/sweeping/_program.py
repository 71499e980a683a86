r"""One compiled program that computes a block of designs, on every device of this process.

A block is cut into groups of a fixed width, and handfuls of groups go to whichever device is free.
A device works them off in a loop whose length is known only when it runs, so that its program has
one shape whatever the number of devices or designs, and rounds alike to the last bit. A program for
all devices together (`jax.shard_map`) would not: XLA compiles the same group differently for one
device and for two, and results were seen to differ by 1e-15.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import SingleDeviceSharding
from jaxtyping import Bool, Float

from .._fields import BadInput
from ..design import Answer, Problem
from ..design._problem import of_each
from ._points import Rows, neighbours_together

# Widest groups whose intermediate results stay in the cache of a core; a GPU wants many at once.
_WIDTH = {"cpu": 32}
_WIDTH_ELSEWHERE = 4096
# Groups that a device is given at a time, at most.
_LANES = 32

Device: TypeAlias = Any  # a `jax.Device`, which is no type to a type checker
Worked: TypeAlias = Callable[
    [], tuple[Float[np.ndarray, "designs quantities"], Bool[np.ndarray, " designs"]]
]


def default_width(devices: Sequence[Device]) -> int:
    """Designs that are computed in step on one device."""
    return _WIDTH.get(devices[0].platform, _WIDTH_ELSEWHERE)


def chosen_devices(given: int | Sequence[Device] | None) -> list[Device]:
    """Devices of this process that share each block.

    Args:
        given: how many of them, or which; all if absent.

    Raises:
        BadInput: none, or more than there are.
    """
    local = jax.local_devices()
    if given is None:
        return local
    if isinstance(given, int):
        if not 1 <= given <= len(local):
            raise BadInput("devices", given, f">= 1 and <= {len(local)}")
        return local[:given]
    if not given:
        raise BadInput("devices", "none", "at least one")
    return list(given)


def block_program(
    problem: Problem, width: int, devices: Sequence[Device]
) -> Callable[[Rows], Worked]:
    """A function that starts the work on a block and returns a function that waits for it.

    Args:
        problem: what is asked of each design.
        width: designs in a group.
        devices: that share the groups.

    Returns:
        From designs [SI] to a call for their quantities [SI] and whether these can be relied on;
        NaN where not.
    """
    numbers, rest = eqx.partition(problem, eqx.is_array)
    homes = [SingleDeviceSharding(device) for device in devices]
    copies = [eqx.combine(jax.device_put(numbers, home), rest) for home in homes]
    # A program on a CPU may hold the thread that started it until it ends.
    pool = ThreadPoolExecutor(len(devices), "sweep")
    free = SimpleQueue()
    for place in range(len(devices)):
        free.put(place)

    def work(groups):
        place = free.get()
        try:
            padded = np.broadcast_to(groups[-1:], (_LANES, *groups.shape[1:])).copy()
            padded[: len(groups)] = groups
            count = np.asarray(len(groups))
            answer = _work(copies[place], *jax.device_put((padded, count), homes[place]))
            return [np.asarray(part)[: len(groups)] for part in answer]
        finally:
            free.put(place)

    def start(rows):
        order = neighbours_together(rows, width)
        back, rows = np.argsort(order), rows[order]
        number = -(-len(rows) // width)
        # the last group is filled up with its last design
        padded = np.concatenate([rows, np.repeat(rows[-1:], number * width - len(rows), axis=0)])
        groups = padded.reshape(number, width, -1)
        # as few pieces as hold all groups, but one for every device if there are enough
        pieces = max(-(-number // _LANES), min(len(devices), number))
        running = [pool.submit(work, piece) for piece in np.array_split(groups, pieces)]

        def wait():
            done = [piece.result() for piece in running]
            values, ok = (np.concatenate(parts) for parts in zip(*done, strict=True))
            values, ok = values.reshape(-1, values.shape[-1])[back], ok.ravel()[back]
            return np.where(ok[:, None], values, np.nan), ok

        return wait

    return start


@eqx.filter_jit
def _work(problem: Problem, groups, count) -> Answer:
    def step(lane, done):
        answer = of_each(problem, problem, groups[lane])
        return jax.tree.map(lambda whole, new: whole.at[lane].set(new), done, answer)

    shape = groups.shape[:-1]
    empty = Answer(jnp.zeros((*shape, len(problem.quantities))), jnp.zeros(shape, bool))
    return jax.lax.fori_loop(0, count, step, empty)
