"""The optimal bore by gradients beside a sweep of 0.1 mm: designs solved, times, and where they end.

    python tests/benchmarks/optimise.py             # the bore at three speeds (Tsuji et al. 2012, Fig. 6)
    python tests/benchmarks/optimise.py --bounds    # how a bounded variable is best made a free one

Times are warm, the best of three; the first call with its compilation stands apart. A start solves
designs with their derivative, which costs the second column of times more than a design of the sweep.
The last lines of a speed are the whole search as `jaxcomp optimise` makes it: eight starts, and a sample
of 256 designs to compare with.
"""

import argparse
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.optimize

from jaxcomp import Collocation, load, optimise, problem
from jaxcomp.cli._start import quick_compiles
from jaxcomp.design import AnalysisOptions
from jaxcomp.scene import with_value

RANGE = (0.100, 0.160)
SWEEP = np.linspace(*RANGE, 601)  # 0.1 mm
SOLVERS = {"fast": Collocation(nodes=12, reversals=0, tolerance=1e-10), "default": None}


def timed(function, *arguments, repeat=3):
    start = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    first, times = time.perf_counter() - start, []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return result, min(times), first


def line(*columns, widths=(30, 12, 12, 12, 12, 16)):
    print("".join(f"{c!s:>{w}}" for c, w in zip(columns, widths, strict=False)), flush=True)


@eqx.filter_jit
def swept(made, bores):
    # in batches of eight as the optimiser solves them, so that times compare
    return jax.lax.map(lambda bore: made(bore[None]).values[0], bores, batch_size=8)


def descend(made, starts, samples):
    found = optimise(made, starts=starts, samples=samples)
    return found.values["bore"], found.evaluations, found


def bores():
    scene = load("mayekawa-wbhe")
    for name, solver in SOLVERS.items():
        for rpm in (800, 1000, 1200):
            changed = with_value(scene, "motor.mean_speed", f"{rpm} rpm")
            made = problem(
                changed, {"bore": RANGE}, ["mechanical_efficiency"], AnalysisOptions(solver=solver)
            )
            print(f"\n{rpm} rpm, {name} solver")
            line("", "bore, mm", "efficiency", "designs", "time, ms", "first call, s")
            values, warm, first = timed(swept, made, jnp.asarray(SWEEP))
            place = int(np.argmax(values))
            best = SWEEP[place] * 1e3
            line("sweep", f"{best:.1f}", f"{values[place]:.7f}", len(SWEEP), f"{1e3 * warm:.0f}",
                 f"{first:.1f}")  # fmt: skip
            for start in (0.100, 0.115, 0.130, 0.145, 0.160):
                (bore, count, found), warm, first = timed(descend, made, [[start]], 7)
                line(f"one start at {start * 1e3:.0f} mm (+ 8 samples)", f"{bore * 1e3:.3f}",
                     f"{found.objective:.7f}", f"{count} + 8", f"{1e3 * warm:.0f}",
                     f"{first:.1f}")  # fmt: skip
                assert abs(bore * 1e3 - best) <= 0.1
            (bore, count, found), warm, first = timed(descend, made, 8, 256)
            line("8 starts + sample", f"{bore * 1e3:.3f}", f"{found.objective:.7f}",
                 f"{count} + {len(found.sample.ok)}", f"{1e3 * warm:.0f}", f"{first:.1f}")  # fmt: skip
            print(f"{'':30}{found.agreeing} of 8 agree; {found.verdict}")


def rosenbrock(x):
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


def bowl(x):
    return jnp.sum((x - jnp.array([3.0, -0.2, 0.4])) ** 2 * jnp.array([1.0, 10.0, 3.0])) / 2


CASES = {
    "Rosenbrock, free": (rosenbrock, 2, -2.0, 2.0),
    "Rosenbrock, one bound holds": (rosenbrock, 2, -2.0, 0.5),
    "Rosenbrock of 4, one holds": (rosenbrock, 4, -1.0, 0.8),
    "bowl, two bounds hold": (bowl, 3, 0.0, 1.0),
}
COORDINATES = {
    "sigmoid": (jax.nn.sigmoid, lambda u: jnp.log(u / (1 - u))),
    "sine": (lambda t: (1 + jnp.sin(t)) / 2, lambda u: jnp.arcsin(2 * u - 1)),
}


def bounds(starts=32, tolerance=1e-6, limit=500):
    """Evaluations to a projected slope of 1e-6, median and largest of all starts."""
    line("", "", "median", "largest", "converged", widths=(30, 12, 12, 12, 12))
    for name, (function, number, low, high) in CASES.items():
        shares = np.random.default_rng(0).uniform(0.02, 0.98, (starts, number))
        scale = np.std([float(function(low + (high - low) * u)) for u in shares])
        goal = lambda u, f=function, a=low, b=high, s=scale: f(a + (b - a) * u) / s  # noqa: E731
        both = jax.jit(jax.value_and_grad(goal))
        found = [
            scipy.optimize.minimize(
                lambda u, g=both: [np.asarray(a) for a in g(u)], u, jac=True, method="L-BFGS-B",
                bounds=[(0, 1)] * number, options={"ftol": 1e-15, "gtol": tolerance},
            )
            for u in shares
        ]  # fmt: skip
        counts = [one.nfev for one in found]
        good = sum(one.success for one in found)
        line(name, "projected", np.median(counts), max(counts), f"{good} of {starts}")
        for kind, (inside, outside) in COORDINATES.items():
            solver = optx.BFGS(0.0, 0.0)

            def descent(share, goal=goal, inside=inside, outside=outside, solver=solver):
                fn = lambda t, _: (goal(inside(t)), None)  # noqa: E731
                shape = jax.ShapeDtypeStruct((), float)
                start = outside(share)
                state = solver.init(fn, start, None, {}, shape, None, frozenset())

                def going_on(carry):
                    return (carry[3] > tolerance) & (carry[2] < limit)

                def advance(carry):
                    t, state, count, _ = carry
                    t, state, _ = solver.step(fn, t, None, {}, state, frozenset())
                    u = inside(t)
                    slope = u - jnp.clip(u - jax.grad(goal)(u), 0, 1)
                    return t, state, count + 1, jnp.max(jnp.abs(slope))

                begun = (start, state, jnp.asarray(0), jnp.asarray(jnp.inf))
                return jax.lax.while_loop(going_on, advance, begun)[2:]

            counts, slope = jax.jit(jax.vmap(descent))(jnp.asarray(shares))
            good = int((slope <= tolerance).sum())
            line("", kind, np.median(counts), int(counts.max()), f"{good} of {starts}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bounds", action="store_true")
    quick_compiles()  # as the command line starts JAX
    bounds() if parser.parse_args().bounds else bores()
