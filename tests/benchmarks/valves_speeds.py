"""The bundled machines with valves at twelve speeds: how each is solved, and its derivatives.

`python tests/benchmarks/valves_speeds.py [MACHINE ...] [--speeds RPM,...] [--derivatives]`

Each machine is solved by default options at 300 to 6,000 rpm, whatever its own speed is. Prints the
status, events of the valves in a revolution, the panels that they asked for, and seconds of the first
and of a second solution. With `--derivatives` those of the indicated work by the crank radius and by the
clearance, from `jax.value_and_grad` of `solve_orbit`, are compared with central differences.
"""

import argparse
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import Compressor, Orbit, SolveFailed, load, solve_orbit
from jaxcomp._core.status import names_of_codes
from jaxcomp.cylinder._several import of_each
from jaxcomp.scene import with_value

MACHINES = (
    "carlyle-06dm313",
    "copeland-3db3-1000",
    "copeland-crk3-0325",
    "danfoss-vtz038-g",
    "mayekawa-wbhe-r22",
    "process-two-stage",
    "r134a-7cc",
    "r290-6cc",
    "r600a-8cc",
    "semi-hermetic-200cc",
)
SPEEDS = (300, 450, 600, 900, 1200, 1500, 1800, 2400, 2900, 3600, 4500, 6000)  # [rpm]
# of central differences, relative: an event that passes within a step spoils it, and another step escapes
STEPS = (1e-4, 3e-5, 1e-3)


def at_speed(name: str, speed: int) -> Compressor:
    """A bundled machine at another mean speed [rpm]."""
    return with_value(load(name), "motor.mean_speed", f"{speed} rpm").as_compressor()


def solved(compressor: Compressor) -> tuple[Orbit, float]:
    """The orbit, and the seconds that it took."""
    begin = time.perf_counter()
    orbit = jax.block_until_ready(solve_orbit(compressor, throw=False))
    return orbit, time.perf_counter() - begin


def told(orbit: Orbit) -> str:
    """The status of a machine, its events, panels and volumetric efficiency."""
    cycle = orbit.cycle
    each = of_each(cycle)
    status = names_of_codes(np.asarray(orbit.status._value))
    events = np.sum(np.reshape(each.valve_events, (-1, 2)), axis=0)
    return (
        f"{status!s:17} {events[0]:4d} + {events[1]:<4d} {each.solver:11} "
        f"eta_v {np.mean(cycle.volumetric_efficiency):.4f}"
    )


def changed(compressor: Compressor, factors) -> Compressor:
    """The machine with its crank radius and clearance times two factors."""
    radius = compressor.mechanism.crank_radius
    clearance = compressor.gas.clearance_ratio
    return eqx.tree_at(
        lambda machine: (machine.mechanism.crank_radius, machine.gas.clearance_ratio),
        compressor,
        (radius * factors[0], clearance * factors[1]),
    )


def difference(work, value: float, direction, step: float) -> float:
    """The slope of the work by central differences; by one side where the other has no solution."""
    slopes = []
    for change in (step, -step):
        try:
            slopes.append((float(work(1 + change * direction)) - value) / change)
        except (SolveFailed, ValueError):
            continue  # a neighbour has no periodic state
    return float(np.mean(slopes)) if slopes else np.nan


def derivative_error(compressor: Compressor) -> tuple[float, float]:
    """Largest difference of the derivatives of the work from differences, and seconds they took.

    Of the larger one of both derivatives, with the step that comes nearest.
    """

    def work(factors):
        return jnp.sum(solve_orbit(changed(compressor, factors)).cycle.indicated_work)

    begin = time.perf_counter()
    value, derivative = jax.value_and_grad(work)(jnp.ones(2))
    seconds = time.perf_counter() - begin
    errors = []
    for step in STEPS:
        differences = [difference(work, float(value), side, step) for side in np.eye(2)]
        deviation = np.max(np.abs(np.asarray(derivative) - differences))
        errors.append(deviation / np.max(np.abs(differences)))
        if errors[-1] < 1e-4:
            break
    return float(np.nanmin(errors)), seconds


def main() -> None:
    """Solve and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", default=MACHINES)
    parser.add_argument("--speeds", default=",".join(map(str, SPEEDS)), help="[rpm]")
    parser.add_argument("--derivatives", action="store_true")
    arguments = parser.parse_args()
    for name in arguments.machines:
        for speed in map(int, arguments.speeds.split(",")):
            compressor = at_speed(name, speed)
            orbit, first = solved(compressor)
            line = f"{name:20} {speed:5d} rpm {told(orbit)} {first:7.2f} s"
            if arguments.derivatives:
                try:
                    error, seconds = derivative_error(compressor)
                    line += f" derivative {error:.1e} {seconds:7.2f} s"
                except (SolveFailed, ValueError, NotImplementedError) as refusal:
                    line += f" derivative refused: {str(refusal)[:120]}"
            else:
                _, second = solved(compressor)
                line += f" {second:7.3f} s"
            print(line, flush=True)


if __name__ == "__main__":
    main()
