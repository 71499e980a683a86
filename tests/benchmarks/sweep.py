"""Designs per second, error and memory of a sweep, beside a process pool of SciPy solves.

Run `python tests/benchmarks/sweep.py [--designs 200000] [--no-memory] [--no-scipy]`. The machine is
that of Tsuji et al. (2012) over bore, speed and wall friction. Wall clock with a warm program, files
included; beside it designs per second of processor time times the cores, which other work on the
machine does not lower as much. Errors are those in efficiency, of designs spread over the sweep.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

CORES = len(os.sched_getaffinity(0))
CHECKED = 64  # designs whose error is looked at


def options():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", type=int, default=200_000)
    parser.add_argument("--no-memory", action="store_true")
    parser.add_argument("--no-scipy", action="store_true")
    parser.add_argument("--largest", type=int, default=10_000_000, help="sweep of the memory table")
    parser.add_argument("--grow", nargs=2, metavar=("QUANTITY", "DESIGNS"), help=argparse.SUPPRESS)
    return parser.parse_args()


def line(name, *columns):
    print(f"{name:46s}" + "".join(f"{c:>18s}" for c in columns), flush=True)


def heading(title, *columns):
    print()
    line(title, *columns)


def ranges():
    from jaxcomp.study.sweep import uniform

    rpm = np.pi / 30
    return {
        "bore_at_displacement": uniform(0.11, 0.15),
        "motor.mean_speed": uniform(800 * rpm, 1200 * rpm),
        "friction.wall.coefficient": uniform(0.07, 0.09),
    }


def fast(nodes=10):
    from jaxcomp import Collocation
    from jaxcomp.study import AnalysisOptions

    return AnalysisOptions(Collocation(nodes=nodes, reversals=0, tolerance=1e-5))


def errors(machine, found):
    """Against collocation with panel edges at the load reversals, which is good to 1e-9."""
    import jax

    from jaxcomp import Collocation
    from jaxcomp.study import AnalysisOptions, problem

    picks = np.linspace(0, found.sizes["sample"] - 1, CHECKED).astype(int)
    some = found.isel(sample=picks)
    names = list(ranges())
    exact = problem(
        machine, names, ["mechanical_efficiency"], AnalysisOptions(Collocation(nodes=16))
    )
    rows = np.stack([some[name].values for name in names], -1)
    best = jax.jit(lambda rows: jax.lax.map(exact, rows))(rows).values[:, 0]
    return np.abs(some.mechanical_efficiency.values - np.asarray(best)), rows, np.asarray(best)


def rates(machine, count):
    from jaxcomp import sweep

    heading(f"{count:,} designs", "designs/s", "of CPU time", "median error", "worst error")
    last = None
    with tempfile.TemporaryDirectory() as folder:
        for nodes, devices, stored in (
            (5, CORES, True),
            (8, CORES, True),
            (10, 1, True),
            (10, CORES, False),
            (10, CORES, True),
            (16, CORES, True),
        ):
            go = lambda n, out, nodes=nodes, devices=devices: sweep(  # noqa: E731
                machine, ranges(), ["mechanical_efficiency"], samples=n, options=fast(nodes),
                devices=devices, out=out, progress=False,
            )  # fmt: skip
            go(20_000, None)  # compiles for every device
            out = Path(folder) / f"{nodes}-{devices}" if stored else None
            start, used = time.perf_counter(), time.process_time()
            found = go(count, out)
            seconds, used = time.perf_counter() - start, time.process_time() - used
            error, *last = errors(machine, found)
            name = f"nodes={nodes}, {devices} device(s), {'zarr' if stored else 'in memory'}"
            line(name, f"{count / seconds:,.0f}", f"{count * devices / used:,.0f}",
                 f"{np.median(error):.1e}", f"{error.max():.1e}")  # fmt: skip
    return last


def scipy_solve(job):
    """One design by DOP853 in another process: seconds and efficiency."""
    import reference

    twin, mean, shape, rtol = job
    motor = lambda speed, level: level * speed / mean if shape == "proportional" else level  # noqa: E731
    start = time.perf_counter()
    found = reference.orbit(twin, motor, mean, rtol=rtol)
    return time.perf_counter() - start, found.efficiency


def scipy_pool(machine, rows, exact):
    """The same equations with NumPy and `solve_ivp`, a process on every core."""
    import reference

    from jaxcomp.study import problem

    asked = problem(machine, list(ranges()), ["swept_volume"])
    count = 4 * CORES
    twins = [reference.from_compressor(asked.designed(row).compressor) for row in rows[:count]]
    shape = machine.compressor.motor.shape
    heading(f"SciPy, {CORES} processes, {count} designs", "designs/s", "", "median error")
    for rtol in (1e-4, 1e-7):
        jobs = [(t, float(row[1]), shape, rtol) for t, row in zip(twins, rows, strict=False)]
        with ProcessPoolExecutor(CORES, mp_context=get_context("spawn")) as pool:
            list(pool.map(scipy_solve, jobs[:CORES]))  # starts the processes
            start = time.perf_counter()
            found = [value for _, value in pool.map(scipy_solve, jobs)]
            seconds = time.perf_counter() - start
        error = np.median(np.abs(np.array(found) - exact[:count]))
        line(f"DOP853 rtol={rtol:g}", f"{count / seconds:.2f}", "", f"{error:.1e}")


def grow(quantity, count):
    """Peak memory of this process over a sweep to a store."""
    from jaxcomp import load, sweep

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        sweep(load("mayekawa-wbhe"), ranges(), [quantity], samples=count, options=fast(5),
              out=Path(folder) / "out", progress=False)  # fmt: skip
        seconds = time.perf_counter() - start
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, seconds)


def memory(largest):
    heading("Memory, to zarr", "peak", "time with compiling")
    for quantity, most in (
        ("mechanical_efficiency", min(largest, 1_000_000)),
        ("swept_volume", largest),
    ):
        for count in (10**n for n in range(4, 10) if 10**n <= most):
            run = [sys.executable, __file__, "--grow", quantity, str(count)]
            done = subprocess.run(run, check=True, capture_output=True, text=True)
            peak, seconds = map(float, done.stdout.split())
            line(f"{quantity}, {count:,} designs", f"{peak:,.0f} MB", f"{seconds:.1f} s")


def main():
    given = options()
    import jax

    jax.config.update("jax_num_cpu_devices", CORES)
    if given.grow:
        grow(given.grow[0], int(given.grow[1]))
        return
    from jaxcomp import load

    print(f"jax {jax.__version__}, {CORES} cores, load {os.getloadavg()[0]:.1f}")
    machine = load("mayekawa-wbhe")
    rows, exact = rates(machine, given.designs)
    if not given.no_scipy:
        scipy_pool(machine, rows, exact)
    if not given.no_memory:
        memory(given.largest)


if __name__ == "__main__":
    main()
