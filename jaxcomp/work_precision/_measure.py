r"""Cost of a function: to compile, to run, in operations and in memory."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

# [s] A time is the median of the calls of this long: of three at least, unless they take longer still.
_WATCHED, _LONG = 0.15, 2.0
_LEAST = 3


class Program:
    """A function compiled for the shapes of its arguments, with the cost of compiling it.

    Args:
        function: of pytrees, to be compiled.
        *arguments: an example: values of its arrays may change from call to call, all else is fixed.

    Attributes:
        seconds: [s] to trace and to compile.
        flops: operations of the compiled program by XLA's count: the body of a loop counts once,
            however often it runs.
        lines: of the program in StableHLO, before XLA's optimisation.
        memory: [bytes] of its intermediate results, or `None` where the backend does not report it.
        text: the program after XLA's optimisation.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any):
        arrays, rest = eqx.partition(arguments, eqx.is_array)

        def plain(arrays):
            return function(*eqx.combine(arrays, rest))

        start = time.perf_counter()
        lowered = jax.jit(plain).lower(arrays)
        self._compiled = lowered.compile()
        self.seconds = time.perf_counter() - start
        self.lines = lowered.as_text().count("\n")

    def __call__(self, *arguments: Any) -> Any:
        """The result for arguments of the same shapes; what is no array is that of the first."""
        return self.on(*arguments)()

    def on(self, *arguments: Any) -> Callable[[], Any]:
        """A call for these arguments."""
        arrays = eqx.filter(arguments, eqx.is_array)
        return lambda: self._compiled(arrays)

    def timed(self, *arguments: Any) -> float:
        """[s] median of several calls."""
        return median_time(self.on(*arguments))

    @property
    def flops(self) -> float:
        found = self._compiled.cost_analysis() or {}
        return float(found.get("flops", np.nan))

    @property
    def memory(self) -> int | None:
        found = self._compiled.memory_analysis()
        return None if found is None else int(found.temp_size_in_bytes)

    @property
    def text(self) -> str:
        return self._compiled.as_text() or ""


def median_time(call: Callable[[], Any]) -> float:
    """[s] median time of a call after a first one that does not count."""
    jax.block_until_ready(call())
    times: list[float] = []
    total = 0.0
    while total < _WATCHED or (len(times) < _LEAST and total < _LONG):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
        total += times[-1]
    return float(np.median(times))
