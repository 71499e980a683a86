"""Journals that move in their films: `python tests/benchmarks/journal_orbits.py [--scipy]`.

The machine of 2012 with one crank pin in a finite film: error of the loss against run time, first call
beside that of the Coulomb machine, gradient over value, designs of a batch, and the march of SciPy.
Times are processor times, the least of several calls on one core; read them as ratios. Run it under
`taskset -c 0`.
"""

import argparse
import itertools
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1]))
from crank.test_journal_orbits import PIN, SPEED, fine_edges, pin_load
from cylinders import least

from jaxcomp import Collocation, load, solve_orbit
from jaxcomp.crank._journal_orbit import journal_orbit
from jaxcomp.film import JournalBearing
from jaxcomp.film._bearing import film_unit, squeeze_of
from jaxcomp.scene import with_value

EXACT = Collocation(nodes=16, grading=4, tolerance=1e-13)
SINGLE = {
    "8 nodes, no reversals": Collocation(nodes=8, reversals=0, tolerance=1e-6),
    "24 nodes, no reversals": Collocation(nodes=24, reversals=0, tolerance=1e-7),
    "8 nodes, 2 reversals": Collocation(nodes=8, reversals=2, tolerance=1e-8),
    "8 nodes, 3 reversals": Collocation(nodes=8, reversals=3, grading=2, tolerance=1e-8),
    "default": Collocation(),
}
BATCH = {
    "4 nodes": Collocation(nodes=4, reversals=0, tolerance=1e-3, estimate=False),
    "5 nodes": Collocation(nodes=5, reversals=0, tolerance=1e-3, estimate=False),
    "8 nodes": Collocation(nodes=8, reversals=0, tolerance=1e-4, estimate=False),
    "11 nodes": Collocation(nodes=11, reversals=0, tolerance=1e-4, estimate=False),
}


def loss_of(compressor, solver):
    numbers, rest = eqx.partition(compressor, eqx.is_inexact_array)

    def loss(p):
        orbit = solve_orbit(eqx.combine(p, rest), solver, throw=False)
        return orbit.loss_power["crank_pin"]

    return loss, numbers


def first_call(function, *arguments):
    start = time.process_time()
    program = jax.jit(function)
    value = jax.block_until_ready(program(*arguments))
    return program, value, time.process_time() - start


def scipy_march(compressor) -> None:
    """One orbit under given loads: the library's, and DOP853 over three revolutions."""
    force, bush = pin_load(compressor)
    bearing = JournalBearing(0.09, 0.045, 45e-6, 0.01, "short")
    edges = fine_edges(compressor)
    solve = jax.jit(
        lambda b: journal_orbit(b, force, SPEED, bush=bush, edges=edges).film.minimum_film
    )
    solve(bearing)
    ours = least(solve, bearing)
    film, unit = squeeze_of(bearing), film_unit(bearing)

    @jax.jit
    def rate(angle, e):
        v = film.mobility(e, force(angle[None])[:, 0] / (unit * SPEED))
        return v + 0.5 * (1 + bush(angle)) * jnp.stack([-e[1], e[0]])

    start, e = time.process_time(), np.zeros(2)
    for _, (begin, end) in itertools.product(range(3), itertools.pairwise(edges)):
        e = solve_ivp(
            lambda t, y, b=begin, a=end: np.asarray(rate(jnp.clip(t, b + 1e-12, a - 1e-12), y)),
            (begin, end), e, method="DOP853", rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
    march = time.process_time() - start
    print(f"\none journal under given loads: {1e3 * ours:.1f} ms, SciPy's march {march:.1f} s, "
          f"{march / ours:.0f} times")  # fmt: skip


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--designs", type=int, default=64, help="of a batch")
    options.add_argument("--width", type=int, default=8, help="designs in step")
    options.add_argument("--scipy", action="store_true", help="the march of SciPy as well")
    given = options.parse_args()
    plain = load("mayekawa-wbhe").as_compressor()
    moving = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN).as_compressor()
    exact = float(jax.jit(loss_of(moving, EXACT)[0])(loss_of(moving, EXACT)[1]))
    head = ("setting", "error", "time", "Coulomb", "gradient", "first call", "its gradient")
    print("{:<24}{:>9}{:>10}{:>10}{:>10}{:>16}{:>18}".format(*head))
    for name, solver in SINGLE.items():
        times, firsts, slopes = [], [], []
        error = np.nan
        for machine in (plain, moving):
            loss, numbers = loss_of(machine, solver)
            program, value, first = first_call(loss, numbers)
            slope, _, second = first_call(jax.value_and_grad(loss), numbers)
            times.append(least(program, numbers))
            slopes.append(least(slope, numbers))
            firsts.append((first, second))
            error = float(value) / exact - 1
        (a, b), (c, d) = firsts
        print(
            f"{name:<24}{error:9.0e}{1e3 * times[1]:7.2f} ms{1e3 * times[0]:7.2f} ms"
            f"{slopes[1] / times[1]:8.1f} x{c:7.1f}/{a:4.1f} s{d:10.1f}/{b:4.1f} s",
            flush=True,
        )
    rng, (_, numbers) = np.random.default_rng(0), loss_of(moving, EXACT)
    many = jax.tree.map(
        lambda x: x * (1 + 0.03 * rng.uniform(-1, 1, (given.designs,) + (1,) * x.ndim)), numbers
    )
    exact = np.asarray(jax.jit(lambda ps: jax.lax.map(loss_of(moving, EXACT)[0], ps))(many))
    for name, solver in BATCH.items():
        loss, _ = loss_of(moving, solver)
        batch = jax.jit(lambda ps, f=loss: jax.lax.map(f, ps, batch_size=given.width))
        error = np.abs(np.asarray(batch(many)) / exact - 1)
        each = least(batch, many, calls=5) / given.designs
        slope = jax.jit(
            lambda ps, f=loss: jax.lax.map(jax.value_and_grad(f), ps, batch_size=given.width)
        )
        ratio = least(slope, many, calls=5) / given.designs / each
        print(f"batch, {name}: {1e6 * each:.0f} us a design, error {np.median(error):.0e} "
              f"(worst {error.max():.0e}), gradient {ratio:.1f} times", flush=True)  # fmt: skip
    if given.scipy:
        bare = eqx.tree_at(lambda c: c.friction, plain, None, is_leaf=lambda x: x is None)
        scipy_march(bare)


if __name__ == "__main__":
    main()
