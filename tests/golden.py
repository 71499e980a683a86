"""Golden values of the crank: `python tests/golden.py [MACHINE ...]` writes them into tests/golden.json.

They guard against drift when the code is rearranged, nothing more: literature, independent programs and
finite differences are tested elsewhere. Values are kept with all digits, gradients as elasticities
d ln(result)/d ln(number) of the numbers that the result depends on, by the path of the number.
"""

import json
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from helpers import named_leaves

from jaxcomp import load, solve_orbit
from jaxcomp.crank import Collocation

FILE = Path(__file__).with_suffix(".json")
# One machine of each kind. Where kinks of cylinders coincide, as in mayekawa-4wbhe, slopes without
# located reversals are those of one side or the other.
MACHINES = {
    "mayekawa-wbhe": None,
    "slider-link-8cc": None,
    "hermetic-68cc": None,
    "refrigeration-twin": Collocation(reversals=0, nodes=12),
    "mayekawa-4wbhe": None,
    "two-stage-crosshead": Collocation(reversals=0, nodes=12),
}
WITH_VALVES = ("r134a-7cc", "process-two-stage")
RESULTS = ("mechanical_efficiency", "speed_fluctuation", "motor_power")
# The speed of an in-line twin has two equal maxima: which of them a derivative follows is rounding.
SYMMETRIC = ("refrigeration-twin",)


def values_of(name: str) -> dict[str, float]:
    """Headline numbers, losses [J] and largest joint forces [N] of a bundled machine."""
    orbit = solve_orbit(load(name), MACHINES.get(name))
    found = {key: getattr(orbit, key) for key in RESULTS}
    found |= {f"losses.{key}": value for key, value in orbit.energy.losses.items()}
    found |= {f"peak_forces.{key}": value for key, value in orbit.peak_forces.items()}
    if orbit.cycle is not None:
        found |= {"mass_flow": orbit.cycle.mass_flow}
        pressures = getattr(orbit.cycle, "pressure_behind_stages", {})
        found |= {f"interstage_pressures.{number}": value for number, value in pressures.items()}
    return {key: float(value) for key, value in found.items()}


def elasticities_of(name: str) -> dict[str, dict[str, list[float] | float]]:
    """d ln(result)/d ln(number) of every number of the machine, by reverse mode, without zeros."""
    machine, solver = load(name).machine, MACHINES.get(name)
    keys = RESULTS[: 1 if name in SYMMETRIC else 2]

    def results(machine):
        orbit = solve_orbit(machine, solver, throw=False)
        return jnp.stack([jnp.log(jnp.abs(getattr(orbit, key))) for key in keys])

    leaves = named_leaves(machine)
    slopes = named_leaves(jax.jit(jax.jacrev(results))(machine))
    found = {}
    for row, key in enumerate(keys):
        scaled = {path: np.asarray(slopes[path][row] * leaf) for path, leaf in leaves.items()}
        found[key] = {path: value.tolist() for path, value in scaled.items() if np.any(value)}
    return found


def main(names: list[str]) -> None:
    """Write the file; with names those machines of it."""
    made = json.loads(FILE.read_text()) if names else {}
    for name in names or (*MACHINES, *WITH_VALVES):
        made[name] = {"values": values_of(name)}
        if name not in WITH_VALVES:
            made[name]["elasticities"] = elasticities_of(name)
        print(name, file=sys.stderr)
    FILE.write_text(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
