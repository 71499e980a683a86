"""Time and error of the periodic orbit: one design, batches, gradients, beside SciPy.

Run `python tests/benchmarks/orbit.py [--devices 2] [--quick]`. Every line shows a time with the
error measured beside it; compile times are listed apart. Times are medians of repeated warm calls.
"""

import argparse
import os
import sys
import time
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--devices", type=int, default=1, help="host devices that share a batch")
parser.add_argument("--quick", action="store_true", help="fewer settings and repetitions")
parser.add_argument("--no-scipy", action="store_true")
options = parser.parse_args()
if options.devices > 1:
    flag = f"--xla_force_host_platform_device_count={options.devices}"
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " " + flag
sys.path.insert(0, str(Path(__file__).parents[1]))

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import reference  # noqa: E402
import scipy  # noqa: E402

from jaxcomp import Collocation, Shooting, scene, solve_orbit  # noqa: E402
from jaxcomp.cli._start import quick_compiles  # noqa: E402

quick_compiles()  # as the command line starts JAX

REPEAT = 5 if options.quick else 25
SCATTER = 0.05  # of every parameter in a batch


def efficiency(compressor, solver):
    return solve_orbit(compressor, solver, throw=False).mechanical_efficiency


def compiled(function, *example):
    start = time.perf_counter()
    program = jax.jit(function).lower(*example).compile()
    return program, time.perf_counter() - start


def median_time(function, *arguments, repeat=REPEAT):
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def line(name, *columns):
    print(f"{name:58s}" + "".join(f"{c:>16s}" for c in columns), flush=True)


def heading(title, *columns):
    print()
    line(title, *columns)


def scattered(compressor, count, seed=0):
    """Designs around one: every nonzero parameter off by a few per cent."""
    rng = np.random.default_rng(seed)
    leaves, shape = jax.tree.flatten(compressor)
    off = [jnp.asarray(1 + SCATTER * rng.uniform(-1, 1, (count, *leaf.shape))) for leaf in leaves]
    return jax.tree.unflatten(shape, [leaf * o for leaf, o in zip(leaves, off, strict=True)])


def single_design(machine, exact):
    heading("One design", "median", "error in eta", "compile")
    best, shot = None, None
    settings = [
        Collocation(nodes=8, reversals=0, tolerance=1e-7),
        Collocation(nodes=24, reversals=0, tolerance=1e-7),
        Collocation(nodes=32, reversals=0, tolerance=1e-7),
        Collocation(nodes=6, tolerance=1e-8),
        Collocation(nodes=8, tolerance=1e-8),
        Collocation(nodes=16),
        Shooting(tolerance=1e-5),
        Shooting(),
        Shooting(solver=diffrax.Dopri8(), tolerance=1e-9),
    ]
    for solver in settings[:: 3 if options.quick else 1]:
        program, cost = compiled(lambda c, solver=solver: efficiency(c, solver), machine)
        error = abs(float(program(machine)) - exact)
        seconds = median_time(program, machine)
        line(label(solver), f"{seconds * 1e3:.3f} ms", f"{error:.1e}", f"{cost:.1f} s")
        if error < 1e-6:
            if isinstance(solver, Collocation) and (best is None or seconds < best[0]):
                best = seconds, solver
            if isinstance(solver, Shooting) and (shot is None or seconds < shot[0]):
                shot = seconds, solver
    return best, shot


def label(solver):
    if isinstance(solver, Collocation):
        places = f"nodes={solver.nodes} reversals={solver.reversals}"
        return f"collocation {places} tolerance={solver.tolerance:g}"
    return f"shooting {type(solver.solver).__name__} tolerance={solver.tolerance:g}"


