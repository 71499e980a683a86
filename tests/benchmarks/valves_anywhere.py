"""Scattered machines with valves: the share that is solved, how right, and how long it takes.

`python tests/benchmarks/valves_anywhere.py [COUNT] [--seed N] [--quasi-steady]`

Machines with R134a and with air, every number drawn over the whole range that users have: 300 to 6,000
rpm, pressure ratio 1.5 to 12, springs of 60 to 8,000 N/m, plates of 0.03 to 1 g, ports of 3 to 11 mm and
2 to 15 mm long, clearance of 0.5 to 10 %, a restitution of 0.2 for every fourth. Each is solved by
`solve_cycle` as a user calls it, and compared with the march with located events at 1e-9, which shares
the balances with the collocation and nothing else. Prints the share that is solved by the number of
events in a revolution, the errors in work and volumetric efficiency, and those that fail.
"""

import argparse
import time
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import SliderCrank, Status
from jaxcomp.cylinder import (
    Annand,
    CycleOptions,
    Cylinder,
    DischargeLine,
    LaminarGap,
    SuctionLine,
    solve_cycle,
)
from jaxcomp.fluid import PerfectGas, RealGas
from jaxcomp.valve import PlateValve

# The reference: no buffer limits it.
REFERENCE = CycleOptions(
    method="march", panels=1024, capacity=65536, max_passes=2_000_000, max_revolutions=200,
    value_tolerance=1e-9,
)  # fmt: skip
EDGES = (0, 12, 18, 30, 50, 100, 200, 10_000)  # of events, reversals of the flow among them
SOLVED = ("converged", "no_delivery", "wet")
STATUSES = (*SOLVED, "not_converged", "too_many_events", "no_periodic_state", "bad_input")


class Machine(NamedTuple):
    """A cylinder with its piston's motion and speed."""

    cylinder: Cylinder
    mechanism: SliderCrank
    speed: jax.Array  # [rad/s]


def scattered(rng: np.random.Generator, real: bool, inertial: bool = True) -> Machine:
    """A machine with all its numbers drawn at random.

    Args:
        rng: of the numbers.
        real: R134a, or else air.
        inertial: whether the ports have a length.
    """

    def between(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    restitution = 0.2 * float(rng.random() < 0.25)
    bore = between(18e-3, 80e-3)
    radius = bore * between(0.3, 0.7)
    mechanism = SliderCrank(
        bore=bore,
        crank_radius=radius,
        conrod_length=radius * between(3.2, 6.0),
        piston_mass=0.05,
        conrod_mass=0.02,
    )
    # valves are scaled with the bore, as a designer would
    size = bore / 22e-3

    def valve(low, high):
        diameter = between(low, high) * size
        return PlateValve(
            mass=between(3e-5, 1e-3) * size**2,
            damping=between(5e-3, 0.2),
            stiffness=between(60.0, 8000.0),
            preload=between(1e-6, 2e-4),
            stop=diameter * between(0.1, 0.3),
            port_diameter=diameter,
            port_length=between(2e-3, 15e-3) if inertial else None,
            restitution=restitution,
            sticking_speed=1e-4,
        )

    suction_valve = valve(4e-3, 11e-3)
    discharge_valve = valve(3e-3, 8e-3)
    ratio = between(1.5, 12.0)
    if real:
        fluid = RealGas("R134a")
        low = between(80e3, 300e3)
        lines = SuctionLine(low, 330.0), DischargeLine(low * ratio, temperature=400.0)
        wall, viscosity, conductivity = 370.0, 1.3e-5, 0.015
    else:
        fluid = PerfectGas(287.0, 1.4)
        lines = SuctionLine(1e5, 300.0), DischargeLine(1e5 * ratio, temperature=430.0)
        wall, viscosity, conductivity = 350.0, 1.9e-5, 0.027
    heat = Annand(viscosity=viscosity, conductivity=conductivity)
    gap = LaminarGap(between(1e-6, 1e-5), 12e-3, viscosity)
    clearance = between(5e-3, 0.1)
    cylinder = Cylinder(fluid, *lines, suction_valve, discharge_valve, clearance, wall, heat, gap)
    speed = between(300.0, 6000.0) * 2 * np.pi / 60
    return Machine(cylinder, mechanism, jnp.asarray(speed))


class Outcome(NamedTuple):
    """What is known of one machine."""

    status: str
    events: int
    error: float  # [-] larger one of work and volumetric efficiency
    seconds: float  # of a second solution


def outcome(machine: Machine) -> Outcome:
    """Solve a machine by default options and by the reference."""
    cycle = solve_cycle(*machine, throw=False)
    begin = time.perf_counter()
    cycle = jax.block_until_ready(solve_cycle(*machine, throw=False))
    seconds = time.perf_counter() - begin
    known = solve_cycle(*machine, REFERENCE, throw=False)
    found = np.array([cycle.indicated_work, cycle.volumetric_efficiency])
    wanted = np.array([known.indicated_work, known.volumetric_efficiency])
    error = float(np.max(np.abs(found - wanted) / np.maximum(np.abs(wanted), 1e-2)))
    name = next(name for name in STATUSES if bool(cycle.status == getattr(Status, name)))
    if not bool(known.converged | (known.status == Status.no_delivery)):
        error = np.nan
    return Outcome(name, int(known.event_count), error, seconds)


def main() -> None:
    """Solve them and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quasi-steady", action="store_true", help="ports without a length")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    outcomes = []
    for number in range(given.count):
        machine = scattered(rng, number % 2 == 0, not given.quasi_steady)
        outcomes.append(outcome(machine))
        if outcomes[-1].status not in SOLVED or not outcomes[-1].error < 1e-5:
            print(f"machine {number}: {outcomes[-1]}", flush=True)
    print(
        f"{'events':>12} {'machines':>9} {'solved':>7} {'median error':>13} {'largest':>9} {'ms':>7}"
    )
    for low, high in pairwise(EDGES):
        rows = [one for one in outcomes if low <= one.events < high]
        if not rows:
            continue
        solved = [one for one in rows if one.status in SOLVED]
        errors = [one.error for one in solved]
        times = 1e3 * np.median([one.seconds for one in rows])
        print(
            f"{low:>5} to {high:<4} {len(rows):>8} {100 * len(solved) / len(rows):>6.1f}% "
            f"{np.nanmedian(errors):>13.1e} {np.nanmax(errors):>9.1e} {times:>7.1f}"
        )
    share = np.mean([one.status in SOLVED for one in outcomes])
    print(f"solved by default: {100 * share:.1f} % of {len(outcomes)}")


if __name__ == "__main__":
    main()
