"""Error against run time of the journal-bearing film: reference, evaluators, closed forms, ROSS.

    python tests/benchmarks/film.py                 # jaxcomp
    python tests/benchmarks/film.py --ross PYTHON   # ROSS too, with an interpreter that has it

Errors are the largest over places drawn from eps 0.01 to 0.97 and L/D 0.1 to 2, against the reference
solution on 960 x 64 cells of the same film: plain ring, Swift-Stieber; the grooved table against the
grooved solver. The other models stand beside the plain ring, so that theirs is the error of the model.
Load and friction are relative, stiffness and damping over the largest entry. Times are per point, warm,
of one batch: the best of three; the gradient is that of the sum over the points with respect to load and
L/D.
"""

import argparse
import json
import os
import platform
import subprocess
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import film as films
from jaxcomp.film._film import AbstractCarryingFilm, film_ratio, load_number_at
from jaxcomp.film._reference import GRIDS

EPS, RATIOS = (0.01, 0.97), (0.1, 2.0)
CASE = {"eps": 0.65, "length_ratio": 0.5}  # where ROSS's classes are compared


def places(count, low=RATIOS[0], seed=3):
    rng = np.random.default_rng(seed)
    eps = rng.uniform(*EPS, count)
    # half of them crowd at the heavy load, where everything is steep
    eps[::2] = 1 - np.exp(rng.uniform(np.log(1 - EPS[1]), 0, count)[::2]) * (1 - EPS[0])
    return eps, np.exp(rng.uniform(np.log(low), np.log(RATIOS[1]), count))


def evaluated(model):
    """Load, friction from load and, if there are any, stiffness and damping at positions."""

    def one(eps, q):
        film = model(q)
        load = load_number_at(film, eps)
        out = [load, film.friction_number(load)]
        if isinstance(film, films.AbstractSolvedFilm):
            out += films.dynamic_coefficients(film, load)
        return out

    return eqx.filter_jit(lambda eps, q: jax.vmap(one)(eps, q))


def errors(model, solved, eps, q):
    """Largest error of load, friction, stiffness and damping."""
    keep = (q >= model.length_ratio_range[0]) & (q <= model.length_ratio_range[1])
    found = evaluated(model)(jnp.asarray(eps[keep]), jnp.asarray(q[keep]))
    exact = [s for s, k in zip(solved, keep, strict=True) if k]
    names = "load_number", "friction_number", "stiffness", "damping"
    worst = []
    for name, ours in zip(names, found, strict=False):
        theirs = np.array([getattr(s, name) for s in exact])
        scale = np.abs(theirs).reshape(len(exact), -1).max(axis=1)
        off = np.abs(np.asarray(ours) - theirs).reshape(len(exact), -1).max(axis=1)
        worst.append(np.max(off / scale))
    return worst + [np.nan] * (4 - len(worst))


def best(function, *arguments, repeat=3):
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)


def tasks(model, ratio=None):
    """What is asked at a load and an L/D; `ratio` fixes the L/D outside the batch."""
    fixed = None if ratio is None else model(ratio)
    film = (lambda q: fixed) if ratio is not None else model
    yield "friction of load", lambda load, q: film(q).friction_number(load)
    if issubclass(model, AbstractCarryingFilm):
        yield (
            "load of position",
            lambda load, q: (lambda f: load_number_at(f, load / (1 + load)))(film(q)),
        )
        yield "position of load", lambda load, q: film_ratio(film(q), load)
    if issubclass(model, films.AbstractSolvedFilm):
        yield (
            "K and C of load",
            lambda load, q: sum(jnp.sum(a) for a in films.dynamic_coefficients(film(q), load)),
        )


