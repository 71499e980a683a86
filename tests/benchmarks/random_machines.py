"""Random machines against another method.

`python tests/benchmarks/random_machines.py valves|journals|cylinders`

Machines with valves (every number at half to twice the golden machine's, a restitution of up to 0.5) by
collocation, their volumetric efficiency and work against the march with located events; machines whose
crank pin moves in its film, and machines of four cylinders, by collocation, efficiency and losses
against shooting with diffrax. Of every `converged` one the error must lie within what the result states:
the resolution of the cycle, the errors of efficiency and losses of the crank. Prints how many do, how
careful the statements are, and those that are wrong; exits with 1 if there are any. With `--keep FILE`
what is done stays there, batch by batch, and the same command goes on with the next one. Of one core
2,000 machines with valves take two minutes, with journals ten.
"""

import argparse
import dataclasses
import operator
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from crank.test_journal_orbits import PIN
from cylinder.test_cylinder import SCATTERED, SPEED, inertial, mechanism, restitutions

from jaxcomp import Collocation, Shooting, load, solve_orbit
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.cylinder import CycleOptions, solve_cycle
from jaxcomp.scene import with_value

# What the references are good for: the march at 1e-9, and shooting at 1e-8.
FLOOR = {"valves": 2e-7, "journals": 3e-9, "cylinders": 3e-9}
MARCH = CycleOptions(method="march", panels=160, max_passes=60_000, capacity=8192)
NAMES = "seed", "machine", "converged", "reference", "stated", "true", "margin"


def mapped(function):
    """One program for all rows, one after the other: in lanes all would wait for the slowest."""
    program = jax.jit(lambda rows: jax.lax.map(function, rows))
    return lambda rows: jax.tree.map(np.asarray, program(rows))


def valves():
    """What gives stated and true errors of so many machines with valves, and which have both."""
    base = inertial()

    def get(cylinder):
        return operator.attrgetter(*SCATTERED)(cylinder)

    def solver(options):
        def one(row):
            factors, bounce, tolerance = row
            made = tuple(x * f for x, f in zip(get(base), factors, strict=False))
            own = dataclasses.replace(options, value_tolerance=tolerance)
            cylinder = eqx.tree_at(get, base, made)
            cylinder = eqx.tree_at(restitutions, cylinder, list(bounce))
            cycle = solve_cycle(cylinder, mechanism(), SPEED * factors[-1], own, throw=False)
            values = jnp.stack([cycle.volumetric_efficiency, cycle.indicated_work])
            margins = jnp.stack([*cycle.turning_margins.values()])
            return cycle.converged, values, cycle.resolution, jnp.min(jnp.abs(margins))

        return one

    collocate, march = mapped(solver(CycleOptions(panels=96, nodes=8))), mapped(solver(MARCH))

    def make(count, seed):
        rng = np.random.default_rng(seed)
        numbers = jnp.asarray(2.0 ** rng.uniform(-1, 1, (count, len(SCATTERED) + 1)))
        bounce = jnp.asarray(rng.choice([0.0, 1.0], (count, 1)) * rng.uniform(0, 0.5, (count, 2)))
        ok, found, stated, margin = collocate((numbers, bounce, jnp.zeros(count)))
        tolerance = np.full(count, 1e-9)
        sure, known, *_ = march((numbers, bounce, jnp.asarray(tolerance)))
        error = np.max(np.abs(found / known - 1), axis=1)
        wrong = error > stated + FLOOR["valves"]
        if np.any(wrong):
            # a march may miss a bounce: it counts where a finer one agrees
            tolerance[wrong] = 1e-10
            sure, known, *_ = march((numbers, bounce, jnp.asarray(tolerance)))
            error = np.max(np.abs(found / known - 1), axis=1)
        return ok, sure, stated, error, margin

    return make


def journals():
    """The same of machines whose crank pin moves in a short film; without margins."""
    base = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN | {"film": "short"})
    base = base.as_compressor()

    def get(c):
        film = c.friction.crank_pin
        return (film.dynamic_viscosity, film.radial_clearance, film.length, c.motor.mean_speed,
                c.crankshaft.inertia, c.mechanism.piston_mass, c.mechanism.conrod_mass,
                c.friction.wall.coefficient)  # fmt: skip

    return beside_shooting(base, get, Collocation(reversals=base.load_reversals))


def cylinders():
    """The same of machines with four cylinders on two throws; without margins."""
    base = load("mayekawa-4wbhe").as_compressor()

    def get(c):
        return (c.mechanism.bore, c.mechanism.conrod_length, c.mechanism.piston_mass,
                c.mechanism.conrod_mass, c.motor.mean_speed, c.crankshaft.inertia,
                c.gas.suction_pressure, c.friction.wall.coefficient)  # fmt: skip

    return beside_shooting(base, get, default_collocation(base))


def beside_shooting(base, get, collocation):
    """Machines with some numbers at half to twice those of another, by collocation and by shooting."""
    numbers = len(get(base))

    def solver(method):
        def one(factors):
            made = tuple(x * f for x, f in zip(get(base), factors, strict=True))
            orbit = solve_orbit(eqx.tree_at(get, base, made), method, throw=False)
            share = orbit.energy.total_loss / orbit.energy.motor_work
            return orbit.converged, share, orbit.efficiency_error

        return one

    collocate = mapped(solver(collocation))
    shoot = mapped(solver(Shooting(tolerance=1e-8, max_steps=16_384)))

    def make(count, seed):
        rows = jnp.asarray(2.0 ** np.random.default_rng(seed).uniform(-1, 1, (count, numbers)))
        ok, found, stated = collocate(rows)
        sure, known, _ = shoot(rows)
        return ok, sure, stated, np.abs(found - known), np.full(count, np.nan)

    return make


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=("valves", "journals", "cylinders"))
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--batch", type=int, default=50)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    floor, make, rows = FLOOR[given.kind], None, np.empty((0, 7))
    if given.keep and given.keep.exists():
        rows = np.loadtxt(given.keep, delimiter=",", skiprows=1, ndmin=2)
    began = time.process_time()
    for first in range(len(rows), given.count, given.batch):
        count, seed = min(given.batch, given.count - first), given.seed + first // given.batch
        make = make or globals()[given.kind]()
        new = np.stack([np.full(count, seed), np.arange(count), *make(count, seed)], axis=1)
        rows = np.concatenate([rows, new])
        if given.keep:
            np.savetxt(given.keep, rows, delimiter=",", header=",".join(NAMES), comments="")
        spent = time.process_time() - began
        print(f"{len(rows)} of {given.count}, {spent:.0f} s of processor time", flush=True)
    seeds, numbers, ok, sure, stated, error, margin = rows[: given.count].T
    both = (ok > 0) & (sure > 0)
    bad, seen = both & ~(error <= stated + floor), both & (error > floor)
    for n in np.flatnonzero(bad):
        print(f"seed {seeds[n]:.0f}, machine {numbers[n]:.0f}: stated {stated[n]:.1e}, true "
              f"{error[n]:.1e}, margin {margin[n]:.1e}")  # fmt: skip
    print(f"{len(ok)} machines: {np.sum(ok):.0f} converged, {np.sum(sure):.0f} of the references")
    print(
        f"{np.sum(both)} converged by both methods, {np.sum(bad)} of them beyond their stated error"
    )
    if seen.any():
        ratios = stated[seen] / error[seen]
        least, middle = np.min(ratios), np.median(ratios)
        print(
            f"stated over true, where that is above {floor:g}: {least:.2g} least, {middle:.2g} median"
        )
    return bool(bad.any())


if __name__ == "__main__":
    sys.exit(main())
