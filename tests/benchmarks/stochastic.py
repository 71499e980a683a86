"""Fresh samples by Optax against sample averages by SLSQP.

`python tests/benchmarks/stochastic.py [mean|probability|quantile ...]`

The machine of 2012 with fourteen design variables, and nineteen numbers that scatter in production. What
is sought is the highest `mean` of the efficiency, the least `probability` that it falls below a limit (a
sigmoid as wide as its scatter instead of the step), and the highest `quantile` of the worst tenth with
their mean, whose level is one variable more (Rockafellar and Uryasev 2000, J. Risk 2(3), eq. 9). SLSQP
sees the average over the same 16 or 64 machines at every design; Adam sees eight others at every step
and ends with the mean of its last fifth. Printed is what the designs are worth over 2048 machines that
neither has seen, over the machines solved with their slopes on the way, the same number for both in a
row.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import optax
from scipy.optimize import minimize

from jaxcomp import AnalysisOptions, Collocation, load, problem
from jaxcomp.study.tolerance import within
from jaxcomp.study.tolerance._scatter import drawn_normals, scatter_of

# [-] of the value as it stands, to both sides
DESIGN = dict.fromkeys(
    ("mechanism.conrod_length", "mechanism.piston_mass", "mechanism.conrod_mass", "motor.mean_speed",
     "mechanism.conrod_inertia", "crankshaft.inertia", "crankshaft.unbalance", "gas.suction_pressure",
     "crankshaft.main_journal.diameter", "friction.piston_pin.diameter",
     "friction.crank_pin.diameter", "gas.clearance_ratio"), 0.15,
)  # fmt: skip
RULES = {"stroke_bore_ratio": (0.5, 1.2), "offset": (-0.02, 0.02)}
LOOSE = ("friction.wall.coefficient", "friction.piston_pin.coefficient",
         "friction.crank_pin.coefficient", "crankshaft.main_journal.coefficient",
         "gas.exponent")  # fmt: skip
EIGHT, SEEN, WORST = 8, 2048, 0.1


def made():
    """Value and slope of both objectives over shares of the ranges and standard normals."""
    scene = load("mayekawa-wbhe")
    names = [*DESIGN, *RULES, *LOOSE]
    asked = problem(
        scene, names, ["mechanical_efficiency"],
        AnalysisOptions(Collocation(8, reversals=0, tolerance=1e-6, estimate=False)),
    )  # fmt: skip
    nominal = np.asarray(asked.current)
    tolerances = {name: within(0.05 * abs(x)) for name, x in zip(names, nominal, strict=True) if x}
    tolerances |= {name: within(0.2 * nominal[names.index(name)]) for name in LOOSE[:-1]}
    tolerances |= {"offset": within(1e-3)}
    scatter = scatter_of({name: tolerances[name] for name in names})
    count = len(DESIGN) + len(RULES)
    low, high = nominal.copy(), nominal.copy()
    for number, share in enumerate(DESIGN.values()):
        low[number], high[number] = sorted((1 + s * share) * nominal[number] for s in (-1, 1))
    for number, ends in enumerate(RULES.values(), len(DESIGN)):
        low[number], high[number] = ends
    low, high = jnp.asarray(low), jnp.asarray(high)

    def machines(share, normals):
        design = jnp.where(high > low, low + jnp.pad(share, (0, len(LOOSE))) * (high - low), low)

        def one(u):
            answer = asked(design + scatter.at(jnp.zeros(len(names)), u))
            return jnp.where(answer.ok, answer.values[0], jnp.nan)

        return jax.lax.map(one, normals, batch_size=32)

    def mean(values, limit, level):
        return -jnp.nanmean(values)

    def tail(values, limit, level):
        bound, width = limit
        value = bound + 6 * width * (level[0] - 0.5)
        return -(value - jnp.nanmean(jax.nn.relu(value - values)) / WORST)

    def below(values, limit, level):
        bound, width = limit
        return jnp.nanmean(jax.nn.sigmoid((bound - values) / width))

    start = (jnp.asarray(nominal[:count]) - low[:count]) / (high - low)[:count]
    return machines, {"mean": mean, "probability": below, "quantile": tail}, start, names


def main() -> int:
    machines, objectives, start, names = made()
    values = jax.jit(machines)
    unseen = jnp.asarray(drawn_normals(names, SEEN, "sobol", 77))
    there = values(start, unseen)
    mean, spread = (100 * float(read(there)) for read in (jnp.nanmean, jnp.nanstd))
    print(f"{start.size} variables, {len(names)} that scatter; as it stands {mean:.3f} % with a "
          f"deviation of {spread:.3f}")  # fmt: skip
    best, count = there, start.size
    for name in sys.argv[1:] or objectives:
        objective = objectives[name]

        def worth(share, normals, limit, objective=objective):
            return objective(machines(share[:count], normals), limit, share[count:])

        slope = jax.jit(jax.value_and_grad(worth))

        def judged(share, limit):
            found = values(jnp.asarray(share[:count]), unseen)
            if name == "quantile":  # noqa: B023
                quantile = jnp.nanquantile(found, WORST)
                worst = jnp.nanmean(jnp.where(found <= quantile, found, jnp.nan))
                return f"{100 * float(quantile):.4f} % (mean beyond {100 * float(worst):.4f} %)"
            if name == "mean":  # noqa: B023
                return f"{100 * float(jnp.nanmean(found)):.4f} %"
            return f"{100 * float(jnp.nanmean(found < limit[0])):.3f} %"

        # below which machines of the best mean fall in some per cent
        limit = jnp.nanmean(best) - 1.5 * jnp.nanstd(best), jnp.nanstd(best)
        begin = start
        if name == "quantile":
            limit = jnp.nanmean(there), jnp.nanstd(there)
            begin = jnp.append(start, 0.5)
        for drawn in (16,) if name == "mean" else (16, 64):
            normals = jnp.asarray(drawn_normals(names, drawn, "sobol", 5))
            seen = []

            def fixed(x, normals=normals, seen=seen, limit=limit, slope=slope):
                seen.append(x)
                value, by = slope(jnp.asarray(x), normals, limit)
                return float(value), np.asarray(by)

            found = minimize(
                fixed, np.asarray(begin), jac=True, method="SLSQP", bounds=[(0, 1)] * begin.size,
                options={"maxiter": 60, "ftol": 1e-10},
            )  # fmt: skip
            solved = drawn * len(seen)
            adam = descent(slope, begin, limit, max(20, solved // EIGHT), names)
            print(f"{name}: {solved} machines: SLSQP on {drawn} {judged(found.x, limit)}, "
                  f"Adam {judged(adam, limit)}", flush=True)  # fmt: skip
        best = values(jnp.asarray(found.x[:count]), unseen)
    return 0


def descent(slope, start, limit, steps, names):
    """Where Adam goes with fresh machines at every step."""
    way = optax.adam(optax.cosine_decay_schedule(0.1, steps, 0.02))
    share, state, last = start, way.init(start), []
    for step in range(steps):
        normals = jax.random.normal(jax.random.key(step), (EIGHT, len(names)))
        _, by = slope(share, normals, limit)
        moved, state = way.update(by, state)
        share = jnp.clip(optax.apply_updates(share, moved), 0.0, 1.0)
        last.append(share)
    return jnp.mean(jnp.stack(last[-max(1, steps // 5) :]), axis=0)


if __name__ == "__main__":
    sys.exit(main())
