r"""What the studies share: the question, and its answer by a chain of solvers."""

from collections.abc import Callable, Iterable
from copy import copy
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._fields import BadInput
from ..crank import Collocation, Shooting
from ..design import Chain, Found, quantity
from ..machine import Machine
from ._measure import Program, compile_program
from ._report import Order, Reference, Row


class Question(NamedTuple):
    """What the errors are of.

    Attributes:
        design: the machine.
        quantity: name of a `jaxcomp.design.quantity`.
        variable: name of a variable, for studies of derivatives.
    """

    design: Machine
    quantity: str
    variable: str | None = None


class Piece(NamedTuple):
    """A part of a study that is worked out at once.

    Attributes:
        words: what it is, for the progress.
        rows: its rows, given the reference.
    """

    words: str
    rows: Callable[[Reference], Iterable[Row]]


class Study(NamedTuple):
    """How a question is studied.

    Attributes:
        reference: finds the converged value.
        pieces: settings to be tried.
        note: one line on what is varied.
        orders: of fixed-step methods, from all rows.
    """

    reference: Callable[[], Reference]
    pieces: tuple[Piece, ...]
    note: str = ""
    orders: Callable[[list[Row], Reference], dict[str, Order]] = lambda rows, reference: {}


def answer(
    design: Machine, chain: Chain, name: str
) -> tuple[Float[Array, ""], Int[Array, ""], Bool[Array, ""]]:
    """A quantity of a design, the passes of the crank's solver (0 without), and whether it is ok."""
    found = Found(design, chain)
    value = jnp.asarray(quantity(name).value(found), float)
    passes = found.orbit.iterations if "orbit" in found.__dict__ else jnp.asarray(0)
    return value, passes, found.ok & jnp.isfinite(value)


class SolverProgram:
    """A quantity by one solver, compiled once for all its tolerances."""

    def __init__(self, question: Question, solver: Collocation | Shooting):
        self._question, self._solver = question, solver
        self.program: Program = compile_program(
            answer, question.design, self._chain(1e-7), question.quantity
        )

    def at(self, design: Machine) -> "SolverProgram":
        """The same program for a design with other numbers."""
        other = copy(self)
        other._question = self._question._replace(design=design)
        return other

    def __call__(self, tolerance: float) -> tuple[float, int, bool]:
        """Value [SI], passes, and whether it can be relied on."""
        value, passes, ok = self.program(*self._arguments(tolerance))
        return float(value), int(passes), bool(ok)

    def row(self, reference: Reference, method: str, setting: str, tolerance: float) -> Row:
        """The row of a tolerance."""
        value, passes, ok = self(tolerance)
        return Row(
            method,
            setting,
            reference.error(value) if ok else float("inf"),
            self.seconds(tolerance),
            self.program.seconds,
            passes or None,
            self.program.flops,
        )

    def seconds(self, tolerance: float) -> float:
        """[s] median of several calls."""
        return self.program.timed(*self._arguments(tolerance))

    def _arguments(self, tolerance):
        return self._question.design, self._chain(tolerance), self._question.quantity

    def _chain(self, tolerance) -> Chain:
        solver = eqx.tree_at(lambda s: s.tolerance, self._solver, jnp.asarray(tolerance, float))
        return Chain(solver)


def needs_crank(question: Question, study: str) -> None:
    """Refuse a study of the crank's solvers where there is no crank, or it plays no part.

    Raises:
        BadInput: such a scene or quantity.
    """
    if question.design.compressor is None:
        raise BadInput("study", study, "one that a scene without compressor has, such as 'mesh'")
