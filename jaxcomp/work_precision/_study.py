r"""What the studies share: the question, its answer by a chain of solvers, and how a setting is measured.

A study is a reference and a list of settings. A setting makes a call that gives the quantity, or several
values of it; the call is run, timed, and its error taken relative to the reference.
"""

import math
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from .._status import SolveFailed, Status
from ..compressor import Compressor
from ..crank import Collocation, Shooting
from ..design import AnalysisOptions, DesignResult, quantity
from ..machine import Assembly, Machine, assembled
from ._measure import Program, compile_program, median_time
from ._report import Order, Reference, Row

# Of the reference.
FINE_NODES, FINE_TOLERANCE, TIGHT_TOLERANCE = 24, 1e-13, 1e-9
# Nodes of its second method, at other places: what both read off their nodes shows the difference.
OTHER_NODES = 37


class Question(NamedTuple):
    """What the errors are of.

    Attributes:
        design: the machine.
        quantity: name of a `jaxcomp.design.quantity`.
        variable: name of a variable, for studies in which one changes.
        excitation: what shakes the rotor: "crank" or "file"; see `AnalysisOptions`.
        orders: of the spin speed that count in vibrations.
    """

    design: Machine
    quantity: str
    variable: str | None = None
    excitation: Literal["crank", "file"] | None = None
    orders: tuple[int, ...] = (1,)

    @property
    def assembly(self) -> Assembly:
        """The machine put together."""
        return assembled(self.design)

    @property
    def compressor(self) -> Compressor | None:
        """Put together, with what a rotor gives to the crankshaft."""
        return self.assembly.compressor

    @property
    def default_solver(self) -> Collocation:
        """What `solve_orbit` takes for this machine."""
        return Collocation(reversals=self.load_reversals)

    @property
    def fine_solver(self) -> Collocation:
        """That of references."""
        return Collocation(nodes=FINE_NODES, reversals=self.load_reversals)

    @property
    def load_reversals(self) -> int:
        """Of the mechanism, in mid-stroke."""
        machine = self.compressor
        return 0 if machine is None else machine.mechanism.load_reversals

    def options(
        self, solver: Collocation | Shooting | None, tolerance: float = 1e-13
    ) -> AnalysisOptions:
        """The solvers of a design, with the tolerance as an array; `None` for the defaults."""
        if solver is not None:
            solver = eqx.tree_at(lambda s: s.tolerance, solver, jnp.asarray(tolerance, float))
        return AnalysisOptions(solver, self.excitation, self.orders)


class Call(NamedTuple):
    """A call that is measured.

    Attributes:
        run: gives a number, an array of them, or a `Solved`.
        program: what it runs, where that is one compiled program.
    """

    run: Callable[[], Any]
    program: Program | None = None


class Setting(NamedTuple):
    """One setting of one method.

    Attributes:
        method: name of the curve it belongs to.
        words: what is particular to it.
        make: prepares its call, and compiles what is not compiled yet.
        tightness, family, candidate: as in `Row`.
        share: results of one call: times and operations are of one.
        reference: what its error is relative to, if that is another one than the study's.
        task: as in `Row`.
    """

    method: str
    words: str
    make: Callable[[], Call]
    tightness: tuple[float, ...] = ()
    family: str = ""
    candidate: bool = True
    share: int = 1
    reference: Callable[[], Reference] | None = None
    task: str = ""


class Study(NamedTuple):
    """How a question is studied.

    Attributes:
        reference: finds the converged value.
        settings: to be tried.
        note: one line on what is varied.
        orders: of fixed-step methods, from all rows.
        name, unit: of what the errors are of, if that is not the quantity itself.
    """

    reference: Callable[[], Reference]
    settings: tuple[Setting, ...]
    note: str = ""
    orders: Callable[[list[Row], Reference], dict[str, Order]] = lambda rows, reference: {}
    name: str | None = None
    unit: str | None = None


class Solved(NamedTuple):
    """A quantity of a design, or another result with its evidence.

    Attributes:
        value: [SI]
        passes: of the crank's solver; 0 where none ran at the design's own speed.
        ok: whether it can be relied on.
        status: of the periodic state.
    """

    value: Any
    passes: Any = 0
    ok: Any = True
    status: Status = Status.converged

    @property
    def why(self) -> str:
        """What went wrong, if anything did."""
        if bool(self.status != Status.converged):
            return Status[self.status]
        if not bool(self.ok):
            return "the response, or a periodic state that it needs, is not converged"
        return "" if np.all(np.isfinite(self.value)) else "the value is not finite"


