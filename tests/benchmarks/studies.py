r"""Studies of error against run time for developers, with the tables of `jaxcomp accuracy`.

Run `python tests/benchmarks/studies.py STUDY [MACHINE] [--quantity NAME] [--variable NAME] [--error 1e-6]
[--thorough]`, where STUDY is one of

    friction    tolerance of the iterations that make motion and friction losses agree
    mesh        number of finite elements of the rotor
    harmonics   orders of the crank's forces that are kept in the vibration
    balancing   least squares, bounded least squares and min-max by tolerance, beside SciPy
    tolerance   statistics of machines with tolerances, by samples and from derivatives
    order       methods of diffrax with fixed steps, and the orders that they show
    simulate    methods of the time integration over a run-up, beside SciPy
    cylinders   one, two, four and eight cylinders on one crank, and what each adds

`python tests/benchmarks/orbit.py` and `sweep.py` measure batches of designs.
"""

import argparse
import dataclasses
import sys
from fnmatch import fnmatch
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks import layouts, march

from jaxcomp import BadInput, Collocation, accuracy, load, solve_orbit
from jaxcomp.balancing import bounded, least_squares, min_max
from jaxcomp.balancing._influence import Influence
from jaxcomp.cli._accuracy import _duration, _times, accuracy_tables
from jaxcomp.cli._output import show_results
from jaxcomp.cli._tables import column_table, row_table
from jaxcomp.rotor import RotorModel, ShaftElements
from jaxcomp.study import DesignResult, prepared, problem, variable
from jaxcomp.study._analysis import quantity_named
from jaxcomp.study._variables import variable_names
from jaxcomp.study.accuracy._accuracy import StudyKind
from jaxcomp.study.accuracy._extremes import scaled
from jaxcomp.study.accuracy._orbit_study import orbit_reference, shooting
from jaxcomp.study.accuracy._report import Reference
from jaxcomp.study.accuracy._study import (
    ROTOR_QUANTITIES,
    TIGHT_TOLERANCE,
    Call,
    Program,
    Question,
    Setting,
    Solved,
    SolverProgram,
    Study,
    no_value,
)
from jaxcomp.study.tolerance import within
from jaxcomp.study.tolerance._moments import local, moments, solved_rows
from jaxcomp.study.tolerance._scatter import drawn_normals, scatter_of

# From constant speed, without panel edges at load reversals: these would be placed on a solution that
# has settled already.
_SOLVER = Collocation(nodes=32, reversals=0)
_FRICTION_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
_MULTIPLES = (1.0, 2.0, 4.0)


def friction_study(question: Question, thorough: bool) -> Study:
    """Tolerance of the iterations at several multiples of the coefficients of friction.

    The errors of each multiple are relative to its own value at the tightest tolerance, so that they
    are those of the loop alone.

    Raises:
        BadInput: a machine without coefficients of friction.
    """
    machine = question.compressor
    if not scaled(machine.friction, ".coefficient", 1.0)[1]:
        raise BadInput("friction", "without", "one with coefficients, for the study of its loops")
    program = SolverProgram(question, _SOLVER)

    def at(design):
        other = question._replace(design=design)
        return SolverProgram(other, _SOLVER, compiled=program.compiled)

    left = np.max(np.abs(solve_orbit(machine, question.default_solver).loads.residual))
    settings = []
    for multiple in _MULTIPLES if thorough else _MULTIPLES[:2]:
        design, _ = scaled(question.design, ".coefficient", multiple)

        def reference(design=design):
            value = at(design).value(_FRICTION_TOLERANCES[-1])
            return Reference(value, value, ("the tightest tolerance", "the same"))

        own = cache(reference)
        settings += [
            Setting(
                f"friction times {multiple:g}",
                f"tolerance={tolerance:g}",
                lambda design=design, tolerance=tolerance: at(design).call(tolerance),
                (-np.log10(tolerance),),
                candidate=multiple == 1.0,
                reference=own,
            )
            for tolerance in _FRICTION_TOLERANCES[:-1]
        ]
    note = f"iterations of the friction; the joint loop itself leaves {left:.0e}"
    return Study(partial(orbit_reference, question), tuple(settings), note)


