"""Cost of several cylinders: `python tests/benchmarks/cylinders.py`.

The golden machine of `tests/crank/test_several_cylinders.py` with 1, 2, 4 and 8 cylinders: error against
run time of single orbits, first call, gradient over value, and designs in step. Times are processor
times, the least of several calls; read them as ratios.
"""

import argparse
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from crank.test_several_cylinders import GOLDEN, LAYOUTS, several

from jaxcomp import Collocation, solve_orbit
from jaxcomp.crank import default_collocation

# Panels of many designs, and all that the kinks make where they coincide.
PANELS = {1: 7, 2: 11, 4: 14, 8: 24}


def settings(made):
    fast = {"reversals": 0, "panel_count": PANELS[made.crankshaft.count], "estimate": False}
    yield "4 nodes, coarse", Collocation(nodes=4, tolerance=1e-3, **fast)
    yield "5 nodes, coarse", Collocation(nodes=5, tolerance=1e-3, **fast)
    yield "default", default_collocation(made)
    yield "located", Collocation(reversals=made.load_reversals)


def least(function, *arguments, calls: int = 20) -> float:
    """[s] Processor time of a call."""
    jax.block_until_ready(function(*arguments))
    best = np.inf
    for _ in range(calls):
        start = time.process_time()
        jax.block_until_ready(function(*arguments))
        best = min(best, time.process_time() - start)
    return best


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--designs", type=int, default=64, help="of a batch")
    options.add_argument("--width", type=int, default=8, help="designs in step")
    options.add_argument("--cylinders", type=int, nargs="*", default=list(GOLDEN))
    given = options.parse_args()
    print(
        f"{'N':>2} {'setting':<16} {'error':>8} {'first':>7} {'single':>9} {'gradient':>9} {'batch':>11}"
    )
    rng = np.random.default_rng(0)
    for count in given.cylinders:
        made = several(LAYOUTS[count])
        numbers, rest = eqx.partition(made, eqx.is_inexact_array)
        many = jax.tree.map(
            lambda x: x * (1 + 0.02 * rng.standard_normal((given.designs,) + (1,) * x.ndim)),
            numbers,
        )
        for name, solver in settings(made):

            def efficiency(p, rest=rest, solver=solver):
                return solve_orbit(eqx.combine(p, rest), solver, throw=False).mechanical_efficiency

            start = time.process_time()
            one = jax.jit(efficiency)
            error = float(one(numbers)) - GOLDEN[count][0]
            first = time.process_time() - start
            single = least(one, numbers)
            slope = least(jax.jit(jax.value_and_grad(efficiency)), numbers)
            batch = jax.jit(lambda ps, f=efficiency: jax.lax.map(f, ps, batch_size=given.width))
            each = least(batch, jax.tree.map(jnp.asarray, many), calls=5) / given.designs
            print(
                f"{count:2d} {name:<16} {error:8.0e} {first:5.1f} s {1e3 * single:6.2f} ms "
                f"{slope / single:7.1f} x {1e6 * each:8.0f} us",
                flush=True,
            )


if __name__ == "__main__":
    main()
