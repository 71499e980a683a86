r"""The engine of all studies: settings that are run, timed and compared with a reference.

A study is a reference and a list of settings, mostly rows over tolerances, nodes or steps. A setting
prepares a call that gives the quantity, or several values of it; `measured` runs and times the call.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Iterable
from functools import cache, cached_property, partial
from typing import Any, Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._core.errors import BadInput
from ..._core.programs import compiled_anew
from ..._core.status import SolveFailed, Status
from ...compressor import Compressor
from ...crank import Collocation, Shooting
from ...crank._collocation import default_collocation
from ...cylinder import CycleOptions
from ...machine import Assembly, Machine, assembled
from .. import AnalysisOptions, DesignResult
from .._analysis import quantity_named
from ._report import Measurement, Reference

# Of the reference.
FINE_NODES = 24
FINE_TOLERANCE = 1e-13
TIGHT_TOLERANCE = 1e-9
# Families of quantities of the rotor: they need the periodic states at several speeds.
ROTOR_QUANTITIES = ("vibration", "balanced_vibration", "mount_force")
# [s] A time is the median of the calls of this long: of three at least, unless they take longer still.
_WATCHED = 0.15
_LONG = 2.0
_LEAST = 3

Value = TypeVar("Value")


class Program:
    """A function compiled for the shapes of its arguments, with the cost of compiling it.

    Args:
        function: of pytrees, to be compiled.
        *arguments: an example: values of its arrays may change from call to call, all else is fixed.

    Attributes:
        seconds: [s] to trace and to compile.
        flops: operations of the compiled program by XLA's count: the body of a loop counts once,
            however often it runs.
        lines: of the program in StableHLO, before XLA's optimisation.
        memory: [bytes] of its intermediate results, or `None` where the backend does not report it.
        text: the program after XLA's optimisation.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any):
        arrays, static = eqx.partition(arguments, eqx.is_array)

        def plain(arrays):
            return function(*eqx.combine(arrays, static))

        start = time.perf_counter()
        lowered = jax.jit(plain).lower(arrays)
        with compiled_anew():
            self._compiled = lowered.compile()
        self.seconds = time.perf_counter() - start
        self.lines = lowered.as_text().count("\n")

    def __call__(self, *arguments: Any) -> Any:
        """The result for arguments of the same shapes; what is no array is that of the first."""
        return self.on(*arguments)()

    def on(self, *arguments: Any) -> Callable[[], Any]:
        """A call for these arguments."""
        arrays = eqx.filter(arguments, eqx.is_array)
        return lambda: self._compiled(arrays)

    def timed(self, *arguments: Any) -> float:
        """[s] median of several calls."""
        return median_time(self.on(*arguments))

    @cached_property
    def flops(self) -> float:
        costs = self._compiled.cost_analysis() or {}
        return float(costs.get("flops", np.nan))

    @property
    def memory(self) -> int | None:
        analysis = self._compiled.memory_analysis()
        if analysis is None:
            return None
        return int(analysis.temp_size_in_bytes)

    @property
    def text(self) -> str:
        return self._compiled.as_text() or ""


def median_time(call: Callable[[], Any]) -> float:
    """[s] median time of a call after a first one that does not count."""
    jax.block_until_ready(call())
    times: list[float] = []
    spent = 0.0  # counted as it goes: a call of a microsecond is repeated a hundred thousand times
    while spent < _WATCHED or (len(times) < _LEAST and spent < _LONG):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
        spent += times[-1]
    return float(np.median(times))


