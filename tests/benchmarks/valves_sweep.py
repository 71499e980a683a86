"""Scattered designs with valves in a sweep: the share that is solved, and what hard ones cost a batch.

`python tests/benchmarks/valves_sweep.py [COUNT] [--seed N] [--batch]`

Designs of the bundled `r134a-7cc`, with ten of its numbers drawn over the whole range that users have:
300 to 6,000 rpm, pressure ratio 1.5 to 12, springs of 60 to 8,000 N/m, plates of 0.03 to 1 g, ports of 3
to 11 mm, clearance of 0.5 to 10 %. Prints how many ended in which status, the time per design, and for
those that were not solved the numbers that reproduce it. With `--batch` it compares a batch of 200
ordinary designs with the same in which every twentieth is a hard one, whose valves have more events than
the first size of the program holds.
"""

import argparse
import time
from collections import Counter

import equinox as eqx
import numpy as np

from jaxcomp import load, sweep
from jaxcomp.study.sweep import log_uniform
from jaxcomp.study.sweep._store import status_words

MACHINE = "r134a-7cc"
RPM = 2 * np.pi / 60
SUCTION = 114.8e3  # [Pa] of the machine
RANGES = {
    "motor.mean_speed": (300 * RPM, 6000 * RPM),
    "gas.clearance_ratio": (5e-3, 0.1),
    "gas.discharge.pressure": (1.5 * SUCTION, 12 * SUCTION),
    "gas.suction_valve.stiffness": (60.0, 8000.0),
    "gas.discharge_valve.stiffness": (60.0, 8000.0),
    "gas.suction_valve.mass": (3e-5, 1e-3),
    "gas.discharge_valve.mass": (3e-5, 1e-3),
    "gas.suction_valve.port_diameter": (4e-3, 11e-3),
    "gas.discharge_valve.port_diameter": (3e-3, 8e-3),
    "gas.discharge_valve.preload": (1e-6, 2e-4),
}
QUANTITIES = ["mass_flow", "gas_power", "volumetric_efficiency"]
ANSWERED = ("converged", "no_delivery", "wet")


def machine_without_liquid():
    """The machine at conditions without a liquid, which would bound the discharge pressure."""
    return eqx.tree_at(
        lambda machine: machine.compressor.gas.discharge.liquid_temperature,
        load(MACHINE).machine,
        None,
    )


def swept(samples: int, seed: int):
    """The designs, solved without writing them."""
    over = {name: log_uniform(*ends) for name, ends in RANGES.items()}
    return sweep(
        machine_without_liquid(),
        over,
        QUANTITIES,
        samples=samples,
        seed=seed,
        devices=1,
        progress=False,
    )


def share(samples: int, seed: int) -> None:
    """Print how the designs ended."""
    begin = time.perf_counter()
    found = swept(samples, seed)
    seconds = time.perf_counter() - begin
    words = np.asarray(status_words(found))
    for status, count in Counter(words.tolist()).most_common():
        print(f"{status:>20} {count:>6} {100 * count / samples:>6.1f} %")
    answered = np.isin(words, ANSWERED)
    print(
        f"answered: {100 * np.mean(answered):.1f} % of {samples}, "
        f"{1e3 * seconds / samples:.1f} ms a design, compiling counted"
    )
    for place in np.flatnonzero(~answered)[:20]:
        numbers = " ".join(f"{name}={float(found[name][place])!r}" for name in RANGES)
        print(words[place], numbers)


def batch(count: int) -> None:
    """Print what it costs that every twentieth design of a batch is hard."""
    scene = machine_without_liquid()
    # near the machine's own speed of 2,950 rpm, and where its valves swing more than ten times
    ordinary = np.linspace(2600.0, 3400.0, count)
    mixed = ordinary.copy()
    mixed[::20] = np.linspace(700.0, 900.0, len(mixed[::20]))
    seconds = {}
    for name, speeds in (("without", ordinary), ("with", mixed)):
        over = {"motor.mean_speed": speeds * RPM}

        def solve(over=over):
            return sweep(scene, over, QUANTITIES, devices=1, progress=False)

        found = solve()
        begin = time.process_time()
        found = solve()
        seconds[name] = time.process_time() - begin
        print(
            f"{name:>8} hard designs: {seconds[name]:.2f} s, {int(found.ok.sum())} of {count} solved"
        )
    print(f"ratio {seconds['with'] / seconds['without']:.2f}")


def main() -> None:
    """Sweep and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--batch", action="store_true", help="compare batches of 200")
    given = parser.parse_args()
    if given.batch:
        batch(200)
        return
    share(given.count, given.seed)


if __name__ == "__main__":
    main()
