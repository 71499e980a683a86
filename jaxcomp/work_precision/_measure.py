r"""What a function costs: to compile, to run, in operations and in memory."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

# [s] A time is the median of the calls of this long, of three at least.
_WATCHED = 0.15
_LEAST = 3


class Program:
    """A compiled function, with what it took to compile it.

    Args:
        function: to be compiled.
        arguments: of one call; arrays among them may change from call to call, in their values.

    Attributes:
        seconds: [s] to trace and to compile.
        flops: operations of the compiled program by XLA's count: the body of a loop counts once,
            however often it runs.
        memory: [bytes] of its intermediate results, or `None` where the backend does not tell.
        text: the program after XLA's optimisation.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any):
        arrays, rest = eqx.partition(arguments, eqx.is_array)

        def plain(arrays):
            return function(*eqx.combine(arrays, rest))

        start = time.perf_counter()
        self._compiled = jax.jit(plain).lower(arrays).compile()
        self.seconds = time.perf_counter() - start

    def __call__(self, *arguments: Any) -> Any:
        """The result for arguments of the same shapes; what is no array is that of the first."""
        return self._compiled(eqx.filter(arguments, eqx.is_array))

    def timed(self, *arguments: Any) -> float:
        """[s] median of several calls."""
        arrays = eqx.filter(arguments, eqx.is_array)
        return median_time(lambda: self._compiled(arrays))

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


def compile_program(function: Callable[..., Any], *arguments: Any) -> Program:
    """Compile a function for the shapes of these arguments.

    Args:
        function: of pytrees; arrays in them may change from call to call, all else is fixed.
        *arguments: an example.
    """
    return Program(function, *arguments)


def median_time(call: Callable[[], Any]) -> float:
    """[s] median time of a call after a first one that does not count."""
    jax.block_until_ready(call())
    times: list[float] = []
    while len(times) < _LEAST or sum(times) < _WATCHED:
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return float(np.median(times))