def batches(machine):
    count = 4096 if options.quick else 16384
    designs = scattered(machine, count)
    sample = jax.tree.map(lambda x: x[:64], designs)
    fine, cost = compiled(jax.vmap(lambda c: efficiency(c, Collocation(nodes=16))), sample)
    exact = np.asarray(fine(sample))
    heading(
        f"{count} designs, {options.devices} device(s)",
        "designs/s",
        "median error",
        "worst error",
        "compile",
    )
    best = 0.0
    settings = [(5, 1e-5), (8, 1e-5), (10, 1e-5), (12, 1e-5), (16, 1e-6)]
    for nodes, tolerance in settings[:: 2 if options.quick else 1]:
        solver = Collocation(nodes=nodes, reversals=0, tolerance=tolerance)
        for chunk in (64, 512) if options.quick else (64, 512, 2048):
            one = lambda c, solver=solver: efficiency(c, solver)  # noqa: E731

            def many(batch, one=one, chunk=chunk):
                return jax.lax.map(one, batch, batch_size=chunk)

            start = time.perf_counter()
            if options.devices > 1:
                split = jax.tree.map(
                    lambda x: x.reshape(options.devices, -1, *x.shape[1:]), designs
                )
                program = jax.pmap(many)
                arguments = split
                jax.block_until_ready(program(arguments))
            else:
                program, arguments = jax.jit(many).lower(designs).compile(), designs
            cost = time.perf_counter() - start
            seconds = median_time(program, arguments, repeat=3)
            errors = np.abs(np.asarray(program(arguments)).ravel()[:64] - exact)
            error = np.max(errors)
            rate = count / seconds
            name = f"{label(solver)} in chunks of {chunk}"
            line(name, f"{rate:,.0f}", f"{np.median(errors):.1e}", f"{error:.1e}", f"{cost:.1f} s")
            if np.median(errors) < 1e-5:
                best = max(best, rate)
    print(f"{'best with a median error below 1e-5':58s}{best:>16,.0f}")


def gradients(machine, solvers):
    heading("Value and gradient over all parameters", "median", "over value", "compile")
    numbers = sum(x.size for x in jax.tree.leaves(machine))
    print(f"({numbers} parameters)")
    for solver in solvers:
        value, _ = compiled(lambda c, solver=solver: efficiency(c, solver), machine)
        both, cost = compiled(
            jax.value_and_grad(lambda c, solver=solver: efficiency(c, solver)), machine
        )
        seconds, alone = median_time(both, machine), median_time(value, machine)
        line(label(solver), f"{seconds * 1e3:.3f} ms", f"{seconds / alone:.2f}", f"{cost:.1f} s")


def plain_scipy(machine, exact, ours):
    """The same equations, orbit and accounts with NumPy and `solve_ivp`."""
    heading("SciPy solve_ivp, the same equations", "time", "error in eta", "over collocation")
    twin = reference.from_compressor(machine)
    mean = float(machine.motor.mean_speed)
    shape = machine.motor.shape
    motor = lambda speed, level: (  # noqa: E731
        level * speed / mean if shape == "proportional" else level
    )
    for rtol in (1e-7,) if options.quick else (1e-7, 1e-10):
        start = time.perf_counter()
        turn = reference.orbit(twin, motor, mean, rtol=rtol)
        seconds = time.perf_counter() - start
        error = abs(turn.efficiency - exact)
        line(f"DOP853 rtol={rtol:g}", f"{seconds:.2f} s", f"{error:.1e}", f"{seconds / ours:,.0f}")


def main():
    print(
        f"jax {jax.__version__}, diffrax {diffrax.__version__}, scipy {scipy.__version__}, ", end=""
    )
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    machine = scene.load("mayekawa-wbhe").compressor
    finest = Collocation(nodes=24)
    exact = float(solve_orbit(machine, finest, throw=False).mechanical_efficiency)
    print(f"eta of the Mayekawa machine, {label(finest)}: {exact:.12f}")
    best, shot = single_design(machine, exact)
    batches(machine)
    chosen = [s for _, s in filter(None, (best, shot))]
    gradients(machine, chosen)
    if best and not options.no_scipy:
        plain_scipy(machine, exact, best[0])
    if best and shot:
        print()
        line("collocation, one design to 1e-6", f"{best[0] * 1e3:.3f} ms")
        line("shooting, one design to 1e-6", f"{shot[0] * 1e3:.3f} ms")


if __name__ == "__main__":
    main()
