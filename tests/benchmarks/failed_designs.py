"""Share of ordinary designs that do not converge, and the time of a million.

Run `python tests/benchmarks/failed_designs.py [--designs 1000000] [--seed 5]`. The machine is that of
Tsuji et al. (2012) over bore, speed, pressures and coefficients of friction, all well within what such
machines have, so that nothing stalls or locks: each design has to converge. Those that do not are
printed with their status, ready for `jaxcomp run mayekawa-wbhe --set ...`.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from crank.test_many_designs import RANGES

from jaxcomp import load, sweep
from jaxcomp.study.sweep import uniform
from jaxcomp.study.sweep._store import status_words


def solved(designs: int, seed: int):
    """The sweep, without writing it."""
    over = {name: uniform(*ends) for name, ends in RANGES.items()}
    asked = ["mechanical_efficiency"]
    return sweep(
        load("mayekawa-wbhe"), over, asked, samples=designs, seed=seed, devices=1, progress=False
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    solved(32, 0)  # compiles
    start, used = time.perf_counter(), time.process_time()
    found = solved(given.designs, given.seed)
    took, used = time.perf_counter() - start, time.process_time() - used
    failed = np.flatnonzero(~found.ok.values)
    print(f"{failed.size} of {given.designs:,} designs failed, {failed.size / given.designs:.1e}")
    print(f"{took:.0f} s, {used:.0f} s of processor time, {given.designs / took:,.0f} designs/s")
    words = status_words(found)
    for place in failed[:20]:
        values = (f"{name}={float(found[name][place])!r}" for name in RANGES)
        print(words[place], *values)
    raise SystemExit(bool(failed.size))


if __name__ == "__main__":
    main()
