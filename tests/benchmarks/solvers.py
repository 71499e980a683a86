"""Solvers of the running state at equal error: `python tests/benchmarks/solvers.py [KIND ...]`.

For each kind of machine the loosest setting of every solver with which the losses (of a machine with
valves those of the crank, at the cycle found) are right to 1e-6 of themselves, with its time, warm and
for the first call. The reference is collocation with 24 nodes a panel. Processor times of one core, least
of five calls; read them as ratios. The table of notebooks/solvers.md is printed by this command.
"""

import argparse
import sys
import time

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from jaxcomp import Collocation, ConstantSpeed, Shooting, load, solve_orbit
from jaxcomp.scene import with_value

PIN = {
    "type": "film", "motion": "orbit", "film": "short", "diameter": "90 mm", "length": "45 mm",
    "radial_clearance": "45 um", "dynamic_viscosity": "10 mPa s",
}  # fmt: skip
WANTED = 1e-6
TOLERANCES = [10.0**-k for k in range(3, 11)]


def machines():
    """Kinds of machines by name."""
    one = load("mayekawa-wbhe")
    compressor = one.as_compressor()
    held = ConstantSpeed(compressor.motor.speed_guess)
    return {
        "one cylinder": lambda: compressor,
        "at a given speed": lambda: eqx.tree_at(lambda c: c.motor, compressor, held),
        "four cylinders": lambda: load("mayekawa-4wbhe").as_compressor(),
        "moving journal": lambda: with_value(one, "friction.crank_pin", PIN).as_compressor(),
        "slider-link": lambda: load("slider-link-8cc").as_compressor(),
        "valves": lambda: load("r134a-7cc").as_compressor(),
    }


def loss_of(compressor):
    """Losses over the work of the motor, of a motor of some tolerance of the solver."""

    def loss(numbers, solver):
        numbers, rest = numbers
        orbit = solve_orbit(eqx.combine(numbers, rest), solver, throw=False)
        return orbit.energy.total_loss / orbit.energy.motor_work

    return eqx.filter_jit(loss), eqx.partition(compressor, eqx.is_inexact_array)


def least(call, count=5):
    times = []
    for _ in range(count):
        begun = time.process_time()
        jax.block_until_ready(call())
        times.append(time.process_time() - begun)
        if sum(times) > 5:
            break
    return min(times)


def rows(name, compressor):
    """Rows of the table."""
    reversals = compressor.load_reversals
    loss, numbers = loss_of(compressor)
    fine = loss(numbers, Collocation(nodes=24, reversals=reversals, grading=6))
    settings = {"collocation": [Collocation(n, reversals=reversals) for n in (5, 6, 8, 12, 16)]}
    solvers = [diffrax.Tsit5(), diffrax.Dopri8()]
    if name in ("one cylinder", "moving journal"):
        solvers.append(diffrax.Kvaerno5())
    for solver in solvers:
        settings[type(solver).__name__] = [
            Shooting(solver, jnp.asarray(t), reversals=reversals, max_steps=16_384)
            for t in TOLERANCES
        ]
    for solver, series in settings.items():
        found = None
        for one in series:
            begun = time.process_time()
            error = abs(float(loss(numbers, one)) / float(fine) - 1)
            first = time.process_time() - begun
            if one is series[0]:
                compiled = first
            if error <= WANTED:
                found = one, error
                break
        if solver == "collocation":
            compiled = first
        if found is None:
            yield name, solver, "-", f"{error:.0e}", "-", f"{compiled:.0f} s"
            continue
        one, error = found
        setting = f"{one.nodes} nodes" if solver == "collocation" else f"{float(one.tolerance):.0e}"
        warm = 1e3 * least(lambda one=one: loss(numbers, one))
        yield name, solver, setting, f"{error:.0e}", f"{warm:.3g} ms", f"{compiled:.0f} s"


def main() -> int:
    kinds = machines()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", choices=[*kinds, []], default=[])
    asked = parser.parse_args().kinds or [*kinds]
    print("| machine | solver | setting | error of the losses | warm | first call |")
    print("|---|---|---|---|---|---|")
    for name in asked:
        for row in rows(name, kinds[name]()):
            print(f"| {' | '.join(row)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
