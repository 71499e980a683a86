"""Cost of several cylinders: `python tests/benchmarks/cylinders.py`.

The golden machine of `tests/crank/test_several_cylinders.py` with 1, 2, 4 and 8 cylinders: error against
run time of single orbits, first call, gradient over value, and designs in step. Times are processor
times, the least of several calls; read them as ratios.

`--slopes` prints the errors of values and derivatives of the default instead: those of efficiency and
torque fluctuation of machines of two to eight cylinders, against more nodes. A
derivative, d ln(result)/d ln(number) or per radian of an angle, is relative to the largest one of all
numbers.
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from crank.test_newton_euler import CASES
from crank.test_several_cylinders import GOLDEN, LAYOUTS, several
from helpers import named_leaves

from jaxcomp import Collocation, load, solve_orbit
from jaxcomp.crank._collocation import default_collocation

# Panels of many designs, and all that the kinks make where they coincide.
PANELS = {1: 7, 2: 11, 4: 14, 8: 24}


# 36 panels that do not end at load reversals.
UNLOCATED = Collocation(reversals=0, panel_count=36)
# Machines of `--slopes`: bundled ones, and those of `tests/crank/test_newton_euler.py`.
SLOPES = ("refrigeration-twin", "boxer with unequal throws", "mayekawa-4wbhe",
          "radial five with offset", "W60x2", "mayekawa-6wbhe", "mayekawa-8wbhe")  # fmt: skip
# Their torque has several equal maxima: which of them a derivative follows is rounding.
SYMMETRIC = ("refrigeration-twin", "mayekawa-4wbhe", "mayekawa-6wbhe", "mayekawa-8wbhe")


def settings(made):
    fast = {"reversals": 0, "panel_count": PANELS[made.crankshaft.count], "estimate": False}
    yield "4 nodes, coarse", Collocation(nodes=4, tolerance=1e-3, **fast)
    yield "5 nodes, coarse", Collocation(nodes=5, tolerance=1e-3, **fast)
    yield "default", default_collocation(made)
    yield "not located", UNLOCATED
    yield "located", Collocation(reversals=made.load_reversals)
    # as a single cylinder is solved
    yield "followed", Collocation(reversals=made.load_reversals, grading=3, follow=True)


def least(function, *arguments, calls: int = 20) -> float:
    """[s] Processor time of a call."""
    jax.block_until_ready(function(*arguments))
    best = np.inf
    for _ in range(calls):
        start = time.process_time()
        jax.block_until_ready(function(*arguments))
        best = min(best, time.process_time() - start)
    return best


def machine_named(name):
    """A machine of `SLOPES`."""
    if name not in CASES:
        return load(name).as_compressor()
    throws, lists = CASES[name]
    made = several(throws)
    return dataclasses.replace(made, mechanism=dataclasses.replace(made.mechanism, **lists))


def with_slopes(made, solver):
    """Efficiency and torque fluctuation, and their relative derivatives (2, numbers)."""
    numbers, rest = eqx.partition(made, eqx.is_inexact_array)

    def results(numbers):
        orbit = solve_orbit(eqx.combine(numbers, rest), solver, throw=False)
        values = jnp.stack([orbit.mechanical_efficiency, orbit.torque_fluctuation])
        return jnp.log(values), values

    slopes, values = jax.jit(jax.jacrev(results, has_aux=True))(numbers)
    scaled = [
        np.reshape(slope * (1.0 if name.endswith(("angle", "banks")) else number), (2, -1))
        for (name, slope), number in zip(
            named_leaves(slopes).items(), jax.tree.leaves(numbers), strict=True
        )
    ]
    return np.asarray(values), np.concatenate(scaled, axis=1)


def errors(made, solver, reference):
    """Relative errors of both values, and of their derivatives over the largest."""
    (values, slopes), (true, steep) = with_slopes(made, solver), reference
    largest = np.max(np.abs(steep), axis=1)
    return np.abs(values / true - 1), np.max(np.abs(slopes - steep), axis=1) / largest


def reference_of(made):
    """Values and derivatives with more nodes."""
    nodes = 12 if made.crankshaft.count < 4 else 9
    return with_slopes(made, Collocation(nodes, made.load_reversals, 1, follow=False))


def slopes_table(names) -> None:
    """Errors of the default, and of panels that do not end at load reversals."""
    print("| machine | solver | efficiency | its derivatives | fluctuation | its derivatives |")
    print("|---|---|---|---|---|---|")
    for name in names:
        made = machine_named(name)
        reference = reference_of(made)
        solvers = {"default": default_collocation(made), "not located": UNLOCATED}
        for solver, options in solvers.items():
            value, slope = errors(made, options, reference)
            own = "-" if name in SYMMETRIC else f"{slope[1]:.0e}"
            print(
                f"| {name} | {solver} | {value[0]:.0e} | {slope[0]:.0e} | {value[1]:.0e} | {own} |",
                flush=True,
            )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--designs", type=int, default=64, help="of a batch")
    options.add_argument("--width", type=int, default=8, help="designs in step")
    options.add_argument("--cylinders", type=int, nargs="*", default=list(GOLDEN))
    options.add_argument("--settings", nargs="*", help="names of those to measure, for all")
    options.add_argument("--slopes", nargs="*", metavar="MACHINE", help="errors of derivatives")
    given = options.parse_args()
    if given.slopes is not None:
        slopes_table(given.slopes or SLOPES)
        return
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
            if given.settings and name not in given.settings:
                continue

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
