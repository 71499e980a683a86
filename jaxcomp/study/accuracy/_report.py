r"""Results of a study: settings with error and time, and the reference they are compared with."""

import dataclasses
import os
import platform
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any, ClassVar

import numpy as np

from ..._core.declared import (
    QUANTITY,
    Record,
    computed,
    computed_part,
    computed_word,
    forwarded,
    held,
    part,
    reading,
    word,
)
from ..._core.evidence import Check
from ..._core.results import Data, Result, columns_of

# Errors at which methods are compared.
_DECADES = tuple(10.0**-n for n in range(2, 13))
# Numbers of a row that stand in the table.
_COLUMNS = ("method", "setting", "error", "seconds", "compile_seconds")


@dataclasses.dataclass(frozen=True)
class Computer(Record):
    """A computer that measured, at that moment.

    Attributes:
        cores: [-] how many it has.
        load: [-] mean number of processes that ran or waited, over the last minute.
        python, jax, diffrax, scipy, jaxcomp: their versions.
    """

    cores: int | None = reading("")
    load: float = reading("")
    python: str = word()
    jax: str = word()
    diffrax: str = word()
    scipy: str = word()
    jaxcomp: str = word()


def this_computer() -> Computer:
    """Cores, load and versions of the computer at this moment."""
    versions = {name: version(name) for name in ("jax", "diffrax", "scipy", "jaxcomp")}
    load = os.getloadavg()[0]
    return Computer(os.cpu_count(), load, platform.python_version(), **versions)


@dataclasses.dataclass(frozen=True)
class Reference(Record):
    """The converged value, by two methods that share nothing but the laws.

    Attributes:
        value: [SI] of the first method: a number, or an array of several.
        other: [SI] of the second method.
        methods: what the two are.
        each: whether every entry, or row of entries, is compared with its own size.
    """

    value: Any = reading(QUANTITY)
    other: Any = reading(QUANTITY)
    methods: tuple[str, str] = word()
    each: bool = word(default=False)

    @computed("", doc="below which no error is claimed")
    def floor(self) -> float:
        """[-] Disagreement of the methods over the value: no smaller error is claimed.

        Not below the rounding of the number format.
        """
        return max(self.error(self.other), float(np.finfo(float).eps))

    def error(self, value: Any) -> float:
        """[-] Largest difference over the largest reference value; absolute where that is zero."""
        rows = 1
        if self.each:
            rows = len(self.value)
        size = np.max(np.abs(np.reshape(self.value, (rows, -1))), axis=1)
        gap = np.max(np.abs(np.reshape(value - self.value, (rows, -1))), axis=1)
        return float(np.max(gap / np.where(size > 0, size, 1.0)))


@dataclasses.dataclass(frozen=True)
class Measurement(Record):
    """One setting of one method.

    Attributes:
        method: name of the curve it belongs to.
        setting: what is particular to it.
        error: [-] relative to the reference; infinite where the solver did not converge.
        seconds: [s] median of several warm calls.
        compile_seconds: [s] of the program it runs, which other settings of the method may share.
        iterations: Newton steps, time steps or calls, as the method counts them; `None` for none.
        flops: operations of the program, loop bodies counted once; `None` where nothing is compiled.
        family: settings of one method that are ordered among each other.
        tightness: what makes a setting of its family tighter than another; empty where none is.
        why: what went wrong where the error is infinite.
        candidate: whether it may be recommended: not with other numbers of the machine, and not where
            the best setting is only known beside the reference.
        lines: of the program in StableHLO; `None` where nothing is compiled.
        floor: [-] of a reference of its own; `None` where that of the report is used.
        task: problem that it solves, in studies of several: only settings of one task compete.
    """

    method: str = word()
    setting: str = word()
    error: float = reading("")
    seconds: float = reading("s")
    compile_seconds: float = reading("s")
    iterations: int | None = reading("", default=None)
    flops: float | None = reading("", default=None)
    family: str = word(default="")
    tightness: tuple[float, ...] = reading("", default=())
    why: str = word(default="")
    candidate: bool = word(default=True)
    lines: int | None = reading("", default=None)
    floor: float | None = reading("", default=None)
    task: str = word(default="")

    def at_least_as_tight(self, other: "Measurement") -> bool:
        """Whether this is the other setting or a tighter one of its family."""
        if (self.method, self.family) != (other.method, other.family) or not other.tightness:
            return False
        return all(a >= b for a, b in zip(self.tightness, other.tightness, strict=True))


@dataclasses.dataclass(frozen=True)
class Cost(Record):
    """Time of the first and of the second call of a program.

    Attributes:
        first: [s] to trace, to compile and to run.
        second: [s] of a warm call.
        lines: [-] of the program in StableHLO.
    """

    first: float = reading("s")
    second: float = reading("s")
    lines: int = reading("")


