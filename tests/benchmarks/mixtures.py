"""What a mixture costs beside a pure fluid: first and warm call of the cycle of a cylinder with valves.

    python tests/benchmarks/mixtures.py [R134a R513A R454B R404A R448A gas]

Seconds and milliseconds of the processor, so that other work on the machine hardly counts, and factors
to R134a. A refrigerant works between -10 and 45 degC with 10 K of superheat, `gas` (methane and seven
others by GERG-2008) between 2 and 6 bar. A fluid whose valves make more events than the first size of
the program has room for climbs to the next, and R134a is measured in that size beside it.
"""

import dataclasses as dc
import sys
import time
from typing import NamedTuple

import equinox as eqx
import jax

from jaxcomp import load
from jaxcomp.cylinder import CycleOptions, Cylinder, solve_cycle
from jaxcomp.fluid import AbstractFluid, Mixture, RealGas
from jaxcomp.fluid.real_gas import fluid_named

SPEED = 309.0  # [rad/s]
# the least of many, as other work on the machine disturbs most of them
WARM_CALLS = 40
REFERENCE = "R134a"
NAMES = (REFERENCE, "R513A", "R454B", "R404A", "R448A", "gas")
GAS = {
    "methane": 0.85,
    "R170": 0.06,
    "R290": 0.02,
    "R600": 0.005,
    "R600a": 0.005,
    "nitrogen": 0.03,
    "R744": 0.02,
    "hydrogen": 0.01,
}


def fluid_of(name: str) -> AbstractFluid:
    """A fluid by its name, or the natural gas."""
    return Mixture(mole_fractions=GAS) if name == "gas" else fluid_named(name)


def term_count(fluid: AbstractFluid) -> int:
    """Number of rows of a fluid's residual energy."""
    if isinstance(fluid, Mixture):
        return fluid.table.term_table.size
    assert isinstance(fluid, RealGas)
    return sum(len(rows) for rows in fluid.data["residual"].values())


def cylinder_of(cylinder: Cylinder, fluid: AbstractFluid, name: str) -> Cylinder:
    """The gas side between the lines that suit the fluid."""
    suction = {"pressure": 2e5, "temperature": 303.15, "evaporating": None, "superheat": None}
    discharge = {"pressure": 6e5, "condensing": None, "subcooling": None}
    if name != "gas":
        suction = {"pressure": None, "temperature": None, "evaporating": 263.15, "superheat": 10.0}
        discharge = {"pressure": None, "condensing": 318.15, "subcooling": 0.0}
    return dc.replace(
        cylinder,
        fluid=fluid,
        suction=dc.replace(cylinder.suction, **suction),
        discharge=dc.replace(cylinder.discharge, liquid_temperature=None, **discharge),
    )


def timed(function, *inputs) -> float:
    """[s] of the processor."""
    start = time.process_time()
    jax.block_until_ready(function(*inputs))
    return time.process_time() - start


class Cost(NamedTuple):
    """Seconds of the processor for the first and for a warm call, and what a cycle had to do."""

    first: float
    warm: float
    found: bool
    events: int
    revolutions: int


def costs(name: str, options: CycleOptions) -> Cost:
    """Cost of the cycle with a fluid in a size of the program."""
    machine = load("r134a-7cc").as_compressor()
    cylinder = cylinder_of(machine.gas, fluid_of(name), name)

    @eqx.filter_jit
    def numbers(cylinder):
        cycle = solve_cycle(cylinder, machine.mechanism, SPEED, options, throw=False)
        return cycle.indicated_work, cycle.event_count, cycle.revolutions, cycle.converged

    jax.clear_caches()
    first = timed(numbers, cylinder)
    warm = min(timed(numbers, cylinder) for _ in range(WARM_CALLS))
    _, events, revolutions, converged = numbers(cylinder)
    return Cost(first, warm, bool(converged), int(events), int(revolutions))


def main() -> None:
    """Print the table."""
    names = sys.argv[1:] or NAMES
    sizes = CycleOptions().ladder(by_march=False)
    costs("R290", sizes[0])  # what starts with the first program of a process
    references: dict[int, Cost] = {}
    print(
        "| fluid | components | terms | panels | first, s | times | warm, ms | times | events "
        "| marched | found |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name in names:
        fluid = fluid_of(name)
        for options in sizes:
            cost = costs(name, options)
            if cost.found:
                break
        panels = options.panel_count
        if panels not in references:
            references[panels] = cost if name == REFERENCE else costs(REFERENCE, options)
        reference = references[panels]
        components = len(getattr(fluid, "components", None) or (name,))
        print(
            f"| {name} | {components} | {term_count(fluid)} | {panels} | {cost.first:.1f} "
            f"| {cost.first / reference.first:.2f} | {1e3 * cost.warm:.1f} "
            f"| {cost.warm / reference.warm:.2f} | {cost.events} | {cost.revolutions} | {cost.found} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