class Question(NamedTuple):
    """Subject of the errors that are measured.

    Attributes:
        design: the machine.
        quantity: name of a `quantity_named`.
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
    def crank(self) -> Compressor:
        """The compressor, for studies of machines that have one."""
        assert self.compressor is not None
        return self.compressor

    @property
    def default_solver(self) -> Collocation:
        """Solver that `solve_orbit` takes for this machine."""
        machine = self.compressor
        if machine is None:
            return Collocation(reversals=0)
        return default_collocation(machine)

    @property
    def fine_solver(self) -> Collocation:
        """That of references."""
        cycle = CycleOptions(panels=80, nodes=8)
        return Collocation(nodes=FINE_NODES, reversals=self.load_reversals, cycle=cycle)

    @property
    def load_reversals(self) -> int:
        """Number of load reversals of the mechanism within a stroke."""
        machine = self.compressor
        if machine is None:
            return 0
        return machine.load_reversals

    def options(
        self, solver: Collocation | Shooting | None, tolerance: float = FINE_TOLERANCE
    ) -> AnalysisOptions:
        """The solvers of a design, with the tolerance as an array; `None` for the defaults."""
        if solver is not None:
            # As an array, so that one program serves all tolerances.
            solver = eqx.tree_at(lambda s: s.tolerance, solver, jnp.asarray(tolerance, float))
        return AnalysisOptions(solver, self.excitation, self.orders)


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
        """Reason of a failure, if there was one."""
        if bool(self.status != Status.converged):
            return Status[self.status]
        if not bool(self.ok):
            return "the response, or a periodic state that it needs, is not converged"
        if np.all(np.isfinite(self.value)):
            return ""
        return "the value is not finite"


class Call(NamedTuple):
    """A call that is measured.

    Attributes:
        run: gives a number, an array of them, or a `Solved`.
        program: what it runs, where that is one compiled program.
        seconds: [s] its median time, where that is known already.
    """

    run: Callable[[], Any]
    program: Program | None = None
    seconds: float | None = None


class Setting(NamedTuple):
    """One setting of one method.

    Attributes:
        method: name of the curve it belongs to.
        label: what is particular to it.
        prepare: makes its call, and compiles what is not compiled yet.
        tightness, family, candidate, task: as in `Measurement`.
        share: results of one call: times and operations are of one.
        reference: what its error is relative to, if that is another one than the study's.
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
    """Plan of the settings that answer a question.

    Attributes:
        reference: finds the converged value.
        settings: to be tried.
        note: one line on what is varied.
        name, unit: of what the errors are of, if that is not the quantity itself.
        findings: further attributes of the `Report`, from all measurements and the reference.
    """

    reference: Callable[[], Reference]
    settings: tuple[Setting, ...]
    note: str = ""
    name: str | None = None
    unit: str | None = None
    findings: Callable[[list[Measurement], Reference], dict[str, Any]] = lambda rows, reference: {}


def digits(tolerance: float) -> float:
    """Tightness of a setting by its tolerance."""
    return -math.log10(tolerance)


def series(
    method: str,
    label: str,
    call: Callable[[Any], Call],
    values: Iterable[Any],
    tightness: Callable[[Any], float] | None = None,
    **options: Any,
) -> list[Setting]:
    """Settings of one method that differ in one number.

    Args:
        method: name of the curve.
        label: with a place for the number.
        call: from the number to the call.
        values: of the number.
        tightness: by the number, such as `digits` or `float`; absent: the settings are in no order.
        **options: as in `Setting`.
    """
    settings = []
    for value in values:
        tight = ()
        if tightness is not None:
            tight = (tightness(value),)
        setting = Setting(
            method=method,
            label=label.format(value),
            prepare=partial(call, value),
            tightness=tight,
            **options,
        )
        settings.append(setting)
    return settings


class Compiled:
    """A function that is compiled when it is first needed, for all arguments of the same shapes."""

    def __init__(self, function: Callable[..., Any]):
        self._function = function
        self._program = None

    def call(self, *arguments: Any) -> Call:
        """A call for these arguments."""
        if self._program is None:
            self._program = Program(self._function, *arguments)
        return Call(self._program.on(*arguments), self._program)

    def __call__(self, *arguments: Any) -> Any:
        """The result for these arguments."""
        return self.call(*arguments).run()


