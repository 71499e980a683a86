"""The periodic state in float32 beside float64: error in efficiency and time of a warm call.

Run `python tests/benchmarks/precision.py [MACHINE]`. JAX has one precision for a process, so that float32
is measured in a second one. Errors are relative to 24 nodes a panel in float64.
"""

import json
import os
import subprocess
import sys

SETTINGS = [(nodes, reversals, tol) for nodes, reversals in ((8, 0), (32, 0), (8, None))
            for tol in (1e-4, 1e-6)]  # fmt: skip


def measured(name):
    """Efficiency and seconds of every setting, and of the reference, in the precision of this process."""
    from jaxcomp import Collocation, load, solve_orbit
    from jaxcomp.study.accuracy._study import Program

    machine = load(name).compressor

    def one(nodes, reversals, tolerance):
        reversals = machine.mechanism.load_reversals if reversals is None else reversals
        solver = Collocation(nodes, reversals, tolerance=tolerance)
        program = Program(
            lambda m: solve_orbit(m, solver, throw=False).mechanical_efficiency, machine
        )
        return float(program(machine)), program.timed(machine)

    return [one(24, None, 1e-13 if os.environ.get("JAX_ENABLE_X64") != "0" else 1e-6),
            *(one(*setting) for setting in SETTINGS)]  # fmt: skip


def main():
    name = next((word for word in sys.argv[1:] if word != "--single"), "mayekawa-wbhe")
    if "--single" in sys.argv:
        print(json.dumps(measured(name)))
        return
    double = measured(name)
    run = [sys.executable, __file__, name, "--single"]
    environment = os.environ | {"JAXCOMP_X64": "0", "JAX_ENABLE_X64": "0"}
    done = subprocess.run(run, check=True, capture_output=True, text=True, env=environment)
    single, exact = json.loads(done.stdout.splitlines()[-1]), double[0][0]
    print(f"{'setting':40s}{'float64':>24s}{'float32':>24s}")
    for setting, *found in zip(SETTINGS, double[1:], single[1:], strict=True):
        words = "nodes={} reversals={} tolerance={:g}".format(*setting)
        cells = (f"{abs(eta / exact - 1):10.1e}{seconds * 1e3:11.3f} ms" for eta, seconds in found)
        print(f"{words:40s}" + "".join(f"{cell:>24s}" for cell in cells))


if __name__ == "__main__":
    main()
