r"""Derivatives: forward and reverse mode through periodic state and response, beside differences.

The reference is the implicit derivative of fine collocation, beside fourth-order differences of tight
shooting: neither the solver nor the way to the derivative is shared. Of a rotor without a crank only the
second holds.
"""

from functools import cache, partial

import diffrax
import jax
import jax.numpy as jnp

from .._fields import BadInput
from ..crank import Collocation, Shooting
from ..design import AnalysisOptions, quantity, variable
from ._film import FILM_QUANTITIES, film_gradient_study
from ._measure import Program
from ._orbit import other_method
from ._report import Reference
from ._study import (
    FINE_TOLERANCE,
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    Solved,
    Study,
    answer,
    no_value,
)

# f' = sum(weight f(x + offset h))/h, of fourth order.
_STENCIL = ((-2.0, 1 / 12), (-1.0, -2 / 3), (1.0, 2 / 3), (2.0, -1 / 12))
_REFERENCE_STEP = 1e-3
_STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
_MODES = ("forward", "reverse")


def gradient_study(question: Question, thorough: bool) -> Study:
    """Ways to the derivative of a quantity with respect to one variable; of a film, to the load.

    Raises:
        BadInput: no variable was named, or one that does not change the quantity.
    """
    if question.quantity in FILM_QUANTITIES:
        return film_gradient_study(question, thorough)
    if question.variable is None:
        raise BadInput("variable", "none", "named for the study of gradients")
    one, crank = variable(question.design, question.variable), question.compressor is not None

    def reference():
        fine = question.fine_solver if crank else None
        found = _derivative(question, fine, "forward", FINE_TOLERANCE).run()
        if found.why:
            raise no_value(question, found.why)
        slope = float(found.value)
        if slope == 0.0:
            bound = f"one that {question.variable} changes{_excited(question)}"
            raise BadInput("quantity", question.quantity, bound)
        other, tolerance, how = other_method(question) if crank else (None, TIGHT_TOLERANCE, "")
        options = question.options(other, tolerance)
        shot = Program(partial(_at, question), question.design, options, _zero())
        step = _REFERENCE_STEP * _size(question)
        ends = [(w, shot(question.design, options, jnp.asarray(o * step))) for o, w in _STENCIL]
        other = sum(w * float(end.value) for w, end in ends) / step
        methods = "collocation, 24 nodes, forward", f"differences of {how}"
        return Reference(slope, other, methods if crank else ("forward", "differences"))

    solvers = [question.default_solver, Collocation(nodes=32, reversals=0)]
    settings = []
    for solver in (solvers if thorough else solvers[:1]) if crank else (None,):
        settings += [
            Setting(f"{mode} mode{_method(solver)}", _label(solver),
                    partial(_derivative, question, solver, mode, FINE_TOLERANCE))
            for mode in _MODES
        ]  # fmt: skip
        program = cache(partial(_difference, question, solver))
        settings += [
            Setting("central differences", f"{_label(solver)} step={share:g}",
                    partial(_difference_call, question, solver, program, share), candidate=False)
            for share in _STEPS  # the best of which is known beside the reference only
        ]  # fmt: skip
    if thorough and crank:
        edges = question.load_reversals
        shots = {
            "reverse": Shooting(reversals=edges),
            "forward": Shooting(reversals=edges, adjoint=diffrax.ForwardMode()),
        }
        settings += [
            Setting(f"{mode} mode{_method(solver)}", f"{_label(solver)} tolerance=1e-07",
                    partial(_derivative, question, solver, mode, 1e-7))
            for mode, solver in shots.items()
        ]  # fmt: skip
    note = f"derivative with respect to {question.variable}{_excited(question)}"
    name = f"d {question.quantity} / d {question.variable}"
    unit = quantity(question.quantity).unit
    unit = f"{unit or '1'}/{one.unit}" if one.unit else unit
    return Study(reference, tuple(settings), note, name=name, unit=unit)


def _excited(question: Question) -> str:
    return "" if question.excitation is None else f", excitation '{question.excitation}'"


def _method(solver) -> str:
    return "" if solver is None else f", {_label(solver).split()[0]}"


def _label(solver) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} reversals={solver.reversals}"
    return "" if solver is None else f"shooting {type(solver.solver).__name__}"


def _at(question: Question, design, options: AnalysisOptions, offset) -> Solved:
    """The quantity with the variable moved by an offset."""
    assert question.variable is not None
    one = variable(question.design, question.variable)
    moved = one.apply(design, jnp.asarray(one.current(design), float) + offset)
    return answer(moved, options, question.quantity)


def _zero():
    return jnp.zeros(())


def _size(question: Question) -> float:
    """What steps of the variable are relative to: its value, or one where that is zero."""
    assert question.variable is not None
    current = abs(float(variable(question.design, question.variable).current(question.design)))
    return current if current > 0 else 1.0


def _derivative(question: Question, solver, mode: str, tolerance: float) -> Call:
    def slope(design, options):
        def value(offset):
            solved = _at(question, design, options, offset)
            return solved.value, solved

        if mode == "reverse":
            found, solved = jax.grad(value, has_aux=True)(_zero())
        else:
            _, found, solved = jax.jvp(value, (_zero(),), (jnp.ones(()),), has_aux=True)
        return solved._replace(value=found, iterations=0)

    arguments = question.design, question.options(solver, tolerance)
    program = Program(slope, *arguments)
    return Call(program.on(*arguments), program)


def _difference(question: Question, solver):
    """A central difference with its two solutions side by side."""

    def difference(design, options, step):
        ends = jnp.stack([-step, step])
        solved = jax.vmap(lambda x: _at(question, design, options, x))(ends)
        slope = (solved.value[1] - solved.value[0]) / (2 * step)
        worst = jax.tree.map(lambda x: x[jnp.argmin(solved.ok)], solved)  # the one that failed
        return worst._replace(value=slope, iterations=0, ok=jnp.all(solved.ok))

    return Program(difference, question.design, question.options(solver), _zero())


def _difference_call(question: Question, solver, program, share: float) -> Call:
    step = jnp.asarray(share * _size(question))
    return Call(program().on(question.design, question.options(solver), step), program())
