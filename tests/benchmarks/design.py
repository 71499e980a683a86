"""Time of one design of crank and rotor together: efficiency, vibration, and both.

Run `taskset -c 0 python tests/benchmarks/design.py [MACHINE]`: on one processor, since the threads of
XLA wait for each other where others work. Times are the least and the median of repeated warm calls.
"""

import sys
import time

import jax
import numpy as np

from jaxcomp import load
from jaxcomp.study import AnalysisOptions, problem

REPEAT = 40
ASKED = {
    "efficiency": (["mechanical_efficiency"], None),
    "vibration by the forces of the file": (["vibration"], "file"),
    "vibration by the crank": (["vibration"], "crank"),
    "efficiency, vibration and its balance": (
        ["mechanical_efficiency", "vibration", "balanced_vibration"],
        "crank",
    ),
}


def main(machine: str) -> None:
    scene = load(machine)
    print(f"{machine:42s}{'least':>10s}{'median':>10s}{'first call':>12s}")
    for name, (quantities, excitation) in ASKED.items():
        one = problem(
            scene, ["mechanism.conrod_length"], quantities, AnalysisOptions(excitation=excitation)
        )
        call = jax.jit(lambda x, one=one: one(x))
        times = []
        for _ in range(REPEAT + 1):
            start = time.perf_counter()
            jax.block_until_ready(call(one.current))
            times.append(time.perf_counter() - start)
        first, *warm = times
        least, median = min(warm) * 1e3, float(np.median(warm)) * 1e3
        print(f"{name:42s}{least:7.2f} ms{median:7.2f} ms{first:10.1f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "hermetic-68cc")
