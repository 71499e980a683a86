"""How often intervals hold the truth: eight constants of `r600a-8cc` from noisy readings of two kinds.

    python tests/benchmarks/identify.py [REPETITIONS]

Four rating points with mass flow, power and discharge temperature, and an indicator diagram of 72
samples, with noise of 1 %, 1 %, 2 K and 1 % of the range. Printed are the time of the first fit with
compiling, that of a further one, and the share of repetitions whose 95 % interval holds the truth.
"""

import sys
import time
from dataclasses import replace

import numpy as np

from jaxcomp import load
from jaxcomp.machine import machine_of
from jaxcomp.study import Readings, Trace, identify
from jaxcomp.study.identification._common_factor import varied
from jaxcomp.study.identification._reading_model import ReadingModel

CONSTANTS = (
    "gas.clearance_ratio",
    "gas.suction.heating",
    "crankshaft.main_journal.coefficient",
    "motor.losses.efficiency",
    "gas.suction_valve.flow_coefficient",
    "gas.discharge_valve.flow_coefficient",
    "gas.suction_valve.stiffness",
    "gas.leakage.gap",
)
# [K] Temperatures of evaporation and condensation of the rating points.
CONDITIONS = ((248.0, 308.0), (248.0, 328.0), (258.0, 308.0), (258.0, 328.0))


def coverage(repetitions: int, starts: int = 1, conditions=CONDITIONS):
    """Names, share of repetitions whose 95 % interval holds the truth (n,), and seconds of each fit."""
    machine = machine_of(load("r600a-8cc"))
    names = [name for name in CONSTANTS if _has(machine, name)]
    truth = np.array([float(varied(machine, name).current(machine)) for name in names])
    evaporating, condensing = np.array(conditions).T
    count = len(conditions)
    gas, none = np.full(count, 305.35), np.full(count, np.nan)
    values = {name: np.ones(count) for name in ("mass_flow", "power", "discharge_temperature")}
    points = Readings("map", evaporating, condensing, gas, gas, gas, none, values)
    angle = np.radians(np.arange(0, 360, 5.0))
    trace = Trace("diagram", ("pressure",), angle, np.ones((1, angle.size)))
    variables = tuple(varied(machine, name) for name in names)
    exact = ReadingModel(machine, variables, [points, trace], {})
    start = np.concatenate([truth, [one.start for one in exact.nuisances]])
    value, _ = exact(start, range(exact.count))
    rows = {name: value[np.array(exact.entries.quantity) == name] for name in [*values, "pressure"]}
    deviation = {name: 0.01 * rows[name] for name in ("mass_flow", "power")}
    deviation["discharge_temperature"] = np.full(count, 2.0)
    deviation["pressure"] = np.full(angle.size, 0.01 * np.ptp(rows["pressure"]))
    vary = {name: (0.5 * x, 2.0 * x) for name, x in zip(names, truth, strict=True)}
    vary["motor.losses.efficiency"] = (0.7, 1.2)
    prior = {name: (x, 0.3 * x) for name, x in zip(names, truth, strict=True)}
    rng, inside, times = np.random.default_rng(0), np.zeros(len(names)), []
    for _ in range(repetitions):
        noisy = {k: rows[k] + deviation[k] * rng.standard_normal(rows[k].size) for k in rows}
        # a prior is a reading as well: its mean scatters about the truth
        known = {k: (m + sd * rng.standard_normal() / 3, sd / 3) for k, (m, sd) in prior.items()}
        given = [
            replace(points, measured={name: noisy[name] for name in values}),
            replace(trace, measured=noisy["pressure"][None], sd=deviation["pressure"][None]),
        ]
        begin = time.perf_counter()
        found = identify(machine, given, vary, known, starts=starts)
        times.append(time.perf_counter() - begin)
        low, high = found.fit.interval()
        inside += (low[: len(names)] < truth) & (truth < high[: len(names)])
    return names, inside / repetitions, np.array(times)


def main(repetitions: int) -> None:
    """Print the table."""
    names, shares, times = coverage(repetitions)
    print(f"first fit {times[0]:.1f} s, further ones {np.median(times):.1f} s")
    for name, share in zip(names, shares, strict=True):
        print(f"{name:45s} inside in {share:.0%}")
    print(f"{'all together':45s} inside in {shares.mean():.1%}")


def _has(machine, name: str) -> bool:
    try:
        return float(varied(machine, name).current(machine)) > 0
    except ValueError:
        return False


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