@dataclasses.dataclass(frozen=True)
class DerivativeCheck(Record):
    """Error of derivatives beside that of the values, at the default options.

    Attributes:
        setting: the default one.
        value, gradient: [-] errors that can be claimed of values and derivatives.
    """

    setting: str = word()
    value: float = reading("")
    gradient: float = reading("")

    @computed("")
    def ratio(self) -> float:
        """[-] Error of the derivatives over that of the values."""
        return self.gradient / self.value

    @computed_word()
    def holds(self) -> bool:
        """Whether the derivatives err by at most ten times as much."""
        return self.ratio <= 10


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Report(Result):
    """Error against run time.

    Attributes:
        study: what was varied.
        scene: name of the machine.
        quantity: what the errors are of.
        unit: its SI unit.
        reference: what they are relative to.
        rows: every setting.
        note: one line on what the study varies.
        march: relative errors of the default solver by an independent march of one revolution: of the
            speed, of the efficiency, the sum of the losses over the work of the motor, and the largest
            of the peak forces; empty for studies without the crank.
        calls: what the first and second call of the default solver cost, without and with the gradient
            over all numbers of the machine; empty for studies of something else.
        derivatives: their error beside that of the values, in the study of the cycle.
        error: [-] for which the cheapest setting is named.
        measured_on: cores, load and versions of the computer that measured.
    """

    study: str = word()
    scene: str = word()
    quantity: str = word()
    unit: str = word()
    reference: Reference = part(Reference)
    rows: tuple[Measurement, ...] = part(Measurement)
    note: str = held()
    march: dict[str, float] = reading("", default_factory=dict)
    calls: dict[str, Cost] = part(Cost, by_name=True, default_factory=dict)
    derivatives: DerivativeCheck | None = part(DerivativeCheck, default=None)
    error: float = reading("", default=1e-6)
    measured_on: Computer = part(Computer, default_factory=this_computer)

    table_dims: ClassVar[tuple[str, ...]] = ("row",)

    least_error = forwarded(Reference, "reference.floor", table_only=True)

    @computed_part(Measurement)
    def recommended(self) -> Measurement | None:
        """The cheapest setting for `error`."""
        return self.cheapest(self.error)

    @computed_part(Measurement, by_name=True)
    def recommended_by_task(self) -> dict[str, Measurement | None]:
        """The cheapest setting for `error` by the name of the task, where there are several."""
        recommended = {}
        for task in filter(None, self.tasks):
            recommended[task] = self.cheapest(self.error, task=task)
        return recommended

    @computed("s", key="cheapest")
    def cheapest_seconds(self) -> dict[str, dict[str, float | None]]:
        """[s] Of the cheapest setting for each power of ten of the error, by method."""
        cheapest = {}
        for error in self.reachable:
            cheapest[f"{error:g}"] = {name: self.seconds(error, name) for name in self.methods}
        return cheapest

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Whether a setting with the error that was asked for exists."""
        del tolerance
        answer = "none of those tried"
        if self.recommended is not None:
            answer = "found"
        name = f"Options with an error of at most {self.error:g}"
        return (Check(name, answer, answer == "found", "found"),)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each setting."""
        yield Data("quantity", "", self.quantity)
        yield from self.data_of(floor="least_error")
        # what follows may be a list, of other lengths for other methods
        yield from columns_of(self.rows, *self.table_dims, names=_COLUMNS)

    @property
    def reachable(self) -> list[float]:
        """[-] The powers of ten, from 1e-2 to 1e-12, that a setting has as its error."""
        return [at for at in _DECADES if self.cheapest(at) is not None]

    def seconds(self, error: float, method: str) -> float | None:
        """[s] of the cheapest setting of a method with at most this error [-]; `None` for none."""
        best = self.cheapest(error, method)
        return None if best is None else best.seconds

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the curves in the order of their first rows."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    @property
    def tasks(self) -> dict[str, tuple[str, ...]]:
        """Methods of each task."""
        methods: dict[str, tuple[str, ...]] = {}
        for row in self.rows:
            names = methods.get(row.task, ())
            if row.method not in names:
                methods[row.task] = *names, row.method
        return methods

    def claimed(self, row: Measurement) -> float:
        """[-] the error of a row that can be claimed: its own, or the floor of its reference."""
        return max(row.error, self.floor(row))

    def floor(self, row: Measurement) -> float:
        """[-] below which no error of a row is claimed."""
        if row.floor is None:
            return self.reference.floor
        return row.floor

    def cheapest(
        self, error: float, method: str | None = None, task: str | None = None
    ) -> Measurement | None:
        """The fastest setting that reliably has at most this error; `None` for none.

        A setting counts only if every tighter one of its family has at most this error as well: a loose
        tolerance may be lucky on one machine. Tighter ones that failed say so themselves, and do not
        count against it.

        Args:
            error: [-] relative, that is allowed.
            method: name of one; absent: all that may be recommended.
            task: that is solved; absent: any.
        """
        bad = []
        for row in self.rows:
            if np.isfinite(row.error) and self.claimed(row) > error:
                bad.append(row)

        def counts(row: Measurement) -> bool:
            eligible = row.candidate
            if method is not None:
                eligible = row.method == method
            if not eligible or (task is not None and row.task != task):
                return False
            if not self.claimed(row) <= error:
                return False
            return not any(other.at_least_as_tight(row) for other in bad)

        return min(filter(counts, self.rows), key=lambda row: row.seconds, default=None)

    @property
    def failures(self) -> dict[str, list[str]]:
        """Settings that gave no value, by the reason."""
        failures: dict[str, list[str]] = {}
        for row in self.rows:
            if not np.isfinite(row.error):
                why = row.why or "no finite value"
                failures.setdefault(why, []).append(f"{row.method}, {row.setting}")
        return failures

    def curve(self, method: str) -> tuple[Measurement, ...]:
        """The settings of a method that no other setting of it beats in both error and time."""
        rows: list[Measurement] = []
        of_method = [row for row in self.rows if row.method == method]
        for row in sorted(of_method, key=lambda row: (row.seconds, row.error)):
            if row.error < min((other.error for other in rows), default=np.inf):
                rows.append(row)
        return tuple(rows)
