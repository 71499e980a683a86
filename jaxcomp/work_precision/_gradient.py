r"""Derivatives: forward and reverse mode through the periodic state, beside differences.

The reference is the implicit derivative of fine collocation, beside fourth-order differences of tight
shooting: neither the solver nor the way to the derivative is shared.
"""

from functools import cache, partial

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from .._fields import BadInput
from ..crank import Collocation, Shooting
from ..design import Chain, variable
from ._measure import Program, compile_program
from ._report import Reference, Row
from ._study import Piece, Question, Study, answer, needs_crank

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

    def reference():
        fine = _derivative(question, Collocation(nodes=24), "forward")
        value, _ = fine(question.design, _chain(Collocation(nodes=24), 1e-13))
        solver = Shooting(diffrax.Dopri8())
        shot = compile_program(
            partial(_at, question), question.design, _chain(solver, 1e-9), _zero()
        )

        def moved(offset):
            return shot(question.design, _chain(solver, 1e-9), jnp.asarray(offset))[0]

        step = _REFERENCE_STEP * _size(question)
        other = sum(w * float(moved(o * step)) for o, w in _STENCIL) / step
        methods = "collocation, 24 nodes, forward", "differences of shooting, Dopri8 at 1e-09"
        return Reference(float(value), other, methods)

    collocations = [Collocation(nodes=8), Collocation(nodes=32, reversals=0)]
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
        shots = {"reverse": Shooting(), "forward": Shooting(adjoint=diffrax.ForwardMode())}
        pieces += [
            Piece(f"{mode} mode, shooting", partial(_rows, question, solver, mode, 1e-7))
            for mode, solver in shots.items()
        ]
    words = f"derivative with respect to {question.variable}"
    return Study(reference, tuple(pieces), words)


def _words(solver) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} reversals={solver.reversals}"
    return f"shooting {type(solver.solver).__name__}"


def _at(question: Question, design, chain: Chain, offset):
    """The quantity and whether it is ok, with the variable moved by an offset."""
    assert question.variable is not None
    one = variable(question.design, question.variable)
    moved = one.apply(design, jnp.asarray(one.current(design), float) + offset)
    value, _, ok = answer(moved, chain, question.quantity)
    return value, ok


def _zero():
    return jnp.zeros(())


def _size(question: Question) -> float:
    """What steps of the variable are relative to: its value, or one where that is zero."""
    assert question.variable is not None
    current = abs(float(variable(question.design, question.variable).current(question.design)))
    return current if current > 0 else 1.0


def _chain(solver, tolerance) -> Chain:
    return Chain(eqx.tree_at(lambda s: s.tolerance, solver, jnp.asarray(tolerance, float)))


def _derivative(question: Question, solver, mode: str) -> Program:
    def slope(design, chain):
        def value(offset):
            return _at(question, design, chain, offset)

        if mode == "reverse":
            return jax.grad(value, has_aux=True)(_zero())
        _, found, ok = jax.jvp(value, (_zero(),), (jnp.ones(()),), has_aux=True)
        return found, ok

    return compile_program(slope, question.design, _chain(solver, 1e-7))


def _rows(question: Question, solver, mode: str, tolerance: float, reference: Reference):
    program = _derivative(question, solver, mode)
    arguments = question.design, _chain(solver, tolerance)
    slope, ok = program(*arguments)
    yield Row(
        f"{mode} mode, {_words(solver).split()[0]}",
        f"{_words(solver)} tolerance={tolerance:g}",
        reference.error(float(slope)) if bool(ok) else float("inf"),
        program.timed(*arguments),
        program.seconds,
        None,
        program.flops,
    )


def _values(question: Question, solver) -> Program:
    """A central difference with its two solutions side by side."""

    def difference(design, chain, step):
        ends = jnp.stack([-step, step])
        values, ok = jax.vmap(lambda x: _at(question, design, chain, x))(ends)
        return (values[1] - values[0]) / (2 * step), jnp.all(ok)

    return compile_program(difference, question.design, _chain(solver, 1e-7), _zero())


def _difference_rows(question: Question, values, solver, reference: Reference):
    program = values(solver)
    for share in _STEPS:
        arguments = question.design, _chain(solver, 1e-13), jnp.asarray(share * _size(question))
        slope, ok = program(*arguments)
        yield Row(
            "central differences",
            f"{_words(solver)} step={share:g}",
            reference.error(float(slope)) if bool(ok) else float("inf"),
            program.timed(*arguments),
            program.seconds,
            None,
            program.flops,
        )
