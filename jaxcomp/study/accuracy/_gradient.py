r"""Derivatives: forward and reverse mode through periodic state and response, beside differences.

The reference is the implicit derivative of fine collocation, beside fourth-order differences of tight
shooting: neither the solver nor the way to the derivative is shared. Of a rotor without a crank only the
second holds.
"""

from functools import partial

import diffrax
import jax
import jax.numpy as jnp

from ..._core.errors import BadInput
from ...crank import Collocation, Shooting
from .. import variable
from .._analysis import quantity_named
from ._orbit_study import other_method
from ._report import Reference
from ._rotor_study import FILM_QUANTITIES, film_gradient_study
from ._study import (
    FINE_TOLERANCE,
    TIGHT_TOLERANCE,
    Call,
    Compiled,
    Question,
    Setting,
    Solved,
    Study,
    answer,
    known_value,
    series,
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
    derivative = _Derivative(question, question.variable)
    crank = question.compressor is not None
    solvers = [question.default_solver, Collocation(nodes=32, reversals=0)]
    settings: list[Setting] = []
    if not crank:
        tried = [None]
    elif thorough:
        tried = solvers
    else:
        tried = solvers[:1]
    for solver in tried:
        settings += derivative.by_mode(solver, FINE_TOLERANCE)
        settings += derivative.by_differences(solver)
    if thorough and crank:
        edges = question.load_reversals
        tail = " tolerance=1e-07"
        ahead = Shooting(reversals=edges, adjoint=diffrax.ForwardMode())
        settings += derivative.by_mode(Shooting(reversals=edges), 1e-7, ("reverse",), tail)
        settings += derivative.by_mode(ahead, 1e-7, ("forward",), tail)
    note = f"derivative with respect to {question.variable}{derivative.excited}"
    name = f"d {question.quantity} / d {question.variable}"
    unit = quantity_named(question.quantity).unit
    below = derivative.variable.unit
    if below:
        unit = f"{unit or '1'}/{below}"
    return Study(derivative.reference, tuple(settings), note, name, unit)


class _Derivative:
    """The derivative of the quantity of a question with respect to one variable.

    Args:
        question: whose quantity and machine are taken.
        name: of the variable.
    """

    def __init__(self, question: Question, name: str):
        self.question = question
        self.variable = variable(question.design, name)
        nominal = float(self.variable.current(question.design))
        self.size = abs(nominal) or 1.0  # what steps of the variable are relative to
        excitation = question.excitation
        self.excited = ""
        if excitation is not None:
            self.excited = f", excitation '{excitation}'"

    def at(self, design, options, offset) -> Solved:
        """The quantity with the variable moved by an offset."""
        # An offset, so that one program serves derivatives and differences of every step.
        present = jnp.asarray(self.variable.current(design), float)
        return answer(
            self.variable.apply(design, present + offset), options, self.question.quantity
        )

    def slope(self, mode, design, options) -> Solved:
        """The derivative in forward or reverse mode."""

        def value(offset):
            solved = self.at(design, options, offset)
            return solved.value, solved

        zero = jnp.zeros(())
        if mode == "reverse":
            derivative, solved = jax.grad(value, has_aux=True)(zero)
        else:
            _, derivative, solved = jax.jvp(value, (zero,), (jnp.ones(()),), has_aux=True)
        return solved._replace(value=derivative, iterations=0)

    def difference(self, design, options, step) -> Solved:
        """A central difference with its two solutions side by side."""
        solved = jax.vmap(lambda x: self.at(design, options, x))(jnp.stack([-step, step]))
        slope = (solved.value[1] - solved.value[0]) / (2 * step)
        worst = jax.tree.map(lambda x: x[jnp.argmin(solved.ok)], solved)  # the one that failed
        return worst._replace(value=slope, iterations=0, ok=jnp.all(solved.ok))

    def call(self, solver, tolerance, mode) -> Call:
        """The derivative by a solver and a mode."""
        options = self.question.options(solver, tolerance)
        return Compiled(partial(self.slope, mode)).call(self.question.design, options)

    def by_mode(self, solver, tolerance, modes=_MODES, tail="") -> list[Setting]:
        """Settings of both modes, or of one."""
        label = _label(solver)
        method = label.partition(" ")[0]
        settings = []
        for mode in modes:
            name = f"{mode} mode"
            if method:
                name += f", {method}"
            call = partial(self.call, solver, tolerance, mode)
            settings.append(Setting(name, f"{label}{tail}", call))
        return settings

    def by_differences(self, solver) -> list[Setting]:
        """Settings by step, the best of which is known beside the reference only."""
        program = Compiled(self.difference)
        options = self.question.options(solver)

        def call(share):
            return program.call(self.question.design, options, jnp.asarray(share * self.size))

        label = f"{_label(solver)} step={{:g}}"
        return series("central differences", label, call, _STEPS, candidate=False)

    def reference(self) -> Reference:
        """Forward mode through fine collocation, beside differences of another method.

        Raises:
            BadInput: a variable that does not change the quantity.
        """
        question = self.question
        fine = None
        other = None
        tolerance = TIGHT_TOLERANCE
        methods = "forward", "differences"
        if question.compressor is not None:
            fine = question.fine_solver
            other, tolerance, name = other_method(question)
            methods = "collocation, 24 nodes, forward", f"differences of {name}"
        exact = float(known_value(question, self.call(fine, FINE_TOLERANCE, "forward").run()))
        if exact == 0.0:
            bound = f"one that {question.variable} changes{self.excited}"
            raise BadInput("quantity", question.quantity, bound)

        options = question.options(other, tolerance)
        shot = Compiled(self.at)  # one program for all points of the stencil
        step = _REFERENCE_STEP * self.size
        difference = 0.0
        for offset, weight in _STENCIL:
            solved = shot(question.design, options, jnp.asarray(offset * step))
            difference += weight * float(solved.value)
        return Reference(exact, difference / step, methods)


def _label(solver: Collocation | Shooting | None) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} reversals={solver.reversals}"
    if solver is None:
        return ""
    return f"shooting {type(solver.solver).__name__}"
