"""Random machines against another method.

`python tests/benchmarks/random_machines.py valves|journals|cylinders`

Machines with valves (every number at half to twice the golden machine's, a restitution of up to 0.5) by
collocation, their volumetric efficiency and work against the march with located events; machines whose
crank pin moves in its film, and machines of four cylinders, by collocation, efficiency and losses
against shooting with diffrax. Of every `converged` one the error must lie within what the result states:
the resolution of the cycle, the errors of efficiency and losses of the crank. Prints how many do, how
careful the statements are, and those that are wrong; exits with 1 if there are any. A thousand machines
take some minutes of one core.
"""

import argparse
import operator
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from crank.test_journal_orbits import PIN
from cylinder.test_cylinder import SCATTERED, SPEED, inertial, mechanism, restitutions

from jaxcomp import Collocation, Shooting, load, solve_orbit
from jaxcomp.crank import default_collocation
from jaxcomp.cylinder import CycleOptions, solve_cycle
from jaxcomp.scene import with_value

# What the references are good for: the march at 1e-9, and shooting at 1e-9.
FLOOR = {"valves": 2e-7, "journals": 3e-9, "cylinders": 3e-9}
MARCH = CycleOptions(
    method="march", panels=160, value_tolerance=1e-9, max_passes=60_000, capacity=8192
)


def mapped(function, rows):
    return jax.tree.map(np.asarray, jax.jit(lambda rows: jax.lax.map(function, rows))(rows))


def valves(count: int, seed: int):
    """Stated and true errors of machines with valves, and which have both."""
    base = inertial()
    rng = np.random.default_rng(seed)
    numbers = jnp.asarray(2.0 ** rng.uniform(-1, 1, (count, len(SCATTERED) + 1)))
    bounce = jnp.asarray(rng.choice([0.0, 1.0], (count, 1)) * rng.uniform(0, 0.5, (count, 2)))

    def get(cylinder):
        return operator.attrgetter(*SCATTERED)(cylinder)

    def solver(options):
        def one(row):
            factors, bounce = row
            made = tuple(x * f for x, f in zip(get(base), factors, strict=False))
            cylinder = eqx.tree_at(get, base, made)
            cylinder = eqx.tree_at(restitutions, cylinder, list(bounce))
            cycle = solve_cycle(cylinder, mechanism(), SPEED * factors[-1], options, throw=False)
            values = jnp.stack([cycle.volumetric_efficiency, cycle.indicated_work])
            margins = jnp.stack([*cycle.turning_margins.values()])
            return cycle.converged, values, cycle.resolution, jnp.min(jnp.abs(margins))

        return one

    rows = numbers, bounce
    ok, found, stated, margin = mapped(solver(CycleOptions(panels=96, nodes=8)), rows)
    sure, known, *_ = mapped(solver(MARCH), rows)
    error = np.max(np.abs(found / known - 1), axis=1)
    print(f"{np.sum(ok)} converged by collocation, {np.sum(sure)} by the march")
    return stated, error, ok & sure, [f"margin {m:.1e}" for m in margin]


def journals(count: int, seed: int):
    """The same of machines whose crank pin moves in a short film."""
    base = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN | {"film": "short"})
    base = base.as_compressor()

    def get(c):
        film = c.friction.crank_pin
        return (film.dynamic_viscosity, film.radial_clearance, film.length, c.motor.mean_speed,
                c.crankshaft.inertia, c.mechanism.piston_mass, c.mechanism.conrod_mass,
                c.friction.wall.coefficient)  # fmt: skip

    return beside_shooting(base, get, Collocation(reversals=base.load_reversals), count, seed)


def cylinders(count: int, seed: int):
    """The same of machines with four cylinders on two throws."""
    base = load("mayekawa-4wbhe").as_compressor()

    def get(c):
        return (c.mechanism.bore, c.mechanism.conrod_length, c.mechanism.piston_mass,
                c.mechanism.conrod_mass, c.motor.mean_speed, c.crankshaft.inertia,
                c.gas.suction_pressure, c.friction.wall.coefficient)  # fmt: skip

    return beside_shooting(base, get, default_collocation(base), count, seed)


def beside_shooting(base, get, collocation, count, seed):
    """Machines with some numbers at half to twice those of another, by collocation and by shooting."""
    numbers = len(get(base))
    rows = jnp.asarray(2.0 ** np.random.default_rng(seed).uniform(-1, 1, (count, numbers)))

    def solver(method):
        def one(factors):
            made = tuple(x * f for x, f in zip(get(base), factors, strict=True))
            orbit = solve_orbit(eqx.tree_at(get, base, made), method, throw=False)
            share = orbit.energy.total_loss / orbit.energy.motor_work
            return orbit.converged, share, orbit.efficiency_error

        return one

    ok, found, stated = mapped(solver(collocation), rows)
    sure, known, _ = mapped(solver(Shooting(tolerance=1e-8, max_steps=16_384)), rows)
    print(f"{np.sum(ok)} converged by collocation, {np.sum(sure)} by shooting")
    return stated, np.abs(found - known), ok & sure, [""] * count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=("valves", "journals", "cylinders"))
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--batch", type=int, default=500)
    given = parser.parse_args()
    make, wrong, ratios, total = globals()[given.kind], 0, [], 0
    floor = FLOOR[given.kind]
    for number, first in enumerate(range(0, given.count, given.batch)):
        count = min(given.batch, given.count - first)
        stated, error, both, notes = make(count, given.seed + number)
        total += int(np.sum(both))
        bad = both & ~(error <= stated + floor)
        seen = both & (error > floor)
        ratios += list(stated[seen] / error[seen])
        for which in np.flatnonzero(bad):
            print(
                f"seed {given.seed + number}, machine {which}: stated {stated[which]:.1e}, true "
                f"{error[which]:.1e} {notes[which]}"
            )
        wrong += int(np.sum(bad))
    print(f"{total} converged by both methods, {wrong} of them beyond their stated error")
    if ratios:
        least, middle = np.min(ratios), np.median(ratios)
        print(
            f"stated over true, where that is above {floor:g}: {least:.2g} least, {middle:.2g} median"
        )
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
