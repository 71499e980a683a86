"""Scattered machines with valves and what hangs together with their cycle: the share that is solved.

`python tests/benchmarks/valves_kin.py [KIND ...] [--count N] [--seed N]`

The machines of `valves_anywhere.py`, with ports that have inertia and, one in two, R134a or air, and
- `cylinders`: two or three of them at even angles, with a suction and a discharge plenum that they share,
- `walls`: a wall whose temperature follows from a balance,
- `warming`: suction gas that losses and delivered gas warm by a law,
- `light`: a crankshaft so light that the speed fluctuates by 1 to 40 %, at 300 to 1,500 rpm,
- `start`: brought from rest through the low speeds to 8 revolutions at speed, by `simulate`.

Each is solved by default options. Prints how they ended, the largest error of the balances of mass and
energy of those that were solved, and the median time of a second solution.
"""

import argparse
import time
from collections import Counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from valves_anywhere import Machine, scattered

from jaxcomp import Compressor, ConstantSpeed, SlipLine, Status, simulate, solve_orbit
from jaxcomp._core.status import names_of_codes
from jaxcomp.crank import TimeIntegration
from jaxcomp.crankshaft import Crankshaft, Throw
from jaxcomp.cylinder import Plenum, SuctionWarming, WallNetwork
from jaxcomp.cylinder._several import of_each

ANSWERED = ("converged", "no_delivery", "wet")
RPM = 2 * np.pi / 60


