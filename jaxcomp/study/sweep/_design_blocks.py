r"""Blocks of designs solved one after the other: by this process, or by the workers of a Dask cluster.

A block is cut into groups of a fixed width, and handfuls of groups go to whichever device is free.
A device works them off in a loop whose length is known only when it runs, so that its program has
one shape whatever the number of devices or designs, and rounds alike to the last bit. A program for
all devices together (`jax.shard_map`) would not: XLA compiles the same group differently for one
device and for two, and results were seen to differ by 1e-15.
"""

import pickle
import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from itertools import islice
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import SingleDeviceSharding
from jaxtyping import Bool, Float, Int

from ..._core.errors import BadInput
from ..._core.programs import keep_programs, sees_compiles
from ..._core.status import Status
from .._problem import Answer, Problem, climb_of, in_size, of_each, solves_gas
from ._points import Rows, neighbours_together

if TYPE_CHECKING:  # Dask is an optional extra
    from distributed import Client

# Widest groups whose intermediate results stay in the cache of a core; a GPU wants many at once.
_WIDTH = 32
_WIDTH_ELSEWHERE = 4096
# Groups that a device is given at a time, at most.
_LANES = 32
# Blocks that are under way at the same time, so that devices work while one is written.
_AHEAD = 2

Device: TypeAlias = Any  # a `jax.Device`, which is no type to a type checker
Values: TypeAlias = Float[np.ndarray, "designs quantities"]
# Codes of `Status` or `UNNAMED`, which tell what can be relied on: those that have converged.
Codes: TypeAlias = Int[np.ndarray, " designs"]
Ok: TypeAlias = Bool[np.ndarray, " designs"]


def default_width(problem: Problem, devices: Sequence[Device]) -> int:
    """Designs that are computed in step on one device; one where they are solved in turns anyway."""
    if solves_gas(problem):
        return 1
    if devices[0].platform == "cpu":
        return _WIDTH
    return _WIDTH_ELSEWHERE


def chosen_devices(devices: int | Sequence[Device] | None) -> list[Device]:
    """Devices of this process that share each block: so many of them, or these, or all.

    Raises:
        BadInput: none, or more than there are.
    """
    local = jax.local_devices()
    if devices is None:
        return local
    if isinstance(devices, int):
        if not 1 <= devices <= len(local):
            raise BadInput("devices", devices, f">= 1 and <= {len(local)}")
        return local[:devices]
    if not devices:
        raise BadInput("devices", "none", "at least one")
    return list(devices)


def block_program(
    problem: Problem, width: int, devices: Sequence[Device]
) -> Callable[[Rows], Callable[[], tuple[Values, Codes, Ok]]]:
    """A function that starts the work on a block and returns a function that waits for it.

    It goes from designs [SI] to a call for their quantities [SI], how they ended, and whether these can
    be relied on; NaN where not. The devices share groups of so many designs.
    """

    @cache  # compiled where a size is needed first, and used by the blocks that follow
    def program(size):
        return _program_of_one_size(in_size(problem, size), width, devices)

    def start(rows):
        climb = climb_of(problem, len(rows), by_march=True)
        sizes = iter(climb)
        size, all_rows = next(sizes)
        running = program(size)(rows)

        def wait():
            # Most designs end in the first size; the few that do not are solved again in larger ones.
            values, ok, events, status = running()
            climb.note(all_rows, events)
            for larger, subset in sizes:
                values[subset], ok[subset], events, status[subset] = program(larger)(rows[subset])()
                climb.note(subset, events)
            return np.where(ok[:, None], values, np.nan), status, ok

        return wait

    return start


