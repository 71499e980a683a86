r"""How much a quantity of a machine changes with each of its numbers."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.arguments import listed_names
from .._core.declared import (
    BESIDE,
    RATIO,
    Record,
    computed_part,
    held,
    part,
    reading,
    records_of,
    word,
)
from .._core.display import Shown, is_temperature, shown, small_unit
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.results import Data, Result
from ..crank import Collocation
from ..crank._collocation import default_collocation
from ..cylinder import Cylinder
from ..machine import HasMachine, Machine, machine_of
from ._analysis import DesignResult
from ._analysis_options import AnalysisOptions, checked_options
from ._labels import variable_label
from ._problem import (
    Problem,
    RequestedQuantity,
    climb_of,
    in_size,
    name_of,
    solver_of,
    unit_of,
    values_of,
    with_solver,
)
from ._variables import GivenNumber, given_numbers

# [-] An elasticity below this is rounding.
_ROUNDING = 1e-12
# Nodes on every panel that a second solution has more, by which errors of derivatives are stated: with
# them an error of a smooth course falls by some orders of magnitude, so that the difference is the error.
_MORE_NODES = 4


@dataclasses.dataclass(frozen=True)
class Influence(Record):
    """Influence of one number on one quantity.

    Attributes:
        number: its name.
        part: the same in words.
        unit: SI unit of the number.
        present: [SI] the number.
        elasticity: [-] NaN where there is none, see `Sensitivity.elasticity`.
        derivative: [SI] of the quantity over the number.
        quantity: how the quantity is shown.
        error: [SI] stated error of the derivative; `None` where it was not asked for.
    """

    number: str = word(key="name")
    part: str = word(key="words")
    unit: str = word()
    present: float = reading(BESIDE, key="value")
    elasticity: float = reading("")
    derivative: float = reading(RATIO)
    quantity: Shown = held()
    error: float | None = reading(RATIO, optional=True, default=None)

    @property
    def relative(self) -> bool:
        """Whether there is an elasticity."""
        return bool(np.isfinite(self.elasticity))

    @property
    def value(self) -> str:
        """The number with the unit that suits it."""
        if self.part.endswith("all values"):
            return "as given"
        if not self.present:
            return f"0 {small_unit(self.unit)[0]}".strip()
        return shown(self.number, self.unit, self.present).text(self.present)

    @property
    def rise(self) -> float:
        """The number in `change`: per cent per per cent, or in the unit of the quantity."""
        if self.relative and self.quantity.level:
            return self.derivative * self.present * self.quantity.factor / 100
        if self.relative:
            return self.elasticity
        return self.derivative / small_unit(self.unit)[1] * self.quantity.factor

    @property
    def error_share(self) -> float:
        """[-] Stated error of the derivative over it; NaN where it was not asked for."""
        if self.error is None:
            return np.nan
        return self.error / abs(self.derivative)

    @property
    def change(self) -> str:
        """Change by a rise of the number by 1 %, or by one unit."""
        if self.relative:
            unit = self.quantity.unit if self.quantity.level else "%"
            return f"{self.rise:+.3g} {unit} per %"
        rise = f"{self.rise:+.3g} {self.quantity.unit}"
        return f"{rise.rstrip()} per {small_unit(self.unit)[0] or 'unit'}"


@dataclasses.dataclass(frozen=True)
class QuantityInfluences(Record):
    """A quantity with the influences of all numbers on it.

    Attributes:
        name: of the quantity.
        unit: SI unit.
        value: [SI]
        numbers: their influences, the largest first.
    """

    name: str = word()
    unit: str = word()
    value: float = reading(BESIDE)
    numbers: tuple[Influence, ...] = part(Influence)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Result):
    """Derivatives of quantities with respect to every number of a machine.

    Attributes:
        quantities: names (quantities,).
        quantity_units: SI units of them.
        value: [SI] (quantities,)
        numbers: names (numbers,) of the numbers, see `Variable`.
        parts: the same in words.
        units: SI units of the numbers.
        present: [SI] (numbers,) the numbers as the machine stands.
        derivative: [SI] (quantities, numbers)
        ok: whether all of it can be relied on.
        derivative_error: [SI] (quantities, numbers) stated errors of the derivatives; `None` unless they
            were asked for.
    """

    quantities: tuple[str, ...]
    quantity_units: tuple[str, ...]
    value: Float[np.ndarray, " quantities"]
    numbers: tuple[str, ...]
    parts: tuple[str, ...]
    units: tuple[str, ...]
    present: Float[np.ndarray, " numbers"] = reading(
        "", "number", doc="value in the SI unit beside it", table_only=True
    )
    derivative: Float[np.ndarray, "quantities numbers"] = held()
    ok: bool = held()
    derivative_error: Float[np.ndarray, "quantities numbers"] | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("number",)

    @property
    def elasticity(self) -> Float[np.ndarray, "quantities numbers"]:
        """[-] Relative change of a quantity over that of a number.

        NaN where there is none: the number or the quantity is zero, or the number is an angle or a
        temperature, whose zero means nothing.
        """
        levels = []
        for name, unit in zip(self.numbers, self.units, strict=True):
            levels.append(unit == "rad" or is_temperature(name, unit))
        none = (self.present == 0) | np.array(levels) | (self.value == 0)[:, None]
        value = np.where(none, np.nan, self.value[:, None])
        return self.derivative * self.present / value

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each number."""
        pairs = list(zip(self.quantities, self.quantity_units, strict=True))
        for place, (name, unit) in enumerate(pairs):
            yield Data(name, unit, self.value[place])
        yield Data("number", "", np.array(self.numbers), ("number",))
        yield Data("part", "", np.array(self.parts), ("number",))
        yield from self.data_of("present")
        yield Data("unit", "", np.array([unit or "1" for unit in self.units]), ("number",))
        elasticity = self.elasticity
        for place, (name, unit) in enumerate(pairs):
            yield Data(f"elasticity.{name}", "", elasticity[place], ("number",))
            per = f"{unit or '1'} per SI unit of the number"
            yield Data(f"derivative.{name}", per, self.derivative[place], ("number",))
            if self.derivative_error is not None:
                yield Data(f"error.{name}", per, self.derivative_error[place], ("number",))

    @computed_part(QuantityInfluences, key="quantities")
    def influences(self) -> list[QuantityInfluences]:
        """Every quantity with the numbers that it depends on, the largest influence first."""
        rows = []
        for name, unit, value in zip(self.quantities, self.quantity_units, self.value, strict=True):
            rows.append(QuantityInfluences(name, unit, float(value), tuple(self.ranking(name))))
        return rows

    def ranking(self, quantity: str) -> list[Influence]:
        """The numbers that a quantity depends on, the largest elasticity first.

        Those without an elasticity follow, by their derivative within a unit.

        Raises:
            BadInput: a quantity that was not asked for.
        """
        if quantity not in self.quantities:
            raise BadInput("quantity", quantity, f"one of {', '.join(self.quantities)}")
        place = self.quantities.index(quantity)
        value = self.value[place]
        elasticity = self.elasticity[place]
        errors = [None] * len(self.numbers)
        if self.derivative_error is not None:
            errors = self.derivative_error[place].tolist()
        look = shown(quantity, self.quantity_units[place], value)
        influences = records_of(
            Influence,
            number=self.numbers,
            part=self.parts,
            unit=self.units,
            present=self.present,
            elasticity=elasticity,
            derivative=self.derivative[place],
            quantity=[look] * len(self.numbers),
            error=errors,
        )

        def order(influence):
            if influence.relative:
                return False, "", -abs(influence.elasticity)
            return True, influence.unit, -abs(influence.derivative)

        return sorted(filter(_counts, influences), key=order)

    def _rows(self) -> Iterator[tuple[str, str]]:
        for name, unit, value in zip(self.quantities, self.quantity_units, self.value, strict=True):
            look = shown(name, unit, value)
            ranked = self.ranking(name)
            yield look.words, look.text(float(value))
            for influence in ranked[:10]:
                yield f"  {influence.part} {influence.value}", influence.change
            if len(ranked) > 10:
                yield f"  and {len(ranked) - 10} more", "in `.to_pandas()`"


