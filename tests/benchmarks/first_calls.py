"""What a first call costs: every case in a process of its own, with where its time goes.

`python tests/benchmarks/first_calls.py` prints a table: seconds by the clock from the start of the
process to the result, those of the processor, of these what JAX says it spent on lowering and compiling,
and the rest: imports, reading the machine, tracing, running.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
CASES = {
    "run": "`jaxcomp run mayekawa-wbhe`, whole process",
    "orbit": "first default `solve_orbit`, import included",
    "gradient": "first value and gradient of the efficiency to all parameters, import included",
    "films": "`solve_orbit` of the machine with two film journals",
    "films_gradient": "its gradient to all parameters",
    "shooting_gradient": "gradient through `Shooting()`",
    "response_gradient": "response of `hermetic-68cc` with its gradient to all diameters",
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", choices=CASES)
    given = parser.parse_args()
    if given.case:
        print(json.dumps(measured(given.case)))
        return
    os.environ["JAXCOMP_CACHE"] = "off"
    print("| what | clock, s | processor, s | lowering | compiling | rest | programs |")
    print("|---|---|---|---|---|---|---|")
    for name, words in CASES.items():
        if name == "run":
            started = time.perf_counter()
            subprocess.run([sys.executable, "-m", "jaxcomp", "run", "mayekawa-wbhe"], check=True,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
            print(f"| {words} | {time.perf_counter() - started:.1f} | | | | | |", flush=True)
            continue
        run = [sys.executable, __file__, "--case", name]
        started = time.perf_counter()
        out = subprocess.run(run, check=True, capture_output=True, text=True).stdout
        clock, one = time.perf_counter() - started, json.loads(out.splitlines()[-1])
        columns = (one[key] for key in ("lower", "compile"))
        rest = one["processor"] - one["lower"] - one["compile"]
        texts = " | ".join(f"{x:.1f}" for x in (clock, one["processor"], *columns, rest))
        print(f"| {words} | {texts} | {one['programs']} |", flush=True)


def measured(name):
    """Seconds of one case, in this process."""
    os.environ["JAXCOMP_WAITS"] = "off"
    import jax

    spent = {"lower": 0.0, "compile": 0.0, "programs": 0}
    kinds = {"jaxpr_to_mlir_module": "lower", "backend_compile": "compile"}

    def heard(event, seconds, **_):
        kind = kinds.get(event.rsplit("/", 1)[-1].removesuffix("_duration"))
        if kind:
            spent[kind] += seconds
            spent["programs"] += kind == "compile"

    jax.monitoring.register_event_duration_secs_listener(heard)
    jax.block_until_ready(globals()[name]())
    return spent | {"processor": time.process_time()}


def orbit():
    from jaxcomp import load, solve_orbit

    return solve_orbit(load("mayekawa-wbhe")).mechanical_efficiency


def gradient_of(machine, solver=None):
    import equinox as eqx

    from jaxcomp import solve_orbit

    def efficiency(machine):
        return solve_orbit(machine, solver, throw=False).mechanical_efficiency

    return eqx.filter_jit(eqx.filter_value_and_grad(efficiency))(machine)


def gradient():
    from jaxcomp import load

    return gradient_of(load("mayekawa-wbhe").compressor)


def machine_with_films():
    from helpers import with_films

    from jaxcomp import load

    return with_films(load("mayekawa-wbhe").compressor)


def films():
    from jaxcomp import solve_orbit

    return solve_orbit(machine_with_films(), throw=False).mechanical_efficiency


def films_gradient():
    return gradient_of(machine_with_films())


def shooting_gradient():
    from jaxcomp import Shooting, load

    return gradient_of(load("mayekawa-wbhe").compressor, Shooting())


def response_gradient():
    import equinox as eqx
    import jax.numpy as jnp

    from jaxcomp import load
    from jaxcomp.rotor import respond
    from jaxcomp.vibration import loaded_rotor

    machine = load("hermetic-68cc").assembly
    speed = jnp.array([314.0])
    model, loads = loaded_rotor(machine, speed), machine.given_loads or machine.unbalances
    diameters = [shaft.outer_diameter for shaft in model.shafts]

    def vibration(diameters):
        changed = eqx.tree_at(lambda m: [s.outer_diameter for s in m.shafts], model, diameters)
        motion = respond(changed, loads, speed)
        return jnp.sum(jnp.abs(motion.displacement) ** 2)

    return eqx.filter_jit(eqx.filter_value_and_grad(vibration))(diameters)


if __name__ == "__main__":
    main()