def timed(model, name, count, ratio=None):
    rng = np.random.default_rng(1)
    low = max(model.length_ratio_range[0], RATIOS[0])
    load = jnp.asarray(np.exp(rng.uniform(np.log(1e-3), np.log(1e2), count)))
    q = jnp.asarray(np.exp(rng.uniform(np.log(low), np.log(RATIOS[1]), count)))
    for task, function in tasks(model, ratio):
        many = jax.jit(jax.vmap(function))
        slope = jax.jit(jax.grad(lambda a, b, f=function: jnp.sum(jax.vmap(f)(a, b)), (0, 1)))
        value, gradient = (best(f, load, q) / count * 1e6 for f in (many, slope))
        where = "L/D too" if ratio is None else "one L/D"
        print(f"{name:18s}{task:20s}{where:10s}{value:12.3f}{gradient:12.3f}", flush=True)


def reference_rows(grooved):
    """Time and error of the solver itself, grid by grid, against 1440 x 96 cells."""
    eps, q = places(3)
    options = {"grooved": grooved}
    finest = tuple((3 * a // 2, 3 * b // 2) for a, b in GRIDS)
    exact = [
        films.reference_solution(e, r, grids=finest, **options) for e, r in zip(eps, q, strict=True)
    ]
    label = "grooved" if grooved else "plain ring"
    for n in range(2 + grooved, len(GRIDS) + 1):
        start = time.perf_counter()
        found = [
            films.reference_solution(e, r, grids=GRIDS[:n], **options)
            for e, r in zip(eps, q, strict=True)
        ]
        seconds = (time.perf_counter() - start) / len(found)
        off = [abs(a.load_number / b.load_number - 1) for a, b in zip(found, exact, strict=True)]
        k, c = (
            max(
                np.abs(getattr(a, m) - getattr(b, m)).max() / np.abs(getattr(b, m)).max()
                for a, b in zip(found, exact, strict=True)
            )
            for m in ("stiffness", "damping")
        )
        cells = f"{GRIDS[n - 1][0]} x {GRIDS[n - 1][1]}"
        print(f"{label:18s}{cells:20s}{max(off):12.1e}{k:12.1e}{c:12.1e}{seconds * 1e3:12.0f}")


ROSS = """
import sys, json, time, warnings
warnings.filterwarnings("ignore")
import ross
load, w = float(sys.argv[1]), 314.159265358979
size = {"speed": [w], "weight": load, "bearing_length": 0.02, "journal_diameter": 0.04,
        "radial_clearance": 3e-5, "oil_viscosity": 0.005}
flow = {"length": 0.02, "omega": [w], "p_in": 0.0, "p_out": 0.0, "radius_rotor": 0.02,
        "radius_stator": 0.02003, "visc": 0.005, "rho": 860.0, "load": load}
# without change of viscosity: its theory is isothermal then
oil = {"liquid_viscosity1": 0.005, "liquid_viscosity2": 0.004999, "temperature1": 313.15,
       "temperature2": 373.15, "liquid_density": 860.0, "liquid_specific_heat": 2000.0,
       "liquid_thermal_conductivity": 0.13}
pads = {"axial_length": 0.02, "journal_radius": 0.02, "radial_clearance": 3e-5, "n_pad": 2,
        "pad_arc_length": 170, "preload": 0, "geometry": "circular", "reference_temperature": 40,
        "frequency": [w], "fxs_load": 0, "fys_load": -load, "groove_factor": [0.5, 0.5],
        "lubricant": oil, "sommerfeld_type": 2, "initial_guess": [0.5, -0.5],
        "method": "perturbation", "operating_type": "flooded", "oil_supply_pressure": 0,
        "oil_flow_v": 1e-4, "elements_circumferential": 16, "elements_axial": 6}
makers = {
    "CylindricalBearing": lambda: ross.CylindricalBearing(n=0, **size),
    "BearingFluidFlow 16x64": lambda: ross.BearingFluidFlow(n=0, nz=16, ntheta=64, **flow),
    "PlainJournal 16x6": lambda: ross.PlainJournal(n=0, **pads),
}
out = {}
for name, make in makers.items():
    try:
        make() if "Journal" not in name else None
        start = time.perf_counter(); b = make(); took = time.perf_counter() - start
        k, c = b.K(w)[:2, :2], b.C(w)[:2, :2]
        # load along -Y: x = -Y and y = X
        turn = lambda a: [[a[1][1], -a[1][0]], [-a[0][1], a[0][0]]]
        out[name] = {"seconds": took, "k": turn(k.tolist()), "c": turn(c.tolist())}
    except Exception as error:
        out[name] = {"error": repr(error)[:60]}
print(json.dumps(out))
"""


def ross_rows(python):
    """K and C at one load, per W/c and W/(c omega), beside the reference of either bearing."""
    plain = films.reference_solution(CASE["eps"], CASE["length_ratio"])
    unit = 5e-3 * 2 * np.pi * 50 * 0.02 * 0.04 / (3e-5 / 0.02) ** 2  # [N] of load number
    load = plain.load_number * unit
    done = subprocess.run(
        [python, "-c", ROSS, repr(float(load))], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout.strip().splitlines()[-1])
    gap, speed = 3e-5, 100 * np.pi
    grooved = films.GroovedReynolds(CASE["length_ratio"])
    grooved_at = films.dynamic_coefficients(grooved, jnp.asarray(plain.load_number))
    print(f"\nL/D = 0.5, eps = {CASE['eps']} of the plain ring; error over the largest entry")
    print(f"{'ROSS':26s}{'beside':12s}{'K':>12s}{'C':>12s}{'ms':>10s}")
    for name, row in found.items():
        if "error" in row:
            print(f"{name:26s}{row['error']}")
            continue
        beside = grooved_at if "Journal" in name else plain
        ours = np.asarray(beside.stiffness) * unit / gap, np.asarray(beside.damping) * unit / gap
        ours = ours[0], ours[1] / speed
        off = [
            np.abs(np.array(row[key]) - mine).max() / np.abs(mine).max()
            for key, mine in zip("kc", ours, strict=True)
        ]
        which = "two grooves" if "Journal" in name else "plain ring"
        print(f"{name:26s}{which:12s}{off[0]:12.1e}{off[1]:12.1e}{row['seconds'] * 1e3:10.1f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ross", metavar="PYTHON", help="interpreter that has ROSS")
    parser.add_argument("--places", type=int, default=40)
    parser.add_argument(
        "--grids", type=int, default=len(GRIDS), help="finest of the reference's grids"
    )
    parser.add_argument("--batch", type=int, default=20_000)
    options = parser.parse_args()
    print(
        f"jax {jax.__version__}, {platform.machine()}, {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f}"
    )
    print(f"\n{'solver':18s}{'cells':20s}{'load':>12s}{'K':>12s}{'C':>12s}{'ms':>12s}")
    for grooved in (False, True):
        reference_rows(grooved)

    models = {
        "Reynolds": films.Reynolds,
        "GroovedReynolds": films.GroovedReynolds,
        "Guembel": films.Guembel,
        "Ocvirk": films.Ocvirk,
        "ExplicitFit": films.ExplicitFit,
    }
    print(f"\n{'largest error':18s}{'load':>12s}{'friction':>12s}{'K':>12s}{'C':>12s}")
    eps, q = places(options.places)
    plain, cut = (
        [
            films.reference_solution(e, r, grooved=g, grids=GRIDS[: options.grids])
            for e, r in zip(eps, q, strict=True)
        ]
        for g in (False, True)
    )
    for name, model in models.items():
        worst = errors(model, cut if model is films.GroovedReynolds else plain, eps, q)
        print(f"{name:18s}" + "".join(f"{w:12.1e}" for w in worst), flush=True)

    print(f"\n{'us per point':18s}{'task':20s}{'batch':10s}{'value':>12s}{'gradient':>12s}")
    for name, model in models.items():
        timed(model, name, options.batch if model is not films.Guembel else 200)
    timed(films.Reynolds, "Reynolds", options.batch, ratio=0.5)
    timed(films.GroovedReynolds, "GroovedReynolds", options.batch, ratio=0.5)
    timed(films.Petroff, "Petroff", options.batch)
    if options.ross:
        ross_rows(options.ross)


if __name__ == "__main__":
    main()