def _counts(influence: Influence) -> bool:
    # written so that an elasticity of NaN, of which there is none, counts
    return influence.derivative != 0 and not abs(influence.elasticity) < _ROUNDING


def sensitivity(
    scene: Machine | HasMachine,
    quantities: Sequence[RequestedQuantity] | None = None,
    *,
    options: AnalysisOptions | None = None,
    verify: bool = False,
) -> Sensitivity:
    """Sensitivity of quantities to every number of a machine, by one reverse pass.

    A list in which all rows have the value that the file gives once counts as one number.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        quantities: see `available_quantities`; or functions of a `DesignResult`. Mechanical efficiency if
            absent.
        options: of the analysis of a design. Without a solver, load reversals are located also where only
            the forces on the rotor are wanted.
        verify: whether errors of the derivatives are stated: by how much they differ from those of a
            second solution, with more nodes on every panel.

    Raises:
        BadInput: an unknown quantity, or one that the machine does not have; or `verify` of a machine
            without a crank, or of a solver other than collocation.

    >>> from jaxcomp import load, sensitivity
    >>> slopes = sensitivity(load("mayekawa-wbhe"), ["swept_volume"])
    >>> for influence in slopes.ranking("swept_volume"):
    ...     print(influence.part, influence.value, influence.change)
    bore 130 mm +2 % per %
    crank radius 49.988 mm +1 % per %
    """
    listed_names("quantities", quantities)
    design = machine_of(scene)
    requested = tuple(quantities or ("mechanical_efficiency",))
    options = checked_options(options)
    compressor = design.compressor
    if (
        options.solver is None
        and compressor is not None
        and not isinstance(compressor.gas, Cylinder)
    ):
        options = dataclasses.replace(options, solver=default_collocation(compressor))
    problem = Problem(design, (), requested, options)
    if verify:
        _check_has_nodes(problem)
    solution, problem = _solved_in_size(problem)
    numbers = list(given_numbers(design))
    derivative = _by_number(numbers, solution.slope)
    derivative_error = None
    if verify:
        fine = _solved(_with_more_nodes(problem))
        derivative_error = np.abs(derivative - _by_number(numbers, fine.slope))
        if not fine.ok:
            derivative_error = np.full_like(derivative, np.nan)
    labels = []
    for number in numbers:
        suffix = ", all values" if number.factor else ""
        labels.append(variable_label(design, number.name) + suffix)
    return Sensitivity(
        quantities=tuple(map(name_of, requested)),
        quantity_units=tuple(map(unit_of, requested)),
        value=np.asarray(solution.value),
        numbers=tuple(number.name for number in numbers),
        parts=tuple(labels),
        units=tuple(number.unit for number in numbers),
        present=np.array([number.value for number in numbers]),
        derivative=derivative,
        ok=bool(solution.ok),
        derivative_error=derivative_error,
    )


