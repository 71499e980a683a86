"""The optimal bore by gradients beside a sweep of 0.1 mm: designs solved, times, and where they end.

    python tests/benchmarks/optimise.py             # the bore at three speeds (Tsuji et al. 2012, Fig. 6)
    python tests/benchmarks/optimise.py --tasks     # constraints, targets, several variables, a rotor

Times are warm, the best of three; the first call with its compilation stands apart. A start solves
designs with their derivative, which costs the second column of times more than a design of the sweep.
The last lines of a speed are the whole search as `jaxcomp optimise` makes it: eight starts, and a sample
of 256 designs to compare with.
"""

import argparse
import time
from collections import Counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

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


MASSES = "mechanism.piston_mass", "mechanism.conrod_mass"
UNBALANCE, ROD, INERTIA = (
    "mechanism.crank_unbalance", "mechanism.conrod_length", "mechanism.crank_inertia",
)  # fmt: skip
FLUCTUATION, FORCE = "speed_fluctuation", "peak_force.crank_pin"


def rosenbrock(found):
    mechanism = found.design.compressor.mechanism
    x, y = mechanism.piston_mass, mechanism.conrod_mass
    return 100 * (y - x**2) ** 2 + (1 - x) ** 2


def tasks():
    """Searches of several kinds: designs solved with derivatives, time, and where they end."""
    reciprocating, hermetic = load("mayekawa-wbhe"), load("hermetic-68cc")
    crank = AnalysisOptions(solver=SOLVERS["fast"])
    four = {"bore": RANGE, UNBALANCE: (-0.8, 0.0), ROD: (0.2, 0.4), INERTIA: (0.1, 0.4)}
    planes = [plane.name for plane in hermetic.parts["balancing"].planes]
    corrections = {
        f"corrections.{plane}.{axis}": (-3e-3, 3e-3) for plane in planes for axis in "xy"
    }
    efficiency = "mechanical_efficiency"
    pair = problem(
        reciprocating, {"bore": RANGE, UNBALANCE: (-0.8, 0.0)}, [efficiency, FLUCTUATION], crank
    )
    many = problem(reciprocating, four, [efficiency, FLUCTUATION, FORCE], crank)
    masses = problem(reciprocating, dict.fromkeys(MASSES, (0.0, 3.0)), [rosenbrock])
    balance = problem(hermetic, corrections, ["vibration"], AnalysisOptions(excitation="file"))
    targets = {FLUCTUATION: 0.08, FORCE: 12e3}
    least = {"method": "least-squares"}
    cases = {
        "Rosenbrock": (masses, {}),
        "efficiency by 2, 1 constraint": (pair, {"constraints": {FLUCTUATION: (None, 0.1)}}),
        "efficiency by 4": (many, {}),
        "efficiency by 4, 2 constraints": (
            many, {"constraints": {FLUCTUATION: (None, 0.08), FORCE: (None, 12e3)}},
        ),
        "efficiency by 4, 1 equality": (many, {"constraints": {FLUCTUATION: (0.08, 0.08)}}),
        "2 targets by 4": (many, {"objective": targets, **least}),
        "2 targets out of reach": (many, {"objective": {FLUCTUATION: 0.03, FORCE: 2e3}, **least}),
        "vibration by 4 corrections": (balance, {}),
    }  # fmt: skip
    line(
        "",
        "objective",
        "violation",
        "designs",
        "time, ms",
        "agree",
        widths=(34, 16, 12, 12, 12, 10),
    )
    for name, (made, options) in cases.items():
        found, warm, _ = timed(lambda made=made, options=options: optimise(made, **options))
        best = min(found.starts, key=lambda one: not one.agrees)
        ends = Counter(one.status for one in found.starts)
        line(name, f"{found.objective:.9g}", f"{best.violation:.1e}", found.evaluations,
             f"{1e3 * warm:.0f}", f"{found.agreeing} of {len(found.starts)}",
             "  " + ", ".join(f"{count} {word}" for word, count in ends.items()),
             widths=(34, 16, 12, 12, 12, 10, 0))  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", action="store_true")
    quick_compiles()  # as the command line starts JAX
    tasks() if parser.parse_args().tasks else bores()
