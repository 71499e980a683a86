r"""Balances: least squares, bounded least squares and min-max by tolerance, beside SciPy.

All at order 1 of the machine as it stands, each beside its own optimum: the objective at a tight
tolerance, and that of a search by SciPy (least squares: `numpy.linalg.lstsq`; the others: SLSQP). An
error is how far an objective lies above the optimum, relative; the tolerance of a method bounds the gap
that it proves itself.
"""

from functools import cache, partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from ..balancing import Influence, bounded, least_squares, min_max
from ..design import DesignResult
from ._measure import compile_program
from ._report import Reference
from ._study import Call, Question, Setting, Solved, Study, needs_rotor, no_value

_TOLERANCES = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8)
_ALLOWED = 0.5  # [-] largest correction of the bounded balance, over that of least squares
_TIGHT = 1e-10


def balancing_study(question: Question, thorough: bool) -> Study:
    """Methods of balancing by the tolerance of the gap to the optimum.

    Raises:
        BadInput: no rotor with planes, or a vibration that cannot be relied on.
    """
    needs_rotor(question, "balancing")

    def influence_of(design, options):
        found = DesignResult(design, options)
        return found.influence, found.ok

    @cache
    def influence() -> Influence:
        arguments = question.design, question.options(None)
        found, ok = eqx.filter_jit(influence_of)(*arguments)
        if not bool(ok):
            raise no_value(question, "the response is not to be relied on")
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

        return compile_program(balance, influence(), jnp.asarray(0.1))

    def call(method, tolerance):
        return Call(program(method).on(influence(), jnp.asarray(tolerance)), program(method))

    def exact():
        made = compile_program(lambda i: least_squares(i).objective, influence())
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
