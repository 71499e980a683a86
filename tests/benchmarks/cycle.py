"""Cost of the cycle of a cylinder with valves: `python tests/benchmarks/cycle.py`.

The golden machines of `tests/cylinder/test_cylinder.py`: a single operating point with its gradient,
scattered designs in one program, a capacity map. Times are processor times, the least of several calls.
"""

import argparse
import operator
import os
import sys
import time
from pathlib import Path
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
# a map is a whole solution, whose first programs are compiled sooner and run slower
os.environ.setdefault("JAXCOMP_XLA_FLAGS", "optimised")
from cylinder.test_cylinder import SCATTERED, SPEED, golden, mechanism

import jaxcomp
from jaxcomp._core.status import Status
from jaxcomp.cylinder import Cylinder, DischargeLine, LaminarGap, SuctionLine, solve_cycle
from jaxcomp.fluid import RealGas
from jaxcomp.study.rating import rating_map
from jaxcomp.valve import ReedBeam
from jaxcomp.valve._flow import quasi_steady_flow


def least(function, *arguments, calls: int = 20) -> tuple[float, float]:
    """[s] Processor time of the first call and the least of the others."""
    times = []
    for _ in range(calls + 1):
        start = time.process_time()
        jax.block_until_ready(function(*arguments))
        times.append(time.process_time() - start)
    return times[0], min(times[1:])


def single() -> None:
    """Value and gradient to all numbers of the cylinder, on either golden machine with inertia."""
    for name in "DC":
        numbers, rest = eqx.partition(golden(name), eqx.is_inexact_array)

        def efficiency(numbers, rest=rest):
            cylinder = eqx.combine(numbers, rest)
            return solve_cycle(cylinder, mechanism(), SPEED, throw=False).isentropic_efficiency

        first, value = least(jax.jit(efficiency), numbers)
        first_slope, slope = least(jax.jit(jax.value_and_grad(efficiency)), numbers)
        print(
            f"machine {name}: value {1e3 * value:.1f} ms (first call {first:.0f} s), with gradient "
            f"{1e3 * slope:.1f} ms ({slope / value:.1f} times, first call {first_slope:.0f} s)",
            flush=True,
        )


def scattered(count: int) -> None:
    """Fifteen numbers of machine C at half to twice their values."""
    base, get = golden("C"), operator.attrgetter(*SCATTERED)
    draw = np.random.default_rng(1).uniform(-1, 1, (count, len(SCATTERED) + 1))

    def one(factors):
        numbers = tuple(x * f for x, f in zip(get(base), factors, strict=False))
        cylinder = eqx.tree_at(get, base, numbers)
        cycle = solve_cycle(cylinder, mechanism(), SPEED * factors[-1], throw=False)
        return cycle.converged, cycle.indicated_work, cycle.events.which

    run = jax.jit(lambda factors: jax.lax.map(one, factors))
    _, seconds = least(run, jnp.asarray(2.0**draw), calls=2)
    ok, _, which = run(jnp.asarray(2.0**draw))
    sequences = len({tuple(row[row >= 0].tolist()) for row in np.asarray(which)})
    print(
        f"{count} scattered designs, {sequences} sequences of events: {1e3 * seconds / count:.1f} ms "
        f"a design, {int(jnp.sum(ok))} converged",
        flush=True,
    )


def mapped(machine: str) -> None:
    """Two hundred points."""
    loaded = jaxcomp.load(machine)
    S, D = np.linspace(243.15, 268.15, 10), np.linspace(308.15, 333.15, 20)
    first, seconds = least(lambda: rating_map(loaded, S, D).values, calls=3)
    print(f"map of 200 points of {machine}: {seconds:.2f} s (first call {first:.0f} s)")


def beside_pdsim() -> None:
    """The machine of PDSim's example of a reciprocating compressor, as near as the laws here come.

    Dimensions and figures: PDSim, examples/recip_compressor.py, which ends its iteration at 3 %. Its reed
    is moved by pressure, drag and jet, and it has heat from the wall; here the pressure on the port alone
    moves it, and the wall is adiabatic.
    """

    # Here, as machine files know a law from its class on, and ask which of two is meant.
    class OrificeGap(LaminarGap):
        """The gap as a nozzle all round, which is what PDSim's example takes."""

        kind: ClassVar[str] = "orifice_gap"

        def flow(self, cylinder, crankcase, bore, viscosity):
            return jnp.pi * bore * self.gap * quasi_steady_flow(cylinder, crankcase)

    fluid = RealGas("R410A")
    suction = float(fluid.state(jnp.asarray(289.15), jnp.asarray(33.1)).p)
    reed = {
        "thickness": 0.1532e-3, "width": 7e-3, "length": 18e-3, "port_distance": 14e-3,
        "elastic_modulus": 193e9, "stop": 1.8e-3, "port_diameter": 5.9e-3,
        "flow_coefficient": 1.0, "force_coefficient": 1.17,
    }  # fmt: skip
    machine = eqx.tree_at(
        lambda m: (m.bore, m.crank_radius, m.conrod_length), mechanism(), (0.020, 0.010, 0.040)
    )
    print("PDSim's example: 8.14 g/s in, 8.36 g/s out, eta_v 65 %, adiabatic 91 %, 19 s a point")
    for words, law, length in (
        ("quasi-steady, gap as a nozzle", OrificeGap, None),
        ("quasi-steady, laminar gap", LaminarGap, None),
        ("port inertia of 5 mm, gap as a nozzle", OrificeGap, 5e-3),
    ):
        valves = [ReedBeam(**reed, port_length=length) for _ in range(2)]
        lines = SuctionLine(suction, 289.15), DischargeLine(2.5 * suction)
        cylinder = Cylinder(fluid, *lines, *valves, 3 / 20, leakage=law(10e-6, 0.02))
        solve = jax.jit(lambda one: solve_cycle(one, machine, 377.0, throw=False))
        _, seconds = least(solve, cylinder, calls=5)
        cycle = solve(cylinder)
        print(
            f"{words}: {1e3 * cycle.mass_flow:.2f} g/s, eta_v {100 * cycle.volumetric_efficiency:.1f} %, "
            f"isentropic {100 * cycle.isentropic_efficiency:.1f} %, {Status[cycle.status]}, "
            f"{1e3 * seconds:.1f} ms"
        )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--designs", type=int, default=300)
    options.add_argument("--machine", default="r600a-8cc", help="of the map")
    given = options.parse_args()
    single()
    scattered(given.designs)
    mapped(given.machine)
    beside_pdsim()


if __name__ == "__main__":
    main()