_ORDER = 2
_CUTS = (1, 2, 3, 4)
_HARMONICS = (1, 2, 4, 8)
_MANY = (16, 20)


def mesh_study(question: Question, thorough: bool) -> Study:
    """Elements that each shaft element is cut into, for a quantity of the rotor.

    Raises:
        BadInput: a quantity that is not of the rotor.
    """
    _needs_rotor_quantity(question)
    model = question.design.parts["rotor"]
    assert isinstance(model, RotorModel)

    @cache
    def program(cuts):
        design = eqx.tree_at(lambda d: d.parts["rotor"], question.design, refined(model, cuts))
        return SolverProgram(question._replace(design=design), None)

    def limit(coarse, fine):
        low, high = (program(cuts).value(1e-13) for cuts in (coarse, fine))
        return high + (high - low) / ((fine / coarse) ** _ORDER - 1)

    def reference():
        methods = tuple(f"{a} and {b} cuts extrapolated" for a, b in ((2, 4), (3, 4)))
        return Reference(limit(2, 4), limit(3, 4), methods)

    elements = sum(len(s.nodes) for s in model.shafts)
    settings = tuple(
        Setting("finite elements", f"{cuts * elements} elements", lambda cuts=cuts: program(cuts).call(),
                (float(cuts),))
        for cuts in (*_CUTS, *((6,) if thorough else ()))
    )  # fmt: skip
    return Study(reference, settings, "finite elements, response at the speeds of the planes")


def harmonics_study(question: Question, thorough: bool) -> Study:
    """Orders of the crank's forces that are kept in a quantity of the rotor."""
    _needs_rotor_quantity(question)
    if question.quantity == "balanced_vibration":
        raise BadInput("quantity", question.quantity, "one of more orders than the first")

    def kept(count, solver=None):
        return SolverProgram(question._replace(orders=tuple(range(1, count + 1))), solver)

    def reference():
        fewer, more = _MANY
        value = kept(more, question.fine_solver).value(1e-13)
        other = kept(fewer, shooting(question)).value(TIGHT_TOLERANCE)
        return Reference(value, other, (f"{more} orders, collocation", f"{fewer} orders, shooting"))

    settings = tuple(
        Setting(
            "orders kept", f"1 to {count}", lambda count=count: kept(count).call(), (float(count),)
        )
        for count in (*_HARMONICS, *((12, 16) if thorough else ()))
    )
    return Study(reference, settings, f"harmonics, excitation '{question.excitation}'")


def _needs_rotor_quantity(question: Question) -> None:
    if question.quantity.partition(".")[0] not in ROTOR_QUANTITIES:
        bound = f"one of the rotor: {', '.join(ROTOR_QUANTITIES)}"
        raise BadInput("quantity", question.quantity, bound)


def refined(model: RotorModel, cuts: int) -> RotorModel:
    """The model with every shaft element cut into equal ones.

    Args:
        model: any; its own nodes stay, those in between are named after their element.
        cuts: how many.
    """
    if cuts == 1:
        return model
    return dataclasses.replace(model, shafts=tuple(_cut(s, cuts) for s in model.shafts), nodes=None)


def _cut(shaft: ShaftElements, cuts: int) -> ShaftElements:
    share = np.tile(np.arange(cuts) / cuts, len(shaft.nodes))
    columns = {
        field.name: jnp.repeat(getattr(shaft, field.name), cuts)
        for field in dataclasses.fields(shaft)
        if "unit" in field.metadata and getattr(shaft, field.name) is not None
    }
    columns["length"] = columns["length"] / cuts
    for name in ("outer_diameter", "inner_diameter"):
        end = columns.get(f"{name}_end")
        if end is not None:
            start = columns.get(name, jnp.zeros_like(end))
            columns[name] = start + (end - start) * share
            columns[f"{name}_end"] = start + (end - start) * (share + 1 / cuts)
    pairs = []
    for left, right in cast(Any, shaft.nodes):
        inner = [f"{left}~{right}~{n}" for n in range(1, cuts)]
        pairs += pairwise([left, *inner, right])
    return dataclasses.replace(shaft, nodes=tuple(pairs), **columns)