def measured(setting: Setting, reference: Reference) -> Row:
    """The row of a setting."""
    row = Row(setting.method, setting.words, math.inf, math.nan, math.nan,
              family=setting.family, tightness=setting.tightness, candidate=setting.candidate,
              task=setting.task)  # fmt: skip
    try:
        if setting.reference is not None:
            reference = setting.reference()
            row = row._replace(floor=reference.floor)
        call = setting.make()
        start = time.perf_counter()
        found = jax.block_until_ready(call.run())
        first = time.perf_counter() - start
    except (RuntimeError, SolveFailed, BadInput) as failed:
        return row._replace(why=str(failed))
    solved = found if isinstance(found, Solved) else Solved(found)
    seconds, program = median_time(call.run), call.program
    row = row._replace(
        error=math.inf if solved.why else reference.error(solved.value),
        seconds=seconds / setting.share,
        compile_seconds=max(first - seconds, 0.0) if program is None else program.seconds,
        passes=int(solved.passes) or None,
        why=solved.why,
    )
    if program is None:
        return row
    return row._replace(flops=program.flops / setting.share, lines=program.lines)


def answer(design: Machine, options: AnalysisOptions, names: str | tuple[str, ...]) -> Solved:
    """A quantity of a design by a chain of solvers, or several."""
    found = DesignResult(design, options)
    several = (names,) if isinstance(names, str) else names
    values = [jnp.asarray(quantity(name).value(found), float) for name in several]
    value = values[0] if isinstance(names, str) else jnp.stack(values)
    passes, status = jnp.asarray(0), Status.converged
    if "orbit" in found.__dict__:
        passes, status = found.orbit.iterations, found.orbit.status
    return Solved(value, passes, found.ok, status)


class SolverProgram:
    """A quantity by one solver (`None` for the defaults), compiled once for all its tolerances."""

    def __init__(
        self,
        question: Question,
        solver: Collocation | Shooting | None,
        names: tuple[str, ...] | None = None,
    ):
        self.question, self._solver = question, solver
        self._names = question.quantity if names is None else names

    @cached_property
    def program(self) -> Program:
        """Compiled when it is first needed."""
        return compile_program(answer, *self._arguments(1e-7))

    def at(self, design: Machine) -> "SolverProgram":
        """The same program for a design with other numbers."""
        other = SolverProgram(self.question._replace(design=design), self._solver)
        other.program = self.program
        return other

    def call(self, tolerance: float = 1e-13) -> Call:
        """The quantity at a tolerance."""
        return Call(self.program.on(*self._arguments(tolerance)), self.program)

    def value(self, tolerance: float) -> Any:
        """[SI] The quantity at a tolerance, for a reference.

        Raises:
            BadInput: the solver found none.
        """
        found = self.call(tolerance).run()
        if found.why:
            raise no_value(self.question, found.why)
        return np.asarray(found.value)[()]

    def setting(
        self, method: str, words: str, tolerance: float, *tightness: float, **options: Any
    ) -> Setting:
        """A setting of a tolerance; whatever else makes it tighter than its family is `tightness`."""
        tight = (-math.log10(tolerance), *tightness)
        return Setting(method, words, lambda: self.call(tolerance), tight, **options)

    def _arguments(self, tolerance):
        options = self.question.options(self._solver, tolerance)
        return self.question.design, options, self._names


def no_value(question: Question, why: str) -> BadInput:
    """A quantity that has none."""
    return BadInput("quantity", question.quantity, f"one with a value here: {why}")


def needs_crank(question: Question, study: str) -> Compressor:
    """The compressor, for a study of the crank's solvers.

    Raises:
        BadInput: a scene without one.
    """
    machine = question.compressor
    if machine is None:
        raise BadInput("study", study, "one that a scene without compressor has, such as 'mesh'")
    return machine


def needs_rotor(question: Question, study: str) -> Assembly:
    """The machine put together, for a study of its rotor.

    Raises:
        BadInput: a scene without rotor, loads or balancing planes.
    """
    made = question.assembly
    if made.rotor is None or made.loads is None or made.balancing is None:
        raise BadInput("study", study, "one that the scene has: it needs a rotor with its planes")
    return made


# [-] Two values that differ by less are the same number: of one program, and of two methods.
ROUNDING, ROUNDINGS = 1e-15, 1e-12


def without_error(value: float, loose: float, other: float) -> bool:
    """Whether neither the tolerance of the solver nor another method changes a value."""
    same = abs(value - loose) <= ROUNDING * abs(value)
    return bool(same and abs(value - other) <= ROUNDINGS * abs(value))


def needs_solver(question: Question, program: SolverProgram, other: float) -> float:
    """The value [SI] at a tight tolerance, of a quantity in which the solver has a part.

    Raises:
        BadInput: the loosest tolerance gives the same number, and the other method as well: no setting
            has an error to report.
    """
    value, loose = program.value(FINE_TOLERANCE), float(program.call(0.1).run().value)
    if without_error(value, loose, other):
        shaken = question.excitation is not None
        cause = f" (with the excitation '{question.excitation}')" if shaken else ""
        bound = f"one that the solver of the periodic state has a part in{cause}"
        raise BadInput("quantity", question.quantity, bound)
    return value
