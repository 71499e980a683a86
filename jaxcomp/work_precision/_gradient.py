r"""Derivatives: forward and reverse mode through the periodic state, beside differences.

The reference is the implicit derivative of fine collocation, beside fourth-order differences of tight
shooting: neither the solver nor the way to the derivative is shared.
"""

from functools import cache, partial

import diffrax
import jax
import jax.numpy as jnp

from .._fields import BadInput
from ..crank import Collocation, Shooting
from ..design import Chain, quantity, variable
from ._measure import Program, compile_program
from ._report import Reference, Row
from ._study import Piece, Question, Solved, Study, answer, needs_crank

# f' = sum(weight f(x + offset h))/h, of fourth order.
_STENCIL = ((-2.0, 1 / 12), (-1.0, -2 / 3), (1.0, 2 / 3), (2.0, -1 / 12))
_REFERENCE_STEP = 1e-3
_STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
_MODES = ("forward", "reverse")


def gradient_study(question: Question, thorough: bool) -> Study:
    """Ways to the derivative of a quantity with respect to one variable.

    Raises:
        BadInput: no variable was named, or there is no crank.
    """
    needs_crank(question, "gradient")
    if question.variable is None:
        raise BadInput("variable", "none", "named for the study of gradients")
    # one program of values serves all its differences
    values = cache(partial(_values, question))

    one = variable(question.design, question.variable)

    def reference():
        solver = Collocation(nodes=24, reversals=question.load_reversals)
        found = _derivative(question, solver, "forward")(
            question.design, question.chain(solver, 1e-13)
        )
        if found.why:
            raise BadInput("quantity", question.quantity, f"one with a value here: {found.why}")
        slope = float(found.value)
        if slope == 0.0:
            bound = f"one that {question.variable} changes{_shaken(question)}"
            raise BadInput("quantity", question.quantity, bound)
        solver = Shooting(diffrax.Dopri8(), reversals=question.load_reversals, output_nodes=24)
        chain = question.chain(solver, 1e-9)
        shot = compile_program(partial(_at, question), question.design, chain, _zero())
        step = _REFERENCE_STEP * _size(question)
        ends = [(w, shot(question.design, chain, jnp.asarray(o * step))) for o, w in _STENCIL]
        other = sum(w * float(end.value) for w, end in ends) / step
        methods = "collocation, 24 nodes, forward", "differences of shooting, Dopri8 at 1e-09"
        return Reference(slope, other, methods)

    collocations = [question.default_solver, Collocation(nodes=32, reversals=0)]
    solvers = [(solver, 1e-13) for solver in (collocations if thorough else collocations[:1])]
    pieces = [
        Piece(f"{mode} mode, {_words(solver)}", partial(_rows, question, solver, mode, tolerance))
        for solver, tolerance in solvers
        for mode in _MODES
    ]
    pieces += [
        Piece(f"differences, {_words(s)}", partial(_difference_rows, question, values, s))
        for s, _ in solvers
    ]
    if thorough:
        edges = question.load_reversals
        shots = {
            "reverse": Shooting(reversals=edges),
            "forward": Shooting(reversals=edges, adjoint=diffrax.ForwardMode()),
        }
        pieces += [
            Piece(f"{mode} mode, shooting", partial(_rows, question, solver, mode, 1e-7))
            for mode, solver in shots.items()
        ]
    words = f"derivative with respect to {question.variable}{_shaken(question)}"
    name = f"d {question.quantity} / d {question.variable}"
    unit = (
        "/".join((quantity(question.quantity).unit or "1", one.unit))
        if one.unit
        else (quantity(question.quantity).unit)
    )
    return Study(reference, tuple(pieces), words, name=name, unit=unit)


def _shaken(question: Question) -> str:
    return "" if question.excitation is None else f", excitation '{question.excitation}'"


def _words(solver) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} reversals={solver.reversals}"
    return f"shooting {type(solver.solver).__name__}"


def _at(question: Question, design, chain: Chain, offset) -> Solved:
    """The quantity with the variable moved by an offset."""
    assert question.variable is not None
    one = variable(question.design, question.variable)
    moved = one.apply(design, jnp.asarray(one.current(design), float) + offset)
    return answer(moved, chain, question.quantity)


def _zero():
    return jnp.zeros(())


def _size(question: Question) -> float:
    """What steps of the variable are relative to: its value, or one where that is zero."""
    assert question.variable is not None
    current = abs(float(variable(question.design, question.variable).current(question.design)))
    return current if current > 0 else 1.0


def _derivative(question: Question, solver, mode: str) -> Program:
    def slope(design, chain):
        def value(offset):
            solved = _at(question, design, chain, offset)
            return solved.value, solved

        if mode == "reverse":
            found, solved = jax.grad(value, has_aux=True)(_zero())
        else:
            _, found, solved = jax.jvp(value, (_zero(),), (jnp.ones(()),), has_aux=True)
        return solved._replace(value=found, ok=solved.ok & jnp.isfinite(found))

    return compile_program(slope, question.design, question.chain(solver, 1e-7))


def _rows(question: Question, solver, mode: str, tolerance: float, reference: Reference):
    program = _derivative(question, solver, mode)
    arguments = question.design, question.chain(solver, tolerance)
    found = program(*arguments)
    yield Row(
        f"{mode} mode, {_words(solver).split()[0]}",
        f"{_words(solver)} tolerance={tolerance:g}",
        float("inf") if found.why else reference.error(float(found.value)),
        program.timed(*arguments),
        program.seconds,
        None,
        program.flops,
        why=found.why,
    )


def _values(question: Question, solver) -> Program:
    """A central difference with its two solutions side by side."""

    def difference(design, chain, step):
        ends = jnp.stack([-step, step])
        solved = jax.vmap(lambda x: _at(question, design, chain, x))(ends)
        slope = (solved.value[1] - solved.value[0]) / (2 * step)
        worst = jax.tree.map(lambda x: x[jnp.argmin(solved.ok)], solved)  # the one that failed
        return worst._replace(value=slope, ok=jnp.all(solved.ok))

    return compile_program(difference, question.design, question.chain(solver, 1e-7), _zero())


def _difference_rows(question: Question, values, solver, reference: Reference):
    program = values(solver)
    for share in _STEPS:
        step = jnp.asarray(share * _size(question))
        arguments = question.design, question.chain(solver, 1e-13), step
        found = program(*arguments)
        yield Row(
            "central differences",
            f"{_words(solver)} step={share:g}",
            float("inf") if found.why else reference.error(float(found.value)),
            program.timed(*arguments),
            program.seconds,
            None,
            program.flops,
            why=found.why,
            candidate=False,  # the best step is known beside the reference only
        )
