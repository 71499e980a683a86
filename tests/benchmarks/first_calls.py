"""What a first call costs: every case in a process of its own, with nothing kept, and a second time.

    python tests/benchmarks/first_calls.py [--only WORD]

prints a table: seconds of the processor of the whole process at the first start and at the second, which
finds the programs of the first; the same of a second start in Python after `jaxcomp.keep_programs()`,
which keeps more than whole solutions, as commands do; of the first start, what JAX says it spent on
lowering and compiling, and how many programs there were. The remainder is imports, reading the machine,
tracing, running.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
# A command, or the name of a function below.
CASES = {
    "jaxcomp run mayekawa-wbhe": "",
    "jaxcomp run mayekawa-8wbhe": "",
    "jaxcomp run slider-link-8cc": "",
    "jaxcomp run r600a-8cc": "",
    "jaxcomp respond hermetic-68cc": "",
    "jaxcomp sensitivity r134a-7cc": "",
    "orbit": "first default `solve_orbit`",
    "gradient": "first value and gradient of the efficiency to all parameters",
    "films": "`solve_orbit` of the machine with two film journals",
    "films_gradient": "its gradient to all parameters",
    "cycle": "`solve_cycle` of `r290-6cc`, its crank at constant speed",
    "valves": "`solve_orbit` of `r134a-7cc`",
    "valves_gradient": "its gradient to all parameters",
    "shooting_gradient": "gradient through `Shooting()`",
    "response_gradient": "response of `hermetic-68cc` with its gradient to all diameters",
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--keep", action="store_true", help="the case after `keep_programs()`")
    parser.add_argument("--only", default="", help="cases with this word")
    given = parser.parse_args()
    if given.case:
        measured(given.case, given.keep)
        return
    print("| what | first start, s | second | keeping all | lowering | compiling | programs |")
    print("|---|---|---|---|---|---|---|")
    for name, words in CASES.items():
        if given.only in name:
            with tempfile.TemporaryDirectory() as folder:
                starts = [start(name, folder) for _ in range(2)]
                # the first of these two keeps what is missing
                if words:
                    starts.append([start(name, folder, keep=True) for _ in range(2)][-1])
            spent = [f"{costs['processor']:.1f}" for costs in starts]
            columns = " | ".join(spent if words else [*spent, ""])
            first = starts[0]
            parts = " | ".join(f"{first[part]:.1f}" for part in ("lower", "compile"))
            print(
                f"| {words or f'`{name}`'} | {columns} | {parts} | {first['programs']} |",
                flush=True,
            )


def start(name, folder, *, keep=False):
    """What a case costs in a process of its own, whose programs are kept in a folder."""
    environment = {**os.environ, "JAXCOMP_CACHE": folder, "JAXCOMP_WAITS": "off"}
    command = [sys.executable, __file__, "--case", name]
    if keep:
        command.append("--keep")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = sum(getattr(after, part) - getattr(before, part) for part in ("ru_utime", "ru_stime"))
    return json.loads(out.stderr.splitlines()[-1]) | {"processor": spent}


def measured(name, keep):
    """Run a case in this process, and tell on standard error what JAX spent."""
    import jax

    import jaxcomp

    spent = {"lower": 0.0, "compile": 0.0, "programs": 0}
    kinds = {"jaxpr_to_mlir_module": "lower", "backend_compile": "compile"}

    def heard(event, seconds, **_):
        kind = kinds.get(event.rsplit("/", 1)[-1].removesuffix("_duration"))
        if kind:
            spent[kind] += seconds
            spent["programs"] += kind == "compile"

    jax.monitoring.register_event_duration_secs_listener(heard)
    if name.startswith("jaxcomp "):
        from jaxcomp.__main__ import main as program

        sys.argv = name.split()
        with suppress(SystemExit):
            program()
    else:
        if keep:
            jaxcomp.keep_programs()
        jax.block_until_ready(globals()[name]())
    print(json.dumps(spent), file=sys.stderr)


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


def cycle():
    from jaxcomp import load
    from jaxcomp.cylinder import solve_cycle

    machine = load("r290-6cc").as_compressor()
    solution = solve_cycle(machine.gas, machine.mechanism, machine.motor.speed_guess)
    return solution.volumetric_efficiency


def valves():
    from jaxcomp import load, solve_orbit

    return solve_orbit(load("r134a-7cc").compressor, throw=False).mechanical_efficiency


def valves_gradient():
    from jaxcomp import load

    return gradient_of(load("r134a-7cc").compressor)


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
