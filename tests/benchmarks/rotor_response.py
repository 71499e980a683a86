"""Time and memory of the harmonic response and its gradient, beside NumPy and (if there) ROSS.

    python tests/benchmarks/rotor_response.py                 # jaxcomp and NumPy
    python tests/benchmarks/rotor_response.py --ross PYTHON   # ROSS too, with its own interpreter

Every measurement runs in a process of its own: best of the warm runs, the first call (with the
compilation) beside it, and the growth of the peak resident memory from before the first call. NumPy
solves one dense system per speed with the matrices of the same model. The gradient of jaxcomp is that
of a sum of squared amplitudes over all numbers of the model; the others take differences over 40
outer diameters, and only at the fewest speeds, because more take minutes. The 41-element model is a
rotor in three bearings, which ROSS can describe; the one of 65 nodes adds a crankcase line with side
pull, and a rigid housing on its suspension; the bundled machine has two rigid bodies, damping in its
shafts and three films, whose coefficients belong to the response at each speed.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time

SPEEDS = (1, 100, 1000)
DIFFERENCES = 40  # diameters that a finite-difference gradient moves one by one


def rotor_41():
    """41 elements, 42 nodes of 4 degrees of freedom, three bearings, three disks."""
    import numpy as np

    from jaxcomp.rotor import ConstantLaw, Disks, Link, RotorModel, shaft_line

    law = ConstantLaw([[2e7, 1e6], [-1e6, 3e7]], [[5e3, 0.0], [0.0, 5e3]])
    shaft = shaft_line(
        tuple(range(1, 43)),
        length=0.008,
        outer_diameter=np.where(np.arange(41) < 20, 0.05, 0.024),
        young_modulus=2.06e11,
        density=7800.0,
        poisson=0.3,
    )
    disks = Disks((10, 22, 34), [0.5, 0.3, 0.2], [1e-4] * 3, [2e-4] * 3)
    return RotorModel((shaft,), (disks,), links=tuple(Link((n, None), law) for n in (30, 37, 42)))


def machine_65():
    """Rotor of 41 nodes, crankcase line of 24, magnetic pull on six pairs, rigid housing below."""
    import jax.numpy as jnp

    from jaxcomp.rotor import (
        ConstantLaw,
        Disks,
        Link,
        MagneticPull,
        RigidBody,
        RotorModel,
        diagonal,
        isotropic,
        shaft_line,
    )

    steel = {"young_modulus": 2.06e11, "density": 7800.0, "poisson": 0.3}
    rotor = shaft_line(tuple(range(1, 42)), length=0.008, outer_diameter=0.024, **steel)
    case = shaft_line(
        tuple(range(42, 66)),
        length=0.008,
        outer_diameter=0.12,
        inner_diameter=0.1,
        spins=False,
        **steel,
    )
    law = ConstantLaw([[2e7, 1e6], [-1e6, 3e7]], [[5e3, 0.0], [0.0, 5e3]])
    links = [Link(pair, law) for pair in ((30, 50), (37, 60), (41, 65))]
    links += [Link((n, f"h{n}"), isotropic(2e4, 20.0)) for n in (44, 63)]
    foot = diagonal([1e4, 1e4, 100.0, 100.0], [10.0, 10.0, 1.0, 1.0])
    links.append(Link(("housing", None), foot, ("ux", "uy", "thx", "thy")))
    housing = RigidBody(
        "housing",
        ("h44", "h63"),
        [[0, 0, -0.1], [0, 0, 0.1]],
        7.0,
        jnp.diag(jnp.array([0.1, 0.1, 0.06])),
    )
    pull = MagneticPull(tuple(zip(range(3, 9), range(51, 57), strict=True)), 3e5)
    disks = Disks((10, 20, 32), [0.5, 0.3, 0.2], [1e-4] * 3, [2e-4] * 3)
    return RotorModel((rotor, case), (disks,), (), tuple(links), (pull,), (housing,))


def hermetic():
    """The rotor of the bundled machine, its films under the loads of its crank."""
    import numpy as np

    import jaxcomp

    return jaxcomp.rotor_at(jaxcomp.load("hermetic-68cc"), np.linspace(50.0, 800.0, 16))


MODELS = {
    "41 elements": (rotor_41, (6, 13, 40)),
    "65 nodes": (machine_65, (6, 13, 48)),
    "hermetic": (hermetic, (6, 13, 21)),
}


def measured(run):
    """Peak memory in MB above the start, first call and best of three later ones in seconds."""
    peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # noqa: E731
    before, start = peak(), time.perf_counter()
    run()
    first, warm = time.perf_counter() - start, []
    for _ in range(5):
        start = time.perf_counter()
        run()
        warm.append(time.perf_counter() - start)
    return {"first": first, "warm": min(warm), "memory": peak() - before}


def by_jaxcomp(model, count, gradient):
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from jaxcomp.rotor import Unbalances, respond

    build, nodes = MODELS[model]
    rotor, speeds = build(), jnp.linspace(50.0, 800.0, count)
    loads = (Unbalances(nodes, [8e-4, 1e-3, 5e-4], [0.0, 3.0, 1.0]),)
    if not gradient:
        return measured(lambda: jax.block_until_ready(respond(rotor, loads, speeds)))

    @eqx.filter_jit
    @eqx.filter_grad
    def slope(rotor, speeds):
        x = respond(rotor, loads, speeds, nodes=nodes).displacement
        return jnp.sum(jnp.abs(x[..., :2]) ** 2)

    return measured(lambda: jax.block_until_ready(slope(rotor, speeds)))


def by_numpy(model, count, gradient):
    import equinox as eqx
    import numpy as np

    from jaxcomp.rotor import matrices

    build, _ = MODELS[model]
    rotor, speeds = build(), np.linspace(50.0, 800.0, count)
    place = lambda m: m.shafts[0].outer_diameter  # noqa: E731

    def assembled(rotor):
        return [np.asarray(a) for a in matrices(rotor, 300.0)[:4]]

    def amplitudes(m, c, g, k):
        force = np.ones(len(m), complex)
        solve = lambda w: np.linalg.solve(k - w**2 * m + 1j * w * (c + w * g), force)  # noqa: E731
        return sum(np.sum(np.abs(solve(w)) ** 2) for w in speeds)

    full = assembled(rotor)
    if not gradient:
        return measured(lambda: amplitudes(*full))

    def differences():
        base = amplitudes(*full)
        for i in range(DIFFERENCES):
            d = np.array(place(rotor))
            d[i % d.size] *= 1 + 1e-6
            (amplitudes(*assembled(eqx.tree_at(place, rotor, d))) - base) / 1e-6

    return measured(differences)


ROSS = """
import sys, json, time, resource, warnings
warnings.filterwarnings("ignore")
import numpy as np, ross
steel = ross.Material("s", rho=7800.0, E=2.06e11, Poisson=0.3)
def build(moved=-1):
    d = [0.05 if i < 20 else 0.024 for i in range(41)]
    d = [x * (1 + 1e-6 * (i == moved)) for i, x in enumerate(d)]
    shaft = [ross.ShaftElement(L=0.008, idl=0.0, odl=x, material=steel, n=i)
             for i, x in enumerate(d)]
    return ross.Rotor(shaft, disks, bearings)
