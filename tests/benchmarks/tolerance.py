"""A million machines of a scatter: efficiency with the crank solved, vibration with scattered masses.

Run `python tests/benchmarks/tolerance.py [--samples 1000000]`. Wall clock with warm programs on all
cores; beside it what derivatives, and the nearest points of a limit, say of the same scatter.
"""

import argparse
import os
import time

import numpy as np

CORES = len(os.sched_getaffinity(0))


def timed(call):
    start = time.perf_counter()
    found = call()
    return found, time.perf_counter() - start


def report(name, scene, tolerances, quantity, limit, options, samples):
    from jaxcomp import tolerance
    from jaxcomp.study.tolerance._moments import sampled

    study, first = timed(
        lambda: tolerance(
            scene,
            tolerances,
            [quantity],
            limits={quantity: limit},
            options=options,
            samples=4096,
            progress=False,
        )
    )
    given = (study.problem, study.scatter, study.nominal)
    many, seconds = timed(lambda: sampled(*given, samples, progress=False))
    print(f"\n{name}, {len(tolerances)} tolerances")
    print(f"  the first study, 4096 samples, with compiling   {first:8.1f} s")
    print(f"  {samples:,} samples, warm                      {seconds:8.1f} s")
    print(f"  machines a second                               {samples / seconds:8,.0f}")
    rows = [("samples", many.mean[0], many.deviation[0])]
    rows.append(("first order", study.first_order.mean[0], study.first_order.deviation[0]))
    rows.append(("second order", study.second_order.mean[0], study.second_order.deviation[0]))
    for word, mean, deviation in rows:
        print(f"  {word:14s} mean {mean:.6g}, deviation {deviation:.4g}")
    print(
        f"  standard errors of the samples {many.mean_error[0]:.1e}, {many.deviation_error[0]:.1e}"
    )
    risk = study.reliability[0]
    bad = many.values[:, 0] > risk.limit.bound
    share = np.mean(bad if risk.limit.above else ~bad)
    print(
        f"  beyond {risk.limit.bound:g}: samples {share:.3e}, first order {risk.first_order:.3e}, "
        f"second {risk.second_order:.3e}, about the points {risk.near_points:.3e} "
        f"± {risk.near_points_error:.0e}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1_000_000)
    given = parser.parse_args()
    import jax

    jax.config.update("jax_num_cpu_devices", CORES)
    from jaxcomp import Collocation, load, within
    from jaxcomp.machine import machine_of
    from jaxcomp.study import AnalysisOptions, balanced_design

    print(f"jax {jax.__version__}, {CORES} cores, load {os.getloadavg()[0]:.1f}")
    friction = {
        f"friction.{joint}.coefficient": within(0.2, relative=True)
        for joint in ("wall", "piston_pin", "crank_pin", "main_journal")
    }
    options = AnalysisOptions(Collocation(nodes=10, reversals=0, tolerance=1e-5))
    report(
        "efficiency of the machine of Tsuji et al.", load("mayekawa-wbhe"), friction,
        "mechanical_efficiency", (0.9, None), options, given.samples,
    )  # fmt: skip
    balanced = balanced_design(machine_of(load("hermetic-68cc")), AnalysisOptions())
    masses = [f"loads.unbalances.0.magnitude.{i}" for i in range(2)]
    masses += [f"loads.unbalances.1.magnitude.{i}" for i in range(4)]
    masses += [f"corrections.{plane}.magnitude" for plane in balanced.corrections]
    report(
        "vibration of the balanced hermetic machine", balanced,
        {name: within(0.05, relative=True) for name in masses}, "vibration", (None, 8e-6),
        AnalysisOptions(), given.samples,
    )  # fmt: skip


if __name__ == "__main__":
    main()