_TOLERANCES = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8)
_ALLOWED = 0.5  # [-] largest correction of the bounded balance, over that of least squares
_TIGHT = 1e-10


def balancing_study(question: Question, thorough: bool) -> Study:
    """Methods of balancing by the tolerance of the gap to the optimum.

    Raises:
        BadInput: a vibration that is not converged.
    """

    def influence_of(design, options):
        found = DesignResult(design, options)
        return found.influence, found.ok

    @cache
    def influence() -> Influence:
        arguments = question.design, question.options(None)
        found, ok = eqx.filter_jit(influence_of)(*arguments)
        if not bool(ok):
            raise no_value(question, "the response is not converged")
        return found

    @cache
    def largest():
        return _ALLOWED * jnp.max(jnp.abs(least_squares(influence()).correction))

    methods = {
        "bounded least squares": lambda i, tol: bounded(i, largest(), tolerance=tol),
        "min-max": lambda i, tol: min_max(i, tolerance=tol),
    }

    @cache
    def program(method):
        def balance(influence, tolerance):
            found = methods[method](influence, tolerance)
            return Solved(found.objective, 0, True, found.status)

        return Program(balance, influence(), jnp.asarray(0.1))

    def call(method, tolerance):
        return Call(program(method).on(influence(), jnp.asarray(tolerance)), program(method))

    def exact():
        made = Program(lambda i: least_squares(i).objective, influence())
        return Call(made.on(influence()), made)

    def reference(method):
        if method == "least squares":
            value, other = float(exact().run()), _by_numpy(influence())
        else:
            top = float(largest()) if method.startswith("bounded") else None
            value, other = float(call(method, _TIGHT).run().value), _by_scipy(influence(), top)
        return Reference(value, other, (f"{method} at {_TIGHT:g}", "SciPy"))

    own = {name: cache(partial(reference, name)) for name in ("least squares", *methods)}
    settings = [Setting("least squares", "exact", exact, reference=own["least squares"],
                        task="least squares")]  # fmt: skip
    settings += [
        Setting(method, f"tolerance={tol:g}", partial(call, method, tol), (-np.log10(tol),),
                reference=own[method], task=method)
        for method in methods
        for tol in (*_TOLERANCES, *((1e-9,) if thorough else ()))
    ]  # fmt: skip
    note = f"balances at order 1, excitation '{question.excitation}'"
    return Study(own["least squares"], tuple(settings), note, unit="m")


def _by_numpy(influence: Influence) -> float:
    matrix, initial = (np.asarray(a) for a in influence.weighted)
    found = np.linalg.lstsq(matrix, -initial, rcond=None)[0]
    return float(np.linalg.norm(initial + matrix @ found))