disks = [ross.DiskElement(n=n, m=m, Id=1e-4, Ip=2e-4) for n, m in ((9, 0.5), (21, 0.3), (33, 0.2))]
bearings = [ross.BearingElement(n=n, kxx=2e7, kxy=1e6, kyx=-1e6, kyy=3e7, cxx=5e3, cyy=5e3)
            for n in (29, 36, 41)]
speeds = np.linspace(50.0, 800.0, int(sys.argv[1]))
def respond(rotor):
    rotor.run_unbalance_response([5, 12, 39], [8e-4, 1e-3, 5e-4], [0.0, 3.0, 1.0], speeds)
fresh = [build() for _ in range(4)]  # a rotor keeps its matrices, so that a second run is no run
if sys.argv[2] == "gradient":
    run = lambda: [respond(build(i)) for i in range(-1, int(sys.argv[3]))]
else:
    run = lambda: respond(fresh.pop())
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before, start = peak(), time.perf_counter()
run(); first = time.perf_counter() - start; warm = [first]
for _ in range(3 if warm[0] < 10 else 0):
    start = time.perf_counter(); run(); warm.append(time.perf_counter() - start)
print(json.dumps({"first": first, "warm": min(warm), "memory": peak() - before}))
"""


def child(command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ross", metavar="PYTHON", help="interpreter that has ROSS")
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        who, model, count, gradient = options.one
        run = {"jaxcomp": by_jaxcomp, "numpy": by_numpy}[who]
        print(json.dumps(run(model, int(count), gradient == "gradient")))
        return
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{'model':12s}{'program':20s}{'speeds':>7s}{'first s':>9s}{'warm ms':>10s}"
          f"{'us/speed':>10s}{'MB':>8s}")  # fmt: skip
    for model in MODELS:
        for count in SPEEDS:
            for who, what in (
                ("jaxcomp", "value"),
                ("jaxcomp", "gradient"),
                ("numpy", "value"),
                ("numpy", "gradient"),
                ("ross", "value"),
                ("ross", "gradient"),
            ):
                if what == "gradient" and who != "jaxcomp" and count > SPEEDS[0]:
                    continue
                command = [sys.executable, __file__, "--one", who, model, str(count), what]
                if who == "ross":
                    if not options.ross or model != "41 elements":
                        continue
                    command = [options.ross, "-c", ROSS, str(count), what, str(DIFFERENCES)]
                show(model, f"{who}, {what}", count, child(command))


def show(model, name, count, one):
    each = one["warm"] / count * 1e6
    print(f"{model:12s}{name:20s}{count:7d}{one['first']:9.2f}{one['warm'] * 1e3:10.2f}"
          f"{each:10.0f}{one['memory']:8.0f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
