"""Designs per second of the steady running state in batches, on the device that JAX has.

`python tests/benchmarks/batch_rates.py [--designs N,...]`

Designs of Tsuji et al. (2012) with bore, crank radius and speed drawn within 5 %, and their derivatives
by these three. The first call holds the compilation; the warm time is the least of three.
"""

import argparse
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import load, solve_orbit
from jaxcomp.crank import Collocation

SOLVERS = (
    Collocation(nodes=5, reversals=0, tolerance=1e-5),
    Collocation(nodes=8, reversals=0, tolerance=1e-5),
    Collocation(nodes=16, reversals=0, tolerance=1e-6),
)
MACHINE = load("mayekawa-wbhe").as_compressor()


def numbers_of(compressor):
    """The numbers that are drawn."""
    mechanism = compressor.mechanism
    return mechanism.bore, mechanism.crank_radius, compressor.motor.mean_speed


def efficiency(factors, solver):
    """Mechanical efficiency of the machine with its numbers times factors."""
    scaled = [number * factor for number, factor in zip(numbers_of(MACHINE), factors, strict=True)]
    design = eqx.tree_at(numbers_of, MACHINE, tuple(scaled))
    return solve_orbit(design, solver, throw=False).mechanical_efficiency


def seconds_of(program, factors) -> float:
    """Wall clock of a call."""
    begin = time.perf_counter()
    jax.block_until_ready(program(factors))
    return time.perf_counter() - begin


def main() -> None:
    """Time and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", default="4096,32768,262144")
    arguments = parser.parse_args()
    print(jax.devices())
    rng = np.random.default_rng(0)
    for solver in SOLVERS:

        def value(factors, solver=solver):
            return efficiency(factors, solver)

        programs = {
            "value": jax.jit(jax.vmap(value)),
            "value and gradient": jax.jit(jax.vmap(jax.value_and_grad(value))),
        }
        for count in map(int, arguments.designs.split(",")):
            factors = jnp.asarray(rng.uniform(0.95, 1.05, (count, 3)))
            for name, program in programs.items():
                first = seconds_of(program, factors)
                warm = min(seconds_of(program, factors) for _ in range(3))
                print(
                    f"{solver.nodes:2d} nodes {count:7d} designs {name:18} first {first:5.1f} s, "
                    f"warm {warm:.4f} s, {count / warm:,.0f} designs/s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