def between(rng, low: float, high: float) -> float:
    """A number whose logarithm is evenly spread."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def at(tree, where, value):
    """A copy of a tree with another value in a place, which may be empty."""
    return eqx.tree_at(where, tree, value, is_leaf=lambda leaf: leaf is None)


def crankshaft(machine: Machine, fluctuation: float, throws=()) -> Crankshaft:
    """One so heavy that the speed fluctuates by about a given share."""
    cylinder = machine.cylinder
    swept = machine.mechanism.swept_volume
    work = float((cylinder.discharge.pressure - cylinder.suction.pressure) * swept)
    inertia = work / (fluctuation * float(machine.speed) ** 2)
    return Crankshaft(inertia, throws=throws)


def cylinders(rng, number: int) -> Compressor:
    """Two or three cylinders that share plenums."""
    machine = scattered(rng, number % 2 == 0)
    count = 2 + number // 2 % 2
    swept = float(machine.mechanism.swept_volume)
    bore = float(machine.mechanism.bore)

    def plenum():
        return Plenum(
            volume=count * swept * between(rng, 2.0, 30.0),
            neck_length=between(rng, 0.01, 0.2),
            neck_diameter=bore * between(rng, 0.15, 0.5),
            loss_coefficient=1.5,
        )

    gas = at(machine.cylinder, lambda c: c.suction.plenums, (plenum(),))
    gas = at(gas, lambda c: c.discharge.plenums, (plenum(),))
    angles = 2 * np.pi / count * np.arange(count)
    throws = tuple(Throw(np.zeros(1), angle, 0.1 * place) for place, angle in enumerate(angles))
    shaft = crankshaft(machine, 0.01, throws)
    return Compressor(machine.mechanism, shaft, ConstantSpeed(machine.speed), gas)


def walls(rng, number: int) -> Compressor:
    """A wall whose temperature follows from a balance with its surroundings."""
    machine = scattered(rng, number % 2 == 0)
    area = float(machine.mechanism.bore) ** 2
    network = WallNetwork(
        ambient_temperature=between(rng, 290.0, 360.0),
        ambient_conductance=area * between(rng, 50.0, 5000.0),
    )
    gas = at(machine.cylinder, lambda c: c.walls, network)
    shaft = crankshaft(machine, 0.01)
    return Compressor(machine.mechanism, shaft, ConstantSpeed(machine.speed), gas)


def warming(rng, number: int) -> Compressor:
    """Suction gas that losses and delivered gas warm."""
    machine = scattered(rng, number % 2 == 0)
    cylinder = machine.cylinder
    flow = float(cylinder.suction.pressure * machine.mechanism.swept_volume * machine.speed) / 1e6
    law = SuctionWarming(flow * between(rng, 0.1, 10.0), rng.uniform(0.0, 0.9))
    gas = at(cylinder, lambda c: c.suction.warming, law)
    shaft = crankshaft(machine, 0.01)
    return Compressor(machine.mechanism, shaft, ConstantSpeed(machine.speed), gas)


def light(rng, number: int) -> Compressor:
    """A light crankshaft at low speed, driven by a motor with slip."""
    machine = scattered(rng, number % 2 == 0)
    speed = between(rng, 300.0, 1500.0) * RPM
    machine = machine._replace(speed=jnp.asarray(speed))
    shaft = crankshaft(machine, between(rng, 0.01, 0.4))
    cylinder = machine.cylinder
    torque = float(cylinder.discharge.pressure * machine.mechanism.swept_volume) / (2 * np.pi)
    motor = SlipLine(torque / (0.05 * speed), 1.03 * speed)
    return Compressor(machine.mechanism, shaft, motor, cylinder)


KINDS = {"cylinders": cylinders, "walls": walls, "warming": warming, "light": light}


def name_of(status: Status) -> str:
    """The name of a status."""
    return str(names_of_codes(np.asarray(status._value)))


def solved_in_time(compressor: Compressor) -> tuple[str, float]:
    """How a start from rest ended, and its time [s]."""
    speed = float(compressor.motor.speed_guess)
    begin = time.perf_counter()
    # a steady torque brings the shaft up within some revolutions
    duration = 20 * 2 * np.pi / speed
    options = TimeIntegration(tolerance=1e-6, samples=101, max_steps=2**16)
    march = simulate(compressor, duration, speed=0.0, options=options, throw=False)
    jax.block_until_ready(march.state.speed)
    return name_of(march.status), time.perf_counter() - begin


def starts(count: int, seed: int) -> None:
    """Bring machines from rest to speed and print how they ended."""
    rng = np.random.default_rng(seed)
    outcomes = [solved_in_time(light(rng, number)) for number in range(count)]
    print_outcomes("start", [name for name, _ in outcomes], [seconds for _, seconds in outcomes])


def print_outcomes(kind: str, names, seconds) -> None:
    """Print statuses, the share with an answer, and the median time."""
    share = np.mean([name in ANSWERED for name in names])
    told = ", ".join(f"{name} {number}" for name, number in Counter(names).most_common())
    print(
        f"{kind:>10}: answered {100 * share:.1f} % of {len(names)} ({told}), "
        f"median {1e3 * np.median(seconds):.0f} ms",
        flush=True,
    )


def periodic(kind: str, count: int, seed: int) -> None:
    """Solve periodic states and print how they ended."""
    rng = np.random.default_rng(seed)
    names, seconds, closures = [], [], [0.0]
    for number in range(count):
        compressor = KINDS[kind](rng, number)
        solve_orbit(compressor, throw=False)
        begin = time.perf_counter()
        orbit = jax.block_until_ready(solve_orbit(compressor, throw=False))
        seconds.append(time.perf_counter() - begin)
        names.append(name_of(orbit.status))
        cycle = orbit.cycle
        if names[-1] == "converged":
            closures.append(float(jnp.max(jnp.abs(cycle.energy_closure))))
        elif names[-1] not in ANSWERED:
            events = int(jnp.max(jnp.sum(of_each(cycle).valve_events, axis=-1)))
            print(f"{kind} {number}: {names[-1]}, {events} events", flush=True)
    print_outcomes(kind, names, seconds)
    print(f"{'':>10}  energy closes within {max(closures):.1e} of the work")


def main() -> None:
    """Solve and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", default=[*KINDS, "start"])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for kind in given.kinds:
        if kind == "start":
            starts(given.count, given.seed)
        else:
            periodic(kind, given.count, given.seed)


if __name__ == "__main__":
    main()
