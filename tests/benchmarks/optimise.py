"""The optimal bore by gradients beside a sweep of 0.1 mm: designs solved, times, and where they end.

    python tests/benchmarks/optimise.py             # the bore at three speeds (Tsuji et al. 2012, Fig. 6)
    python tests/benchmarks/optimise.py --tasks     # constraints, targets, several variables, a rotor
    python tests/benchmarks/optimise.py --methods   # the same by other methods

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
import scipy.optimize

from jaxcomp import Collocation, load, optimise, pareto, problem
from jaxcomp.cli._start import quick_compiles
from jaxcomp.scene import with_value
from jaxcomp.study import AnalysisOptions

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
    return found.values["bore_at_displacement"], found.evaluations, found


def bores():
    scene = load("mayekawa-wbhe")
    for name, solver in SOLVERS.items():
        for rpm in (800, 1000, 1200):
            changed = with_value(scene, "motor.mean_speed", f"{rpm} rpm")
            made = problem(
                changed,
                {"bore_at_displacement": RANGE},
                ["mechanical_efficiency"],
                AnalysisOptions(solver=solver),
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
    "crankshaft.unbalance", "mechanism.conrod_length", "crankshaft.inertia",
)  # fmt: skip
EFFICIENCY, FLUCTUATION, FORCE = (
    "mechanical_efficiency", "speed_fluctuation", "peak_force.crank_pin",
)  # fmt: skip


def rosenbrock(found):
    mechanism = found.design.compressor.mechanism
    x, y = mechanism.piston_mass, mechanism.conrod_mass
    return 100 * (y - x**2) ** 2 + (1 - x) ** 2


def cases():
    """Problems with the options of their search, by name."""
    reciprocating, hermetic = load("mayekawa-wbhe"), load("hermetic-68cc")
    options = AnalysisOptions(solver=SOLVERS["fast"])
    planes = [plane.name for plane in hermetic.parts["balancing"].planes]
    corrections = {
        f"corrections.{plane}.{axis}": (-3e-3, 3e-3) for plane in planes for axis in "xy"
    }
    two = {"bore_at_displacement": RANGE, UNBALANCE: (-0.8, 0.0)}
    four = two | {ROD: (0.2, 0.4), INERTIA: (0.1, 0.4)}
    pair = problem(reciprocating, two, [EFFICIENCY, FLUCTUATION], options)
    many = problem(reciprocating, four, [EFFICIENCY, FLUCTUATION, FORCE], options)
    masses = problem(reciprocating, dict.fromkeys(MASSES, (0.0, 3.0)), [rosenbrock])
    balance = problem(hermetic, corrections, ["vibration"], AnalysisOptions(excitation="file"))
    smooth, kinked = {EFFICIENCY: 0.95, FLUCTUATION: 0.03}, {FLUCTUATION: 0.03, FORCE: 2e3}
    return {
        "Rosenbrock": (masses, {}),
        "efficiency by 2, 1 constraint": (pair, {"constraints": {FLUCTUATION: (None, 0.1)}}),
        "efficiency by 4": (many, {}),
        "efficiency by 4, 2 constraints": (
            many, {"constraints": {FLUCTUATION: (None, 0.05), FORCE: (None, 9.5e3)}},
        ),
        "efficiency by 4, 1 equality": (many, {"constraints": {FLUCTUATION: (0.08, 0.08)}}),
        "2 targets by 4": (many, {"objective": {FLUCTUATION: 0.08, FORCE: 12e3}}),
        "2 targets out of reach": (many, {"objective": smooth}),
        "2 targets, one of a peak": (many, {"objective": kinked}),
        "vibration by 4 corrections": (balance, {}),
    }  # fmt: skip


WIDTHS = (34, 16, 11, 9, 10, 9, 0)


def row(name, function, repeat=3):
    found, warm, _ = timed(function, repeat=repeat)
    violation = min(one.violation for one in found.starts if one.agrees)
    ends = Counter(one.status for one in found.starts)
    line(name, f"{found.objective:.9g}", f"{violation:.0e}", found.evaluations, f"{1e3 * warm:.0f}",
         f"{found.agreeing} of {len(found.starts)}",
         "  " + ", ".join(f"{count} {word}" for word, count in ends.items()), widths=WIDTHS)  # fmt: skip


def tasks():
    """Searches of several kinds: designs solved with derivatives, time, and where they end."""
    line("", "objective", "violation", "designs", "time, ms", "agree", widths=WIDTHS)
    for name, (made, options) in cases().items():
        targets = isinstance(options.get("objective"), dict)
        options = options | ({"method": "least-squares"} if targets else {})
        row(name, lambda made=made, options=options: optimise(made, **options))
    made = cases()["efficiency by 2, 1 constraint"][0]
    front, warm, _ = timed(lambda: pareto(made, (EFFICIENCY, FLUCTUATION)))
    print(f"front of {len(front.values)} points: {front.evaluations} designs, {1e3 * warm:.0f} ms, "
          f"{Counter(front.status)}, {front.beaten_by} samples better")  # fmt: skip


def other(name, **options):
    """A method of `scipy.optimize.minimize` in the place of the one that `optimise` takes."""

    def method(descent, start):
        equal = descent.goal.equalities
        limits = scipy.optimize.NonlinearConstraint(
            lambda u: descent.near(u).limits.values, np.where(equal, 0.0, -np.inf), 0.0,
            jac=lambda u: descent.near(u).limits.slope,
        )  # fmt: skip
        scipy.optimize.minimize(
            descent.value, start, jac=lambda u: descent.near(u).gradient, method=name,
            bounds=[(0, 1)] * len(start), constraints=[limits] if len(equal) else [], options=options,
        )  # fmt: skip

    return method


def methods():
    """The same searches by other methods."""
    from jaxcomp.study import _optimise

    choose = _optimise.method_of
    others = {
        "trust-constr": other("trust-constr", gtol=1e-12, xtol=1e-12),
        "L-BFGS-B": other("L-BFGS-B", ftol=0.0, gtol=0.0),
    }
    line("", "objective", "violation", "designs", "time, ms", "agree", widths=WIDTHS)
    for name, (made, options) in cases().items():
        print(name)
        named = ["slsqp"]
        named += ["adam"] if "constraints" not in options else []
        named += ["least-squares"] if "objective" in options else []
        limit = {"max_steps": 300}
        for method in named:
            own = options | limit | {"method": method}
            row(method, lambda made=made, own=own: optimise(made, **own), repeat=1)
        for method, function in others.items():
            if method == "trust-constr" or "constraints" not in options:
                _optimise.method_of = lambda *_, function=function: function
                own = options | limit
                row(method, lambda made=made, own=own: optimise(made, **own), repeat=1)
                _optimise.method_of = choose


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("--tasks", "--methods"):
        parser.add_argument(option, action="store_true")
    asked = parser.parse_args()
    quick_compiles()  # as the command line starts JAX
    (tasks if asked.tasks else methods if asked.methods else bores)()
