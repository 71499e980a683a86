r"""A design problem: which numbers change, and what is asked of the result."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.arguments import listed_names
from .._core.declared import Measured, with_unit
from .._core.display import shown
from .._core.errors import BadInput, MissingPart
from .._core.exported import kept_optimised_jit
from .._core.results import Data
from .._core.roots import only_of_solved
from .._core.status import UNNAMED, Status
from ..crank._collocation import default_collocation
from ..cylinder import CycleOptions, Cylinder
from ..cylinder._climb import Climb
from ..cylinder._ends import options_of
from ..cylinder._waves import is_piped
from ..machine import HasMachine, Machine, assembled, machine_of
from ._analysis import DesignResult, quantity_named
from ._analysis_options import AnalysisOptions, checked_options
from ._rotor_response import by_crank, known_response
from ._variables import Variable, by_name, changed, current_values
from ._variables import variable as find_variable

RequestedQuantity = str | Callable[[DesignResult], Float[Array, ""]]


def name_of(quantity: RequestedQuantity) -> str:
    """Name of a quantity; a function goes by its own name."""
    if isinstance(quantity, str):
        return quantity
    return quantity.__name__


def unit_of(quantity: RequestedQuantity) -> str:
    """SI unit of a quantity; empty for a function."""
    if not isinstance(quantity, str):
        return ""
    return quantity_named(quantity).unit


def measured_by_name(
    names: Iterable[str], units: Iterable[str], values: Iterable[Any]
) -> dict[str, Measured]:
    """[SI] Numbers by name, each with its unit."""
    return dict(zip(names, map(Measured, values, units), strict=True))


def may_need(quantity: RequestedQuantity, part: str) -> bool:
    """Whether a quantity needs a part of the result; of a function anything must be assumed."""
    return not isinstance(quantity, str) or part in quantity_named(quantity).needs


def value_of(quantity: RequestedQuantity, result: DesignResult) -> Float[Array, ""]:
    """[SI] A quantity of a design.

    Raises:
        BadInput: one that needs a part which the design does not have.
    """
    if not isinstance(quantity, str):
        return quantity(result)
    registered = quantity_named(quantity)
    if missing := registered.missing(result.design):
        raise MissingPart(registered.name, missing)
    return registered.value(result)


def values_of(
    quantities: Sequence[RequestedQuantity], result: DesignResult
) -> Float[Array, " quantities"]:
    """[SI] Quantities of a design, in their order.

    Raises:
        BadInput: as `value_of`.
    """
    values = []
    for quantity in quantities:
        values.append(jnp.asarray(value_of(quantity, result), float))
    return jnp.stack(values)


class Answer(NamedTuple):
    """Values of one design.

    Attributes:
        values: [SI] (quantities,) in the order of the problem.
        ok: whether they can be relied on; if not they are finite where the solvers are, and mean
            nothing.
        events_without_room: events seen in a cycle that may be found in a larger size of its program;
            -1 where none is needed.
        status: code of the `Status` that tells how it ended, or `UNNAMED`.
    """

    values: Float[Array, " quantities"]
    ok: Bool[Array, ""]
    events_without_room: Int[Array, ""]
    status: Int[Array, ""]


class Problem(eqx.Module):
    """Quantities of a design as one pure function of its variables.

    `problem(values)` is differentiable and may be compiled and mapped; it computes what its
    quantities need and nothing else. Optimiser, sweep, tolerances and reports all stand on it.

    Attributes:
        design: as it stands.
        variables: the numbers that change; static.
        quantities: names of `quantity_named`, or functions of a `DesignResult`; static.
        options: of the analysis of a design.
    """

    design: Machine
    variables: tuple[Variable, ...] = eqx.field(static=True)
    quantities: tuple[RequestedQuantity, ...] = eqx.field(static=True)
    options: AnalysisOptions

    def __repr__(self) -> str:
        rows = ["Problem"]
        for variable in self.variables:
            if math.isinf(variable.high - variable.low):
                rows.append(f"  variable  {variable.name}, any value that it may have")
                continue
            look = shown(variable.name, variable.unit, [variable.low, variable.high])
            ends = f"{look.text(variable.low)} to {look.text(variable.high)}"
            rows.append(f"  variable  {variable.name}, {ends}")
        for name, unit in zip(self.names, self.units, strict=True):
            rows.append(f"  quantity  {with_unit(name, unit)}")
        return "\n".join(rows)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities; a function goes by its own name."""
        return tuple(map(name_of, self.quantities))

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the quantities; empty for functions."""
        return tuple(map(unit_of, self.quantities))

    @property
    def variable_names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(variable.name for variable in self.variables)

    @property
    def variable_units(self) -> tuple[str, ...]:
        """SI units of the variables."""
        return tuple(variable.unit for variable in self.variables)

    @property
    def unit_of(self) -> dict[str, str]:
        """SI units by name of the quantity."""
        return dict(zip(self.names, self.units, strict=True))

    @property
    def current(self) -> Float[Array, " variables"]:
        """[SI] The variables as the design stands."""
        return current_values(self.design, self.variables)

    def designed(self, values: Float[Array, " variables"]) -> Machine:
        """The design with these values [SI] of the variables, set in their order."""
        return changed(self.design, self.variables, values)

    def columns(self, points, values, dims=(), before: str = "") -> Iterator[Data]:
        """Variables [SI] (*designs, variables) and quantities (*designs, quantities) of a result."""
        names = *self.variable_names, *self.names
        units = *self.variable_units, *self.units
        for name, unit, column in zip(names, units, (*points.T, *values.T), strict=True):
            yield Data(f"{before}{name}", unit, column, dims)

    def __call__(self, values: Float[Array, " variables"]) -> Answer:
        """The quantities of one design.

        Args:
            values: [SI] (variables,)

        Raises:
            BadInput: a quantity that the scene does not have.
        """
        result = DesignResult(self.designed(values), self.options)
        out = [value_of(quantity, result) for quantity in self.quantities]
        inside = jnp.asarray(True)
        for number, variable in enumerate(self.variables):
            inside &= variable.bound.holds(values[number])
        values = jnp.stack([jnp.asarray(value, float) for value in out])
        ok = result.ok & inside & jnp.all(jnp.isfinite(values))
        status = Status.where(inside, result.status, Status.bad_input)
        # Solvers that converged, with a quantity that is not finite: no status has a name for it.
        unnamed = ~ok & (status == Status.converged)
        code = jnp.where(unnamed, UNNAMED, status._value)
        events = jnp.where(inside, result.events_without_room, -1)
        # out of bounds there is the slope of the nearest design, by which a search finds back
        values = only_of_solved(values, ok | ~inside)
        return Answer(values=values, ok=ok, events_without_room=events, status=code)


def problem(
    scene: Machine | HasMachine,
    variables: Sequence[str] | dict[str, tuple[float | None, float | None]] | None = None,
    quantities: Sequence[RequestedQuantity] | None = None,
    options: AnalysisOptions | None = None,
) -> Problem:
    """A problem on a scene.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        variables: names or patterns, or ranges in SI units by these; see `Variable` and `matching`.
        quantities: see `available_quantities`; or functions of a `DesignResult`.
        options: of the analysis of a design.

    Raises:
        BadInput: an unknown variable or quantity, or an impossible range.

    >>> from jaxcomp import load, problem
    >>> def swept_volume(result):
    ...     return result.design.compressor.mechanism.swept_volume
    >>> by_bore = problem(load("mayekawa-wbhe"), ["mechanism.bore"], [swept_volume])
    >>> print(f"{by_bore(by_bore.current).values[0]:.6f}")  # [m^3]
    0.001327
    >>> print(f"{jax.grad(lambda x: by_bore(x).values[0])(by_bore.current)[0]:.5f}")  # [m^2]
    0.02042
    """
    design = machine_of(scene)
    if variables is None:
        bound = 'names or ranges in SI units, such as {"bore_at_displacement": (0.12, 0.14)}'
        raise BadInput("variables", "absent", bound)
    listed_names("variables", variables)
    listed_names("quantities", quantities)
    ranges = dict.fromkeys(variables, (None, None))
    if isinstance(variables, dict):
        ranges = variables
    if not quantities:
        raise BadInput(
            "quantities", "none", 'at least one, in a list such as ["mechanical_efficiency"]'
        )
    for name, ends in ranges.items():
        if isinstance(ends, str) or np.shape(ends) != (2,):
            raise BadInput(name, f"{ends}", "a pair of ends in SI units, (low, high)")
    free_variables = []
    for name, ends in by_name(design, ranges).items():
        free_variables.append(find_variable(design, name, *ends))
    complete = Problem(design, tuple(free_variables), tuple(quantities), checked_options(options))
    check_traced(complete)
    return complete


@eqx.filter_jit
def _answer(problem: Problem, point: Float[Array, " variables"]):
    return problem(point)


def check_traced(problem: Problem) -> None:
    """Refuse what the machine of a problem does not have, before anything is compiled.

    To trace a machine takes half a second; problems of one structure are traced once.
    """
    rangeless = dataclasses.replace(problem, variables=without_ranges(problem.variables))
    point = jax.ShapeDtypeStruct((len(problem.variables),), float)
    eqx.filter_eval_shape(_answer, rangeless, point)


def without_ranges(variables: Iterable[Variable]) -> tuple[Variable, ...]:
    """The variables with the bounds of their numbers as their ranges."""
    rangeless = []
    for variable in variables:
        bound = variable.bound
        rangeless.append(variable._replace(low=bound.low, high=bound.high))
    return tuple(rangeless)


def problem_of(
    scene: Machine | HasMachine | Problem,
    label: str,
    names: Sequence[str],
    quantities: Sequence[RequestedQuantity] | None,
    options: AnalysisOptions | None,
) -> Problem:
    """The problem that a study is given as its scene, or one on that scene.

    Raises:
        BadInput: as `problem`; or, for the argument `label`, other variables than the given problem
            has; or quantities or options beside those of its own.
    """
    listed_names("quantities", quantities)
    if not isinstance(scene, Problem):
        return problem(scene, names, quantities or ("mechanical_efficiency",), options)
    if quantities is not None or options is not None:
        raise BadInput("quantities", "given twice", "left to the `Problem`, as are the options")
    expected = scene.variable_names
    if tuple(names) != expected:
        raise BadInput(label, ", ".join(names), f"{', '.join(expected)}, in this order")
    return scene


def checked_problem(argument: Any) -> Problem:
    """A problem, which an optimiser takes and a scene is not.

    Raises:
        BadInput: something else.
    """
    if isinstance(argument, Problem):
        return argument
    example = 'problem(scene, {"mechanism.bore": (0.12, 0.14)}, ["mechanical_efficiency"])'
    raise BadInput("problem", f"a {type(argument).__name__}", f"a `Problem`, such as {example}")


def solves_gas(problem: Problem) -> bool:
    """Whether the gas is solved with its valves."""
    return isinstance(getattr(problem.design.compressor, "gas", None), Cylinder)


def of_each(function: Callable, problem: Problem, points):
    """A function of every point: all at once, or one after another where the gas is solved.

    Such designs differ in their number of steps, and the program of a batch is several times as large.
    """
    if solves_gas(problem):
        return jax.lax.map(function, points)
    return jax.vmap(function)(points)


class Solved(NamedTuple):
    """Designs that were solved with their derivatives.

    Attributes:
        values: [SI] (n, quantities)
        ok: (n,) whether values and slopes can be relied on.
        slope: [SI] (n, quantities, variables)
    """

    values: Float[Array, "n quantities"]
    ok: Bool[Array, " n"]
    slope: Float[Array, "n quantities variables"]


def climb_of(problem: Problem, count: int, by_march: bool) -> Climb:
    """Designs of a problem at the foot of the sizes of the cycle's program.

    Args:
        problem: with or without valves; there is one size without.
        count: of the designs.
        by_march: whether the march, which has no derivatives, stands behind the largest size.
    """
    if not solves_gas(problem):
        return Climb((None,), count)
    compressor = problem.design.compressor
    assert compressor is not None
    by_march = by_march and not is_piped(compressor.gas)
    assert isinstance(compressor.gas, Cylinder)
    options = options_of(compressor.gas, compressor.crankshaft.count, solver_of(problem).cycle)
    return Climb(options.ladder(by_march), count)


def in_size(problem: Problem, size: CycleOptions | None) -> Problem:
    """The problem with its cycle solved in a size that `climb_of` gave."""
    if size is None:
        return problem
    return with_solver(problem, dataclasses.replace(solver_of(problem), cycle=size))


def with_solver(problem: Problem, solver: Any) -> Problem:
    """The problem with another solver of the orbit."""
    return eqx.tree_at(lambda p: p.options.solver, problem, solver, is_leaf=lambda x: x is None)


def solver_of(problem: Problem) -> Any:
    """The solver of the orbit that a problem with valves takes."""
    compressor = assembled(problem.design).compressor
    assert compressor is not None
    return problem.options.solver or default_collocation(compressor)


def solved(problem: Problem, points: Float[Array, "n variables"], batch: int = 8) -> Solved:
    """Solve designs with their derivatives, in batches of one size and so by one program.

    Those that lack room for the cycle are solved again together in the next size that has it.
    """
    rows = np.asarray(points)
    climb = climb_of(problem, len(rows), by_march=False)
    columns = []
    # All designs in the first size, and in each larger one those that had no room before.
    for size, subset in climb:
        *answers, events = _in_batches(in_size(problem, size), rows[subset], batch)
        climb.note(subset, events)
        if not columns:
            columns = answers
            continue
        for number, answer in enumerate(answers):
            columns[number] = columns[number].at[subset].set(answer)
    return Solved(*columns)


def _in_batches(problem: Problem, rows, batch: int) -> list[Array]:
    """Values, whether they hold, slopes and events without room of designs, in one size."""
    parts = []
    # what `of_each` takes in turns is not filled up
    if solves_gas(problem):
        batch = 1
    for first in range(0, len(rows), batch):
        group = rows[first : first + batch]
        filled = np.concatenate([group, np.repeat(group[-1:], batch - len(group), 0)])
        answers = _answers(problem, jnp.asarray(filled))
        parts.append([column[: len(group)] for column in answers])
    return [jnp.concatenate(column) for column in zip(*parts, strict=True)]


@kept_optimised_jit
def _answers(problem: Problem, points):
    # diffrax's checkpoints run backwards only
    backwards = getattr(problem.options.solver, "name", "") == "shooting"
    # Each direction costs about one more solution, forwards by variable and backwards by quantity.
    backwards |= len(problem.variables) > 4 * len(problem.quantities)

    def with_slope(point):
        def values(point):
            answer = problem(point)
            return answer.values, answer

        if backwards:
            slope, answer = jax.jacrev(values, has_aux=True)(point)
        else:
            # not `jacfwd`, where an iterative rule of a derivative gives `ok` an axis of directions
            _, forward, answer = jax.linearize(values, point, has_aux=True)
            slope = jax.vmap(forward, out_axes=1)(jnp.eye(point.size))
        ok = answer.ok & jnp.all(jnp.isfinite(slope))
        # a line search that meets a design without a solution goes back, but not from what is no number
        slope = jnp.where(jnp.isfinite(slope), slope, 0.0)
        return answer.values, ok, slope, answer.events_without_room

    return of_each(with_slope, problem, points)


# Variables that change the loads of a rotor and not the rotor.
_LOADS = ("corrections.", "loads.unbalances.", "balancing.targets.")


def prepared(problem: Problem) -> Problem:
    """The problem with its rotor solved beforehand, where nothing but loads changes; else as it is.

    Many designs then cost a product of matrices each instead of a factorisation.

    A quantity that is a function, and that changes the design it is given, has to name the variables
    it changes in an attribute `changes`.

    Args:
        problem: of `jaxcomp.problem`.
    """
    shows_vibration = any(may_need(quantity, "vibration") for quantity in problem.quantities)
    if problem.options.known is not None:
        return problem
    if not shows_vibration or not {"rotor", "loads", "balancing"} <= set(problem.design.parts):
        return problem
    crank = by_crank(assembled(problem.design), problem.options)
    loads = _LOADS
    if not crank:
        loads = (*_LOADS, "loads.forces.")
    names = [*problem.variable_names]
    for quantity in problem.quantities:
        names += getattr(quantity, "changes", ())
    # A rotor that a variable changes has to be solved for every design.
    if not all(name.startswith(loads) for name in names):
        return problem
    unit_response = known_response(problem.design, problem.options)
    return eqx.tree_at(
        lambda p: p.options.known, problem, unit_response, is_leaf=lambda x: x is None
    )