def _by_scipy(influence: Influence, largest: float | None) -> float:
    """[m] Least norm of the vibration with bounded corrections, or its least largest entry."""
    matrix, initial = (np.asarray(a) for a in influence.weighted)
    size, count = np.max(np.abs(initial)), matrix.shape[1]
    start = np.linalg.lstsq(matrix, -initial, rcond=None)[0]
    scale = np.max(np.abs(start)) if largest is None else largest

    def rest(x):
        return initial / size + matrix @ (x[:count] + 1j * x[count : 2 * count]) * scale / size

    def slope(x, weight):
        """Of sum(weight |rest|^2)."""
        inner = 2 * (weight * rest(x)).conj() @ matrix * scale / size
        return np.concatenate([inner.real, -inner.imag])

    start = start / scale * (0.5 if largest is not None else 1.0)
    x = np.concatenate([start.real, start.imag])
    options = {"ftol": 1e-15, "maxiter": 1000}
    if largest is not None:
        room = {"type": "ineq", "fun": lambda x: 1 - x[:count] ** 2 - x[count:] ** 2,
                "jac": lambda x: -2 * np.hstack([np.diag(x[:count]), np.diag(x[count:])])}  # fmt: skip
        ones = np.ones(len(initial))
        found = minimize(lambda x: np.sum(np.abs(rest(x)) ** 2), x, jac=lambda x: slope(x, ones),
                         constraints=room, method="SLSQP", options=options)  # fmt: skip
        return float(np.sqrt(found.fun) * size)
    units = np.eye(len(initial))

    def below(x):
        return np.column_stack([[-slope(x, unit) for unit in units], np.ones(len(units))])

    top = {"type": "ineq", "fun": lambda x: x[-1] - np.abs(rest(x)) ** 2, "jac": below}
    x = np.append(x, np.max(np.abs(rest(x)) ** 2))
    found = minimize(lambda x: x[-1], x, jac=lambda x: np.eye(len(x))[-1], constraints=top,
                     method="SLSQP", options=options)  # fmt: skip
    return float(np.sqrt(np.max(np.abs(rest(found.x)) ** 2)) * size)


_WITHIN, _SIGMAS = 0.02, 1.5  # [-] of each number; standard deviations from the mean to the limit
_SAMPLES, _MANY_SAMPLES, _MORE = (64, 256, 1024, 4096), 1 << 15, 1 << 17
_STATISTICS = ("mean", "deviation", "rejects")


def tolerance_study(question: Question, thorough: bool) -> Study:
    """Statistics of machines whose numbers vary, by number of samples and from derivatives.

    The variable may be a pattern such as "friction.*.coefficient"; absent: the mechanism's numbers.

    Raises:
        BadInput: no number that fits, or a quantity that does not change with them.
    """
    design, pattern = question.design, question.variable or "mechanism.*"
    names = [
        name
        for name in variable_names(design)
        if fnmatch(name, pattern) and float(variable(design, name).current(design)) != 0.0
    ]
    if not names:
        raise BadInput("variable", pattern, "a pattern that fits a number other than zero")
    scatter = scatter_of({name: within(_WITHIN, relative=True) for name in names})
    solver = None if question.compressor is None else Collocation(nodes=10, reversals=0)
    made = prepared(problem(design, names, [question.quantity], question.options(solver, 1e-5)))
    nominal = np.asarray(made.current)
    sign = -1 if quantity_named(question.quantity).better == "more" else 1  # side of the rejects

    @cache
    def drawn(sampling, count, seed):
        normals = drawn_normals(names, count, sampling, seed)
        values, ok = solved_rows(made, scatter.at(nominal, normals))
        return values[ok, 0]

    @cache
    def large():
        many = drawn("sobol", _MORE if thorough else _MANY_SAMPLES, 1)
        if len(many) < 2 or not many.std() > 0:
            bound = f"one that {pattern} changes, with a value here"
            raise BadInput("quantity", question.quantity, bound)
        return many

    def limit():
        return large().mean() + sign * _SIGMAS * large().std()

    def relative(mean, deviation, rejects):
        """[-] The mean as one more than its distance from the reference in standard deviations."""
        centre, spread = large().mean(), large().std()
        values = 1.0 + (mean - centre) / spread, deviation / spread, rejects
        return dict(zip(_STATISTICS, values, strict=True))

    def of(values):
        return relative(values.mean(), values.std(), np.mean(sign * (values - limit()) > 0))

    def reference(name):
        count = len(large())
        other = of(drawn("latin_hypercube", count, 2))[name]
        methods = f"{count} samples of Sobol", "as many by a Latin hypercube"
        return Reference(of(large())[name], other, methods)

    def sampled(sampling, count, name):
        return Call(lambda: of(drawn.__wrapped__(sampling, count, 0))[name])

    def expanded(order, name):
        mean, deviation = scatter.mean(nominal), scatter.deviation(nominal)
        covariance = scatter.covariance(nominal)
        excess = jnp.array([one.excess for one in scatter.tolerances.values()])

        def run():
            near = local(made, mean, deviation, "differences" if order == "second" else None)
            if not near.ok:
                raise RuntimeError("the derivatives at the mean machine cannot be relied on")
            found = moments(near, covariance, excess)
            middle, wide = found.mean[0], found.deviation[0]
            return relative(middle, wide, norm.sf(sign * (limit() - middle) / wide))[name]

        return Call(run)

    settings, own = [], {name: cache(partial(reference, name)) for name in _STATISTICS}
    samplings = ("sobol", "random", "latin_hypercube") if thorough else ("sobol", "random")
    for name in _STATISTICS:
        settings += [
            Setting(f"{sampling.replace('_', ' ')}: {name}", f"{count} samples",
                    partial(sampled, sampling, count, name), (float(count),), reference=own[name],
                    task=name)
            for sampling in samplings
            for count in _SAMPLES
        ]  # fmt: skip
        settings += [
            Setting(f"{order} order: {name}", "at the mean machine", partial(expanded, order, name),
                    reference=own[name], task=name)
            for order in ("first", "second")
        ]  # fmt: skip
    note = (
        f"{len(names)} numbers ({pattern}) within {_WITHIN:.0%}; rejects beyond {_SIGMAS} deviations; "
        "errors of the mean are in deviations"
    )
    return Study(
        own["mean"], tuple(settings), note, name=f"statistics of {question.quantity}", unit=""
    )