class SolverProgram:
    """The quantity of a question by one solver, compiled once for all its tolerances.

    Args:
        question: whose quantity and machine are taken.
        solver: of the periodic state; `None` for the default.
        names: several quantities instead of that of the question.
        compiled: `answer`, where it is compiled for arguments of the same shapes already.
    """

    def __init__(
        self,
        question: Question,
        solver: Collocation | Shooting | None,
        names: tuple[str, ...] | None = None,
        compiled: Compiled | None = None,
    ):
        self._question = question
        self._solver = solver
        self._names = question.quantity if names is None else names
        self.compiled = compiled or Compiled(answer)

    def call(self, tolerance: float = FINE_TOLERANCE) -> Call:
        """The quantity at a tolerance."""
        options = self._question.options(self._solver, tolerance)
        return self.compiled.call(self._question.design, options, self._names)

    def value(self, tolerance: float) -> Any:
        """[SI] The quantity at a tolerance, for a reference.

        Raises:
            BadInput: the solver found none.
        """
        return known_value(self._question, self.call(tolerance).run())

    def setting(
        self, method: str, label: str, tolerance: float, *tightness: float, **options: Any
    ) -> Setting:
        """A setting of a tolerance; whatever else makes it tighter than its family is `tightness`."""
        tight = (digits(tolerance), *tightness)
        return Setting(method, label, partial(self.call, tolerance), tight, **options)


def answer(design: Machine, options: AnalysisOptions, names: str | tuple[str, ...]) -> Solved:
    """A quantity of a design by its solvers, or several."""
    result = DesignResult(design, options)
    if isinstance(names, str):
        value = jnp.asarray(quantity_named(names).value(result), float)
    else:
        values = []
        for name in names:
            values.append(jnp.asarray(quantity_named(name).value(result), float))
        value = jnp.stack(values)
    iterations = jnp.asarray(0)
    status = Status.converged
    if "orbit" in result.__dict__:
        iterations = result.orbit.iterations
        status = result.orbit.status
    return Solved(value=value, iterations=iterations, ok=result.ok, status=status)


def computed_once(compute: Callable[[], Value]) -> Callable[[], Value]:
    """The function with its value, or the refusal in place of one, kept from the first call on."""

    # `functools.cache` forgets what was raised, and a reference without a value takes as long as any
    @cache
    def outcome() -> Value | BadInput:
        try:
            return compute()
        except BadInput as refusal:
            return refusal

    def value() -> Value:
        result = outcome()
        if isinstance(result, BadInput):
            raise result
        return result

    return value


def known_value(question: Question, solved: Solved) -> Any:
    """[SI] The value that the solvers gave, for a reference.

    Raises:
        BadInput: they gave none.
    """
    if solved.why:
        raise no_value(question, solved.why)
    return np.asarray(solved.value)[()]


def no_value(question: Question, why: str) -> BadInput:
    """A quantity that has none."""
    return BadInput("quantity", question.quantity, f"one with a value here: {why}")


def measured(setting: Setting, reference: Reference) -> Measurement:
    """Error and time of a setting."""
    row = Measurement(
        method=setting.method,
        setting=setting.label,
        error=math.inf,
        seconds=math.nan,
        compile_seconds=math.nan,
        family=setting.family,
        tightness=setting.tightness,
        candidate=setting.candidate,
        task=setting.task,
    )
    try:
        if setting.reference is not None:
            reference = setting.reference()
            row = dataclasses.replace(row, floor=reference.floor)
        call = setting.prepare()
        start = time.perf_counter()
        result = jax.block_until_ready(call.run())
        first = time.perf_counter() - start
    except (RuntimeError, SolveFailed, BadInput) as failed:
        return dataclasses.replace(row, why=str(failed))
    solved = result
    if not isinstance(result, Solved):
        solved = Solved(result)
    seconds = call.seconds
    if seconds is None:
        seconds = median_time(call.run)
    program = call.program
    # Where no program tells what it took to compile, the first call tells by how much it was longer.
    compile_seconds = max(first - seconds, 0.0)
    if program is not None:
        compile_seconds = program.seconds
    error = math.inf
    if not solved.why:
        error = reference.error(solved.value)
    row = dataclasses.replace(
        row,
        error=error,
        seconds=seconds / setting.share,
        compile_seconds=compile_seconds,
        iterations=int(solved.iterations) or None,
        why=solved.why,
    )
    if program is None:
        return row
    return dataclasses.replace(row, flops=program.flops / setting.share, lines=program.lines)
