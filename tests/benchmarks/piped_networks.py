"""Random pipes of suction and discharge up to 20 % of pulsation, from nothing: the share solved.

    python tests/benchmarks/piped_networks.py [COUNT]

Single pipes with a resistance at the line, and pipes with a branch or a bottle; lengths of 0.3 to 6 m,
diameters of 25 to 70 mm, resistances of 0.02 to 0.2 of the pipe's own impedance. What is not solved has a
status. Figures are on two cores with other programs beside.
"""

import sys
import time
from collections import Counter
from pathlib import Path

import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from reference_pipes import SPEED, crank, cylinder

from jaxcomp import Status
from jaxcomp._core.status import names_of_codes
from jaxcomp.cylinder import solve_cycle
from jaxcomp.piping import ClosedEnd, Orifice, Pipes, Piping, Volume

_SOUND = {"suction": 347.2, "discharge": 423.2}


def random_piping(rng: np.random.Generator, side: str, kind: str) -> Piping:
    """A network of a few kinds, so that programs are few."""
    length = float(rng.uniform(0.3, 6.0))
    diameter = float(rng.uniform(0.032, 0.07) if side == "suction" else rng.uniform(0.025, 0.05))
    impedance = _SOUND[side] / (np.pi / 4 * diameter**2)
    hole = Orifice(("far", "line"), resistance=float(rng.uniform(0.02, 0.2)) * impedance)
    attenuation = float(rng.uniform(0.005, 0.03))
    temperature = 445.8 if side == "discharge" else None
    share = float(rng.uniform(0.2, 0.8))
    if kind == "pipe":
        pipes = (Pipes(("flange", "far"), length, diameter, attenuation=attenuation),)
        return Piping(pipes, orifices=(hole,), temperature=temperature)
    parts = [share * length, (1 - share) * length]
    chain = Pipes(("flange", "middle", "far"), parts, diameter, attenuation=attenuation)
    if kind == "bottle":
        volumes = (Volume("middle", float(10 ** rng.uniform(-3.5, -2))),)
        return Piping((chain,), volumes, (hole,), temperature=temperature)
    branch = Pipes(
        ("middle", "stub"), float(rng.uniform(0.2, 2.5)), diameter, attenuation=attenuation
    )
    return Piping((chain, branch), (), (hole,), (ClosedEnd("stub"),), temperature=temperature)


def main(count: int) -> None:
    """Solve them one after the other."""
    rng = np.random.default_rng(56)
    kinds = [
        (side, kind) for kind in ("pipe", "branch", "bottle") for side in ("suction", "discharge")
    ]
    outcomes = Counter()
    tried = 0
    within = 0
    seconds = []
    while within < count:
        side, kind = kinds[tried % len(kinds)]
        tried += 1
        begin = time.process_time()
        machine = cylinder(**{side: random_piping(rng, side, kind)})
        cycle = solve_cycle(machine, crank(), jnp.asarray(SPEED), throw=False)
        seconds.append(time.process_time() - begin)
        name = str(names_of_codes(int(cycle.status._value)))
        largest = float(cycle.pulsation.largest)
        if cycle.status == Status.converged and largest > 0.2:
            continue  # beyond what is looked at
        within += 1
        outcomes[name] += 1
        if name != "converged":
            print(f"{side} {kind}: {name}, {largest:.1%} peak to peak", flush=True)
    solved = outcomes["converged"]
    print(f"{solved} of {within} up to 20 % solved ({tried} tried): {dict(outcomes)}")
    print(f"median {1e3 * np.median(seconds):.0f} ms of the processor, compiling in the slowest")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