def _program_of_one_size(problem: Problem, width: int, devices: Sequence[Device]):
    """Program of blocks in one size of the cycle, with what tells which designs need a larger one."""
    numbers, static = eqx.partition(problem, eqx.is_array)
    # A program on a CPU may hold the thread that started it until it ends.
    pool = ThreadPoolExecutor(len(devices), "sweep")
    free = SimpleQueue()
    for sharding in map(SingleDeviceSharding, devices):
        free.put((sharding, eqx.combine(jax.device_put(numbers, sharding), static)))

    def work(groups):
        sharding, device_problem = free.get()
        try:
            # One shape of program for any number of groups; its loop ends before the filling.
            padded = np.broadcast_to(groups[-1:], (_LANES, *groups.shape[1:])).copy()
            padded[: len(groups)] = groups
            count = np.asarray(len(groups))
            answer = _work(device_problem, *jax.device_put((padded, count), sharding))
            return [np.asarray(part)[: len(groups)] for part in answer]
        finally:
            free.put((sharding, device_problem))

    def start(rows):
        order = neighbours_together(rows, width)
        # Alike ones together, for a group takes as long as its slowest design.
        back = np.argsort(order)
        rows = rows[order]
        number = -(-len(rows) // width)
        # the last group is filled up with its last design
        padded = np.concatenate([rows, np.repeat(rows[-1:], number * width - len(rows), axis=0)])
        groups = padded.reshape(number, width, -1)
        # as few pieces as hold all groups, but one for every device if there are enough
        pieces = max(-(-number // _LANES), min(len(devices), number))
        running = [pool.submit(work, piece) for piece in np.array_split(groups, pieces)]

        def wait():
            results = [piece.result() for piece in running]
            joined = []
            for parts in zip(*results, strict=True):
                joined.append(np.concatenate(parts))
            values, *columns = joined
            in_order = [values.reshape(-1, values.shape[-1])[back]]
            for column in columns:
                in_order.append(column.ravel()[back])
            return tuple(in_order)

        return wait

    return start


@eqx.filter_jit
def _work(problem: Problem, groups, count) -> Answer:
    def step(row, answers):
        answer = of_each(problem, problem, groups[row])
        return jax.tree.map(lambda column, entry: column.at[row].set(entry), answers, answer)

    shape = groups.shape[:-1]
    unsolved = jnp.zeros(shape, bool)
    no_events = jnp.zeros(shape, int)
    codes = jnp.zeros(shape, Status.converged._value.dtype)
    # What lies beyond `count` stays as it is here, and is cut off by who called.
    empty = Answer(jnp.zeros((*shape, len(problem.quantities))), unsolved, no_events, codes)
    return jax.lax.fori_loop(0, count, step, empty)


def solved_blocks(
    problem: Problem,
    width: int,
    devices: Sequence[Device],
    client: "Client | None",
    blocks: Iterable[tuple[int, Rows]],
) -> Iterator[tuple[int, Rows, Values, Codes, Ok]]:
    """Every block with the quantities of its designs, in the order in which they are done.

    Args:
        problem: what is asked of each design.
        width: designs that a device computes in step.
        devices: of this process, without a client.
        client: of a Dask cluster whose workers solve the blocks, each on its own devices.
        blocks: numbers and designs [SI]; read as they are needed.

    Yields:
        Number, designs, quantities [SI] (NaN where a design failed), how each ended and whether it is
        solved.

    Raises:
        ConnectionError: the scheduler of the cluster was lost.
        BadInput: a worker has another version of jaxcomp or JAX.
    """
    if client is not None:
        yield from _on_cluster(problem, width, client, blocks)
        return
    start = block_program(problem, width, devices)
    waiting = deque()
    for number, rows in blocks:
        waiting.append((number, rows, start(rows)))
        # The oldest block is handed out while the devices work on those behind it.
        if len(waiting) > _AHEAD:
            number, rows, wait = waiting.popleft()
            yield number, rows, *wait()
    for number, rows, wait in waiting:
        yield number, rows, *wait()


def _on_cluster(problem, width, client, blocks):
    import cloudpickle
    from distributed import as_completed
    from distributed.client import ClosedClientError

    # With every task and not scattered once: what only a lost worker held would be lost with it.
    work = cloudpickle.dumps((problem, width))
    # workers of a script that keeps whole solutions alone keep no more: one may be its own process
    task = uuid.uuid4().hex, work, _versions(), sees_compiles()
    blocks = iter(blocks)
    under_way = {}
    waiting = as_completed()

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
            solved = future.result()
            number, rows = under_way.pop(future)
            yield number, rows, *solved
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


def _solved_by_worker(name: str, pickled: bytes, versions, keeps_all: bool, rows):
    """Quantities of a block, by a program that a worker makes once for a sweep.

    Args:
        name: of the sweep.
        pickled: problem and width.
        versions: of the caller.
        keeps_all: whether the caller keeps all programs, as the worker does then.
        rows: designs of the block [SI].
    """
    if versions != _versions():
        worker = " and JAX ".join(_versions())
        caller = " and JAX ".join(versions)
        raise BadInput(
            "client", f"one with a worker of jaxcomp {worker}", f"of workers with {caller}"
        )
    if keeps_all:
        keep_programs()
    # Or every thread of a worker would compile the program for itself.
    with _COMPILING:
        if name not in _PROGRAMS:
            _PROGRAMS.clear()
            _PROGRAMS[name] = block_program(*pickle.loads(pickled), jax.local_devices())
        start = _PROGRAMS[name]
    return start(rows)()