def _by_number(
    numbers: Sequence[GivenNumber], slope: Machine
) -> Float[np.ndarray, "quantities numbers"]:
    """Derivatives by the numbers of a machine, from those in the place of every leaf."""
    slope = jax.device_get(slope)
    columns = []
    for number in numbers:
        weight = number.weight
        columns.append(np.tensordot(number.at(slope), weight, weight.ndim))
    return np.stack(columns, -1)


def _check_has_nodes(problem: Problem) -> None:
    """Refuse, before anything is solved, what no second solution with more nodes can tell.

    Raises:
        BadInput: a machine without a crank, or a solver other than collocation.
    """
    if problem.design.compressor is None:
        bound = "absent for a machine without a crank, whose slopes have no nodes"
        raise BadInput("verify", True, bound)
    solver = solver_of(problem)
    if not isinstance(solver, Collocation):
        raise BadInput("verify", f"given with {solver.name}", "given with collocation")


def _with_more_nodes(problem: Problem) -> Problem:
    """A problem that is solved with more nodes on every panel."""
    solver = solver_of(problem)
    cycle = dataclasses.replace(solver.cycle, nodes=solver.cycle.panel_nodes + _MORE_NODES)
    finer = dataclasses.replace(solver, nodes=solver.nodes + _MORE_NODES, cycle=cycle)
    return with_solver(problem, finer)


class _Solution(NamedTuple):
    """Values of a machine with their derivatives."""

    value: Float[Array, " quantities"]  # [SI]
    ok: Bool[Array, ""]  # whether all of it holds
    slope: Machine  # derivatives of the values, in the place of every number
    events: Int[Array, ""]  # see `DesignResult.events_without_room`


def _solved_in_size(problem: Problem) -> tuple[_Solution, Problem]:
    """A machine in the size of the cycle's program that has room for it, and the problem in that size."""
    climb = climb_of(problem, 1, by_march=False)
    reached = None
    for size, row in climb:
        problem = in_size(problem, size)
        solution = _solved(problem)
        climb.note(row, solution.events)
        reached = solution, problem
    assert reached is not None
    return reached


@kept_jit
def _solved(problem: Problem) -> _Solution:
    moving, fixed = eqx.partition(problem.design, eqx.is_inexact_array)

    def values(moving):
        result = DesignResult(eqx.combine(moving, fixed), problem.options)
        out = values_of(problem.quantities, result)
        ok = result.ok & jnp.all(jnp.isfinite(out))
        return out, (out, ok, result.events_without_room)

    # Few quantities of very many numbers: one pass backwards for each quantity.
    slope, (value, ok, events) = jax.jacrev(values, has_aux=True)(moving)
    return _Solution(value, ok, slope, events)
