r"""Batches as `sweep` and `tolerance` run them: throughput, and the error of what comes out.

Sweep: designs of one variable within 5 % of its value, computed in groups on all devices of the
process. The error is the largest of 16 of them, beside each of these by fine collocation and by shooting.

Tolerances: mean, standard deviation and share of rejects of machines whose numbers vary by 2 % (three
standard deviations), by samples and from derivatives at the mean machine; the reference is a large
sample, beside another one drawn in another way.
"""

from fnmatch import fnmatch
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import norm

from .._fields import BadInput
from ..crank import Collocation
from ..design import Problem, prepared, problem, quantity, variable, variable_names
from ..sweeping._program import block_program, default_width
from ..tolerancing import within
from ..tolerancing._local import first_order, local, second_order
from ..tolerancing._monte_carlo import drawn_normals, solved_normals
from ..tolerancing._scatter import scatter_of
from ._measure import compile_program
from ._orbit import METHODS, shooting
from ._report import Reference
from ._study import (
    FINE_TOLERANCE,
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    Study,
    needs_crank,
    no_value,
)

# [-] Of the variable, to either side; designs of a sweep, and how many of them are judged.
_RANGE, _DESIGNS, _JUDGED = 0.05, 2048, 16
# Nodes and tolerance without panel edges at load reversals.
_FAST = ((5, 1e-5), (8, 1e-5), (10, 1e-5), (16, 1e-6), (32, 1e-7))
_WITHIN, _SIGMAS = 0.02, 1.5  # [-] of each number; standard deviations from the mean to the limit
_SAMPLES, _MANY, _MORE = (64, 256, 1024, 4096), 1 << 15, 1 << 17
_STATISTICS = ("mean", "deviation", "rejects")


def sweep_study(question: Question, thorough: bool) -> Study:
    """Solvers of a batch, by the time of one design.

    Raises:
        BadInput: a machine without a crank, or no variable.
    """
    needs_crank(question, "sweep")
    one = variable(question.design, question.variable or "mechanism.crank_radius")
    nominal = float(one.current(question.design))
    rows = nominal * (1 + _RANGE * np.linspace(-1, 1, _DESIGNS))[:, None]
    judged = np.linspace(0, _DESIGNS - 1, _JUDGED).astype(int)

    def asked(solver, tolerance) -> Problem:
        options = question.options(solver, tolerance)
        return prepared(problem(question.design, [one.name], [question.quantity], options))

    def values(solver, tolerance):
        made, at = asked(solver, tolerance), jnp.asarray(rows[judged])
        found = compile_program(lambda p, at: jax.lax.map(p, at), made, at)(made, at)
        if not bool(jnp.all(found.ok)):
            raise no_value(question, f"within {_RANGE:.0%} of {one.name} = {nominal:.6g}")
        return np.asarray(found.values[:, 0])

    def reference():
        fine = values(question.fine_solver, FINE_TOLERANCE)
        return Reference(fine, values(shooting(question), TIGHT_TOLERANCE), METHODS)

    def make(solver, tolerance, width):
        devices = jax.local_devices()
        start = block_program(asked(solver, tolerance), width or default_width(devices), devices)

        def run():
            found, ok = start(rows)()
            if not ok.all():
                raise RuntimeError(f"{np.sum(~ok)} of {_DESIGNS} designs have no solution")
            return found[judged, 0]

        return Call(run)

    solvers = [
        (f"nodes={n} reversals=0", Collocation(nodes=n, reversals=0), tol) for n, tol in _FAST
    ]
    solvers.append(("default", question.default_solver, FINE_TOLERANCE))
    settings = [
        Setting(
            "sweep", f"{words} tolerance={tol:g}", partial(make, solver, tol, None), share=_DESIGNS
        )
        for words, solver, tol in solvers
    ]
    for width in (1, 8, 128) if thorough else ():
        words, solver, tol = solvers[2]
        settings.append(Setting(f"sweep, groups of {width}", f"{words} tolerance={tol:g}",
                                partial(make, solver, tol, width), share=_DESIGNS))  # fmt: skip
    note = f"{_DESIGNS} designs over {one.name}, times are of one design"
    return Study(reference, tuple(settings), note)


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
    sign = -1 if quantity(question.quantity).better == "more" else 1  # side of the rejects

    @cache
    def drawn(sampling, count, seed):
        normals = drawn_normals(names, count, sampling, seed)
        values, ok = solved_normals(made, scatter, nominal, normals, progress=False)
        return values[ok, 0]

    @cache
    def large():
        many = drawn("sobol", _MORE if thorough else _MANY, 1)
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
            first = first_order(near, covariance)
            found = second_order(near, covariance, excess) if order == "second" else first
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