STUDIES = {
    kind.name: kind
    for kind in (
        StudyKind("friction", friction_study, needs="crank", verified=True),
        StudyKind("mesh", mesh_study, "vibration", needs="rotor"),
        StudyKind("harmonics", harmonics_study, "vibration", needs="rotor"),
        StudyKind("balancing", balancing_study, "objective", "m", needs="rotor"),
        StudyKind("tolerance", tolerance_study, varies=True),
        StudyKind("order", march.order_study, "mean_speed", "rad/s", needs="crank"),
        StudyKind("simulate", march.transient_study, "speed", "rad/s", needs="crank"),
        StudyKind("cylinders", layouts.cylinders_study, needs="crank"),
    )
}
_OF_ROTOR = ("mesh", "harmonics", "balancing")


def _growth(growth):
    """Time of a call over the number of cylinders, what each adds, and the compiling beside it."""
    counts = next(iter(growth.values())).seconds
    columns = {
        f"{count}": [_duration(one.seconds[count]) for one in growth.values()] for count in counts
    }
    few, many = min(counts), max(counts)
    compiling = [
        _times(one.compile_seconds[many] / one.compile_seconds[few]) for one in growth.values()
    ]
    each = [_duration(max(one.each, 0.0)) for one in growth.values()]
    more = {"A cylinder more": each, f"Compiling, {many} to {few}": compiling}
    title = "Time of a call by number of cylinders"
    return column_table(title, {"Setting": list(growth), **columns, **more})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("machine", nargs="?", help="bundled machine or machine file")
    parser.add_argument("--quantity")
    parser.add_argument("--variable")
    parser.add_argument("--error", type=float, default=1e-6)
    parser.add_argument("--thorough", action="store_true")
    given = parser.parse_args()
    scene = load(
        given.machine or ("hermetic-68cc" if given.study in _OF_ROTOR else "mayekawa-wbhe")
    )
    options = {"variable": given.variable, "thorough": given.thorough}
    report = accuracy(scene, given.quantity, STUDIES[given.study], **options)
    tables = [*accuracy_tables(report, given.error)]
    if given.study == "order":
        orders = [(name, one.expected, one.observed) for name, one in march.orders(report).items()]
        tables.append(row_table(None, ("Method", "Order", ("Observed", ".2f")), orders))
    if given.study == "cylinders":
        tables.append(_growth(layouts.growth(report.rows)))
    show_results({}, tables, False, None)


if __name__ == "__main__":
    main()
