"""Optimisers that ask for one point at a time, run side by side on a function of many points."""

import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

Evaluate = Callable[[np.ndarray], Any]


class Stopped(Exception):
    """Another task, or the function of the points, has failed."""


def run_together(
    tasks: Sequence[Callable[[Evaluate], None]], function: Callable[[np.ndarray], Sequence[Any]]
) -> None:
    """Run tasks in threads and evaluate the points that all of them wait for in one call.

    The tasks are at the same evaluation at any time, so that the batches, and with them the results,
    do not depend on which thread is faster. `function` runs in the calling thread; what it or a task
    raises, an interrupt as well, ends all tasks and is raised here.

    Args:
        tasks: each takes the function `evaluate` of one point.
        function: of points (n, variables), with n results.
    """
    requests: queue.SimpleQueue = queue.SimpleQueue()
    replies = [queue.SimpleQueue() for _ in tasks]
    stopped = threading.Event()

    def run(number: int) -> None:
        def evaluate(point: np.ndarray):
            requests.put((number, point, None))
            reply = replies[number].get()
            if stopped.is_set():
                raise Stopped
            return reply

        try:
            tasks[number](evaluate)
        except BaseException as error:
            requests.put((number, None, error))
        else:
            requests.put((number, None, None))

    with ThreadPoolExecutor(len(tasks)) as pool:
        for number in range(len(tasks)):
            pool.submit(run, number)
        running, waiting = len(tasks), {}
        try:
            while running:
                number, point, error = requests.get()
                if error is not None:
                    raise error
                if point is None:
                    running -= 1
                else:
                    waiting[number] = point
                if waiting and len(waiting) == running:
                    numbers = sorted(waiting)
                    results = function(np.stack([waiting[number] for number in numbers]))
                    waiting.clear()
                    for number, result in zip(numbers, results, strict=True):
                        replies[number].put(result)
        finally:
            stopped.set()
            for reply in replies:
                reply.put(None)
