r"""Parts that all studies share: the question, its answer by a solver, and measuring a setting.

A study is a reference and a list of settings. A setting prepares a call that gives the quantity, or
several values of it; the call is run, timed, and its error taken relative to the reference.
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
from ..crank import Collocation, Shooting, default_collocation
from ..design import AnalysisOptions, DesignResult, quantity
from ..machine import Assembly, Machine, assembled
from ._measure import Program, median_time
from ._report import DerivativeCheck, Growth, Measurement, Order, Reference

# Of the reference.
FINE_NODES, FINE_TOLERANCE, TIGHT_TOLERANCE = 24, 1e-13, 1e-9
# Nodes of its second method, at other places: what both read off their nodes shows the difference.
OTHER_NODES = 37
# Families of quantities of the rotor: they need the periodic states at several speeds.
ROTOR_QUANTITIES = ("vibration", "balanced_vibration", "mount_force")


class Question(NamedTuple):
    """What the errors are of.

    Attributes:
        design: the machine.
        quantity: name of a `jaxcomp.design.quantity`.
        variable: name of a variable, for studies in which one changes.
        excitation: forces on the rotor: those of the "crank" or of the "file"; see `AnalysisOptions`.
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
        machine = self.compressor
        return Collocation(reversals=0) if machine is None else default_collocation(machine)

    @property
    def fine_solver(self) -> Collocation:
        """That of references."""
        return Collocation(nodes=FINE_NODES, reversals=self.load_reversals)

    @property
    def load_reversals(self) -> int:
        """Of the mechanism, within a stroke."""
        machine = self.compressor
        return 0 if machine is None else machine.load_reversals

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
        label: what is particular to it.
        prepare: makes its call, and compiles what is not compiled yet.
        tightness, family, candidate: as in `Measurement`.
        share: results of one call: times and operations are of one.
        reference: what its error is relative to, if that is another one than the study's.
        task: as in `Measurement`.
    """

    method: str
    label: str
    prepare: Callable[[], Call]
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
        orders: of fixed-step methods, from all measurements.
        name, unit: of what the errors are of, if that is not the quantity itself.
        growth: cost over the number of cylinders, from all measurements.
        derivatives: their error beside that of the values, from all measurements.
    """

    reference: Callable[[], Reference]
    settings: tuple[Setting, ...]
    note: str = ""
    orders: Callable[[list[Measurement], Reference], dict[str, Order]] = lambda rows, reference: {}
    name: str | None = None
    unit: str | None = None
    growth: Callable[[list[Measurement]], dict[str, Growth]] = lambda rows: {}
    derivatives: Callable[[list[Measurement]], DerivativeCheck | None] = lambda rows: None


class Solved(NamedTuple):
    """A value with the status of the solvers that gave it.

    Attributes:
        value: [SI]
        iterations: of the crank's solver; 0 where none ran at the design's own speed.
        ok: whether all solvers converged.
        status: of the periodic state.
    """

    value: Any
    iterations: Any = 0
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


def measured(setting: Setting, reference: Reference) -> Measurement:
    """Error and time of a setting."""
    row = Measurement(setting.method, setting.label, math.inf, math.nan, math.nan,
                      family=setting.family, tightness=setting.tightness,
                      candidate=setting.candidate, task=setting.task)  # fmt: skip
    try:
        if setting.reference is not None:
            reference = setting.reference()
            row = row._replace(floor=reference.floor)
        call = setting.prepare()
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
        iterations=int(solved.iterations) or None,
        why=solved.why,
    )
    if program is None:
        return row
    return row._replace(flops=program.flops / setting.share, lines=program.lines)


def answer(design: Machine, options: AnalysisOptions, names: str | tuple[str, ...]) -> Solved:
    """A quantity of a design by its solvers, or several."""
    found = DesignResult(design, options)
    several = (names,) if isinstance(names, str) else names
    values = [jnp.asarray(quantity(name).value(found), float) for name in several]
    value = values[0] if isinstance(names, str) else jnp.stack(values)
    iterations, status = jnp.asarray(0), Status.converged
    if "orbit" in found.__dict__:
        iterations, status = found.orbit.iterations, found.orbit.status
    return Solved(value, iterations, found.ok, status)


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
        return Program(answer, *self._arguments(1e-7))

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
        self, method: str, label: str, tolerance: float, *tightness: float, **options: Any
    ) -> Setting:
        """A setting of a tolerance; whatever else makes it tighter than its family is `tightness`."""
        tight = (-math.log10(tolerance), *tightness)
        return Setting(method, label, lambda: self.call(tolerance), tight, **options)

    def _arguments(self, tolerance):
        options = self.question.options(self._solver, tolerance)
        return self.question.design, options, self._names


def no_value(question: Question, why: str) -> BadInput:
    """A quantity that has none."""
    return BadInput("quantity", question.quantity, f"one with a value here: {why}")


# [-] Two values that differ by less are the same number: of one program, and of two methods.
ROUNDING, ROUNDINGS = 1e-15, 1e-12


def without_error(value: float, loose: float, other: float) -> bool:
    """Whether neither the tolerance of the solver nor another method changes a value."""
    same = abs(value - loose) <= ROUNDING * abs(value)
    return bool(same and abs(value - other) <= ROUNDINGS * abs(value))
