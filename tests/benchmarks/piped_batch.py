"""A batch of machines behind pipes of many lengths: how they end, and its time beside single ones.

    python tests/benchmarks/piped_batch.py [COUNT]

Suction pipes of 0.3 to 6 m, 50 mm wide, at 1450 rpm, within `jit` in batches of 32. Figures are ratios of
one run, since other programs run beside.
"""

import sys
import time
from collections import Counter
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from reference_pipes import SPEED, crank, cylinder, suction_pipe

from jaxcomp import Status
from jaxcomp._core.status import names_of_codes
from jaxcomp.cylinder import solve_cycle

# Designs that are solved side by side.
BATCH = 32


def outcome(length):
    """Flow, efficiency and status behind a pipe of a length [m]."""
    cycle = solve_cycle(cylinder(suction_pipe(length)), crank(), jnp.asarray(SPEED), throw=False)
    return cycle.volumetric_efficiency, cycle.pulsation.largest, cycle.status


def seconds_of(function, *arguments) -> float:
    """Time of a call whose program is there."""
    begin = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - begin


def main(count: int) -> None:
    """Solve them in batches and one after the other."""
    lengths = jnp.linspace(0.3, 6.0, count)
    batch = jax.jit(lambda lengths: jax.lax.map(outcome, lengths, batch_size=BATCH))
    single = jax.jit(outcome)
    efficiency, largest, status = batch(lengths)
    names = [str(name) for name in names_of_codes(np.asarray(status._value))]
    is_solved = np.asarray(status == Status.converged)
    print(f"{count} lengths: {dict(Counter(names))}")
    print(f"volumetric efficiency {np.min(efficiency[is_solved]):.4f} to {np.max(efficiency):.4f}")
    print(f"pulsation at the flange up to {np.max(largest[is_solved]):.1%}")
    alone = [single(length)[0] for length in lengths]
    difference = np.abs(np.array(alone) - np.asarray(efficiency))[is_solved]
    print(f"alone and in a batch within {np.max(difference):.1e}")
    of_batch = min(seconds_of(batch, lengths) for _ in range(2))
    of_each = min(sum(seconds_of(single, length) for length in lengths) for _ in range(2))
    print(f"{1e3 * of_batch / count:.1f} ms each in batches, {1e3 * of_each / count:.1f} ms alone")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 256)
