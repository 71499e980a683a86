"""Sweeps that several tests run, in this process and in others; as a script, one of them.

`python sweep_runs.py KIND [key=value ...]`: see `main`.
"""

import os
import sys
from pathlib import Path

import numpy as np

# without estimated errors, which no sweep here looks at and which make a program a third larger
FAST = {"nodes": 5, "reversals": 0, "tolerance": 1e-5, "estimate": False}


def machine():
    from jaxcomp import load

    return load("mayekawa-wbhe")


def fast_options():
    from jaxcomp import Collocation
    from jaxcomp.study import AnalysisOptions

    return AnalysisOptions(Collocation(**FAST))


def small(**options):
    """A grid of 21 bores and 10 speeds, seven groups of 32 with a rest."""
    from jaxcomp import sweep
    from jaxcomp.study.sweep import grid

    over = {"bore_at_displacement": grid(0.1, 0.15, 21), "motor.mean_speed": grid(60.0, 140.0, 10)}
    return sweep(machine(), over, ["mechanical_efficiency"], options=fast_options(), **options)


def many(out, count=10_000, batch=128, **options):
    """Samples in many blocks, of the program of `small`."""
    from jaxcomp import sweep
    from jaxcomp.study.sweep import normal, uniform

    over = {
        "bore_at_displacement": uniform(0.11, 0.15),
        "motor.mean_speed": normal(100.0, 5.0),
    }
    options = {"options": fast_options(), "samples": count, "seed": 3, "batch": batch} | options
    return sweep(machine(), over, ["mechanical_efficiency"], out=out, **options)


def cheap(out, count, **options):
    """Samples of a quantity that costs next to nothing."""
    from jaxcomp import sweep
    from jaxcomp.study.sweep import uniform

    over = {"bore_at_displacement": uniform(0.11, 0.15), "mechanism.offset": uniform(0.0, 0.01)}
    return sweep(machine(), over, ["swept_volume"], out=out, samples=count, **options)


def volumes(out, **options):
    """A cheap one in many blocks."""
    return cheap(out, 20_000, batch=256, **options)


def command(kind, **options):
    """The command line and the environment that run this file in another process."""
    environment = dict(os.environ) | {"JAXCOMP_X64": "1"}
    given = [f"{key}={value}" for key, value in options.items()]
    return [sys.executable, str(Path(__file__)), kind, *given], environment


def main(kind, out, devices="", count=""):
    """Run one sweep.

    Args:
        kind: "devices" (both numbers of devices, arrays to the file `out`), "many" (to a store) or
            "memory" (prints by how many kB the peak grew).
        out: where to.
        devices: host devices to share.
        count: of samples.
    """
    if kind == "devices":
        values = [small(devices=n).mechanical_efficiency.values for n in (1, int(devices))]
        np.save(out, np.stack(values))
    elif kind == "many":
        many(out)
    elif kind == "memory":
        import resource

        cheap(out, 10_000)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        cheap(f"{out}-more", int(count))
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)


if __name__ == "__main__":
    main(sys.argv[1], **dict(text.split("=", 1) for text in sys.argv[2:]))


def with_nodes(nodes):
    """Efficiencies of a few designs with so many nodes, and the process that found them."""
    from jaxcomp import Collocation, sweep
    from jaxcomp.study import AnalysisOptions

    options = AnalysisOptions(Collocation(nodes=nodes))
    over = {"bore_at_displacement": [0.12, 0.13, 0.14]}
    found = sweep(machine(), over, ["mechanical_efficiency"], options=options, progress=False)
    return os.getpid(), found.mechanical_efficiency.values
