"""Derivatives of scattered machines with valves, against differences.

`python tests/benchmarks/valves_derivatives.py [COUNT] [--seed N] [--tight]`

The machines of `valves_anywhere.py`, whose ports have inertia. Derivatives of the indicated work, of the
volumetric and of the isentropic efficiency by seven numbers, by `jax.jacrev` of `solve_cycle` as a user
calls it, are compared with central differences of the same, relative to the largest elasticity of each
quantity. `--tight` takes 320 panels with 8 nodes, and marches to 3e-7. Prints a line for each machine,
and the share within 1e-3 (1e-4 with `--tight`).
"""

import argparse
import time
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from valves_anywhere import Machine, scattered

from jaxcomp import SolveFailed
from jaxcomp.cylinder import CycleOptions, solve_cycle

NUMBERS = {
    "crank radius": lambda machine: machine.mechanism.crank_radius,
    "clearance": lambda machine: machine.cylinder.clearance_ratio,
    "discharge pressure": lambda machine: machine.cylinder.discharge.pressure,
    "suction spring": lambda machine: machine.cylinder.suction_valve.stiffness,
    "discharge plate": lambda machine: machine.cylinder.discharge_valve.mass,
    "suction port": lambda machine: machine.cylinder.suction_valve.port_diameter,
    "discharge port": lambda machine: machine.cylinder.discharge_valve.port_diameter,
}
# of central differences, relative: an event that passes within a step spoils it, and another escapes
STEPS = (1e-4, 1e-5, 1e-3)
# with the march of a larger size: an edge of the panels stands where that sees a port begin to choke, and
# the derivative is off by the distance
TIGHT = CycleOptions(nodes=8, panels=320, march_tolerance=3e-7)


def changed(machine: Machine, factors) -> Machine:
    """A machine with its seven numbers times factors."""
    for where, factor in zip(NUMBERS.values(), factors, strict=True):
        machine = eqx.tree_at(where, machine, where(machine) * factor)
    return machine


class Comparison(NamedTuple):
    """Derivatives of one machine beside differences."""

    events: int
    errors: np.ndarray  # (3,) of each quantity, largest of the seven numbers
    seconds: float  # of the derivatives


def compared(machine: Machine, options: CycleOptions | None) -> Comparison:
    """Derivatives of a machine beside differences."""

    def quantities(factors):
        cycle = solve_cycle(*changed(machine, factors), options)
        return jnp.stack(
            [cycle.indicated_work, cycle.volumetric_efficiency, cycle.isentropic_efficiency]
        )

    start = jnp.ones(len(NUMBERS))
    value = np.asarray(quantities(start))
    begin = time.perf_counter()
    derivatives = np.asarray(jax.jacrev(quantities)(start))
    seconds = time.perf_counter() - begin
    scale = np.maximum(np.max(np.abs(derivatives), axis=1, keepdims=True), np.abs(value)[:, None])
    best = np.full(derivatives.shape, np.inf)
    for step in STEPS:
        for column, direction in enumerate(np.eye(len(NUMBERS))):
            if np.all(best[:, column] < 1e-5):
                continue
            try:
                above = np.asarray(quantities(1 + step * direction))
                below = np.asarray(quantities(1 - step * direction))
            except SolveFailed:
                continue  # a neighbour has no periodic state
            difference = (above - below) / (2 * step)
            error = np.abs(derivatives[:, column] - difference) / scale[:, 0]
            best[:, column] = np.minimum(best[:, column], error)
    events = int(solve_cycle(*machine, options).event_count)
    return Comparison(events, np.max(best, axis=1), seconds)


def main() -> None:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=45)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tight", action="store_true")
    arguments = parser.parse_args()
    options = TIGHT if arguments.tight else None
    bound = 1e-4 if arguments.tight else 1e-3
    rng = np.random.default_rng(arguments.seed)
    right, refused = 0, 0
    for number in range(arguments.count):
        machine = scattered(rng, number % 2 == 0)
        try:
            comparison = compared(machine, options)
        except (SolveFailed, ValueError) as refusal:
            refused += 1
            print(f"{number:3d} refused: {str(refusal)[:140]}", flush=True)
            continue
        work, volumetric, isentropic = comparison.errors
        right += bool(np.max(comparison.errors) < bound)
        print(
            f"{number:3d} {comparison.events:4d} events: work {work:.1e}, volumetric efficiency "
            f"{volumetric:.1e}, isentropic efficiency {isentropic:.1e}, {comparison.seconds:.1f} s",
            flush=True,
        )
    print(f"within {bound:g}: {right} of {arguments.count}, refused in words: {refused}")


if __name__ == "__main__":
    main()
