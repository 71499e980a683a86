r"""What the studies share: the question, and its answer by a chain of solvers."""

import math
from collections.abc import Callable, Iterable
from copy import copy
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._fields import BadInput
from .._status import Status
from ..compressor import Compressor
from ..crank import Collocation, Shooting
from ..design import Chain, Found, quantity
from ..machine import Machine, assembled
from ._measure import Program, compile_program
from ._report import Order, Reference, Row


class Question(NamedTuple):
    """What the errors are of.

    Attributes:
        design: the machine.
        quantity: name of a `jaxcomp.design.quantity`.
        variable: name of a variable, for studies of derivatives.
        excitation: what shakes the rotor: "crank" or "file"; see `Chain`.
    """

    design: Machine
    quantity: str
    variable: str | None = None
    excitation: Literal["crank", "file"] | None = None

    @property
    def compressor(self) -> Compressor | None:
        """Put together, with what a rotor gives to the crankshaft."""
        return assembled(self.design).compressor

    @property
    def default_solver(self) -> Collocation:
        """What `solve_orbit` takes for this machine."""
        return Collocation(reversals=self.load_reversals)

    @property
    def load_reversals(self) -> int:
        """Of the mechanism, in mid-stroke."""
        machine = self.compressor
        return 0 if machine is None else machine.mechanism.load_reversals

    def chain(self, solver: Collocation | Shooting, tolerance: float) -> Chain:
        """The solvers of a design, with the tolerance as an array."""
        solver = eqx.tree_at(lambda s: s.tolerance, solver, jnp.asarray(tolerance, float))
        return Chain(solver, self.excitation)


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
        name, unit: of what the errors are of, if that is not the quantity itself.
    """

    reference: Callable[[], Reference]
    pieces: tuple[Piece, ...]
    note: str = ""
    orders: Callable[[list[Row], Reference], dict[str, Order]] = lambda rows, reference: {}
    name: str | None = None
    unit: str | None = None


class Solved(NamedTuple):
    """A quantity of a design.

    Attributes:
        value: [SI]
        passes: of the crank's solver; 0 where none ran at the design's own speed.
        ok: whether it can be relied on.
        status: of the periodic state.
    """

    value: Float[Array, ""]
    passes: Int[Array, ""]
    ok: Bool[Array, ""]
    status: Status

    @property
    def why(self) -> str:
        """What went wrong, if anything did."""
        if bool(self.ok):
            return ""
        if bool(self.status != Status.converged):
            return Status[self.status]
        return "the response, or the periodic state at a speed of the balancing planes, is not converged"


def answer(design: Machine, chain: Chain, name: str) -> Solved:
    """A quantity of a design by a chain of solvers."""
    found = Found(design, chain)
    value = jnp.asarray(quantity(name).value(found), float)
    passes, status = jnp.asarray(0), Status.converged
    if "orbit" in found.__dict__:
        passes, status = found.orbit.iterations, found.orbit.status
    return Solved(value, passes, found.ok & jnp.isfinite(value), status)


class SolverProgram:
    """A quantity by one solver, compiled once for all its tolerances."""

    def __init__(self, question: Question, solver: Collocation | Shooting):
        self._question, self._solver = question, solver
        self.program: Program = compile_program(
            answer, question.design, question.chain(solver, 1e-7), question.quantity
        )

    def at(self, design: Machine) -> "SolverProgram":
        """The same program for a design with other numbers."""
        other = copy(self)
        other._question = self._question._replace(design=design)
        return other

    def __call__(self, tolerance: float) -> Solved:
        """The quantity at a tolerance."""
        return self.program(*self._arguments(tolerance))

    def value(self, tolerance: float) -> float:
        """[SI] The quantity at a tolerance, for a reference.

        Raises:
            BadInput: the solver found none.
        """
        found = self(tolerance)
        if found.why:
            raise BadInput(
                "quantity", self._question.quantity, f"one with a value here: {found.why}"
            )
        return float(found.value)

    def row(
        self,
        reference: Reference,
        method: str,
        setting: str,
        tolerance: float,
        *tightness: float,
        family: str = "",
        candidate: bool = True,
    ) -> Row:
        """The row of a tolerance; whatever else makes it tighter than its family is `tightness`."""
        found = self(tolerance)
        return Row(
            method,
            setting,
            float("inf") if found.why else reference.error(float(found.value)),
            self.seconds(tolerance),
            self.program.seconds,
            int(found.passes) or None,
            self.program.flops,
            family,
            (-math.log10(tolerance), *tightness),
            found.why,
            candidate,
        )

    def seconds(self, tolerance: float) -> float:
        """[s] median of several calls."""
        return self.program.timed(*self._arguments(tolerance))

    def _arguments(self, tolerance):
        question = self._question
        return question.design, question.chain(self._solver, tolerance), question.quantity


def needs_crank(question: Question, study: str) -> None:
    """Refuse a study of the crank's solvers where there is no crank, or it plays no part.

    Raises:
        BadInput: such a scene or quantity.
    """
    if question.compressor is None:
        raise BadInput("study", study, "one that a scene without compressor has, such as 'mesh'")


# [-] Two values that differ by less are the same number.
_ROUNDING = 1e-15


def needs_solver(question: Question, program: SolverProgram, tight: float) -> float:
    """The value [SI] at a tight tolerance, of a quantity that the tolerance of the solver changes.

    Raises:
        BadInput: the loosest tolerance gives the same number: no setting has an error to report.
    """
    value, loose = program.value(tight), float(program(0.1).value)
    if abs(value - loose) <= _ROUNDING * abs(value):
        shaken = question.excitation is not None
        cause = f" (with the excitation '{question.excitation}')" if shaken else ""
        bound = f"one that the solver of the periodic state has a part in{cause}"
        raise BadInput("quantity", question.quantity, bound)
    return value
