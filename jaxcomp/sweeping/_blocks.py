r"""Blocks of designs solved one after the other: by this process, or by the workers of a Dask cluster."""

import pickle
import threading
import uuid
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from importlib.metadata import version
from itertools import islice
from typing import TYPE_CHECKING, TypeAlias

import jax
import numpy as np
from jaxtyping import Bool, Float

from .._fields import BadInput
from ..design import Problem
from ._points import Rows
from ._program import Device, block_program

if TYPE_CHECKING:  # Dask is an optional extra
    from distributed import Client

# Blocks that are under way at the same time, so that devices work while one is written.
_AHEAD = 2
Solved: TypeAlias = tuple[
    int, Rows, Float[np.ndarray, "designs quantities"], Bool[np.ndarray, " designs"]
]


def solved_blocks(
    problem: Problem,
    width: int,
    devices: Sequence[Device],
    client: "Client | None",
    blocks: Iterable[tuple[int, Rows]],
) -> Iterator[Solved]:
    """Every block with the quantities of its designs, in the order in which they are done.

    Args:
        problem: what is asked of each design.
        width: designs that a device computes in step.
        devices: of this process, without a client.
        client: of a Dask cluster whose workers solve the blocks, each on its own devices.
        blocks: numbers and designs [SI]; read as they are needed.

    Yields:
        Number, designs, quantities [SI], NaN where a design failed, and whether it is solved.

    Raises:
        ConnectionError: the scheduler of the cluster was lost.
        BadInput: a worker has another version of jaxcomp or JAX.
    """
    if client is not None:
        yield from _on_cluster(problem, width, client, blocks)
        return
    start, waiting = block_program(problem, width, devices), deque()
    for number, rows in blocks:
        waiting.append((number, rows, start(rows)))
        if len(waiting) > _AHEAD:
            number, rows, wait = waiting.popleft()
            yield number, rows, *wait()
    for number, rows, wait in waiting:
        yield number, rows, *wait()


def _on_cluster(problem, width, client, blocks) -> Iterator[Solved]:

    import cloudpickle
    from distributed import as_completed
    from distributed.client import ClosedClientError

    # With every task and not scattered once: what only a lost worker held would be lost with it.
    task = uuid.uuid4().hex, cloudpickle.dumps((problem, width)), _versions()
    blocks, under_way, waiting = iter(blocks), {}, as_completed()

    def submit():
        # counted anew each time, for workers that have come or gone
        room = _AHEAD * max(1, sum(client.nthreads().values())) - len(under_way)
        for number, rows in islice(blocks, max(0, room)):
            future = client.submit(_solved_by_worker, *task, rows, pure=False)
            under_way[future] = number, rows
            waiting.add(future)

    lost = CancelledError, ClosedClientError, OSError
    try:
        submit()
        for future in waiting:
            values, ok = future.result()
            number, rows = under_way.pop(future)
            yield number, rows, values, ok
            submit()
    except lost as error:
        raise ConnectionError(
            f"the scheduler of {client} was lost; what was written to `out` is kept: start a scheduler "
            "with workers and call again with the same `out` to go on"
        ) from error
    finally:
        with suppress(*lost):
            client.cancel(list(under_way))


def _versions() -> tuple[str, str]:
    return version("jaxcomp"), jax.__version__


# The program of the sweep that a worker is busy with; another sweep takes its place.
_PROGRAMS = {}
_COMPILING = threading.Lock()


def _solved_by_worker(name: str, pickled: bytes, versions, rows):
    """Quantities of a block, by a program that a worker makes once for a sweep."""
    if versions != _versions():
        there, here = (" and JAX ".join(pair) for pair in (_versions(), versions))
        raise BadInput("client", f"one with a worker of jaxcomp {there}", f"of workers with {here}")
    with _COMPILING:
        if name not in _PROGRAMS:
            _PROGRAMS.clear()
            _PROGRAMS[name] = block_program(*pickle.loads(pickled), jax.local_devices())
        start = _PROGRAMS[name]
    return start(rows)()
