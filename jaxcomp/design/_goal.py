"""What an optimiser makes small, and what it must keep: checked, scaled, ready for a solver."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._fields import BadInput
from ._analysis import quantity
from ._problem import Asked, Problem, name_of, of_each, prepared

Interval = tuple[float | None, float | None]
Objective = Asked | Mapping[Asked, float]


class Limit(NamedTuple):
    """One side of a constraint.

    Attributes:
        name: of the quantity.
        place: of the quantity in the problem.
        side: +1 for an upper, -1 for a lower bound, 0 for a value to be met.
        bound: in the unit of the quantity.
    """

    name: str
    place: int
    side: int
    bound: float


class Goal(NamedTuple):
    """An objective and constraints on a problem; nothing here is traced.

    Attributes:
        problem: with all quantities that are needed.
        objective: place of the quantity that is made small or large; `None` with targets.
        sign: +1 to make it small, -1 to make it large.
        targets: (place, value) of quantities to be met in the sense of least squares.
        limits: the constraints, side by side.
    """

    problem: Problem
    objective: int | None
    sign: int
    targets: tuple[tuple[int, float], ...]
    limits: tuple[Limit, ...]

    @property
    def name(self) -> str:
        """Of the objective."""
        return "residuals" if self.objective is None else self.problem.names[self.objective]

    @property
    def unit(self) -> str:
        """SI unit of the objective."""
        return "" if self.objective is None else self.problem.units[self.objective]

    @property
    def equalities(self) -> Bool[np.ndarray, " limits"]:
        """(limits,) which are values to be met."""
        return np.array([limit.side == 0 for limit in self.limits], bool)


def goal_of(
    problem: Problem,
    objective: Objective | None,
    maximise: bool | None,
    constraints: Mapping[Asked, Interval] | None,
) -> Goal:
    """Check an objective and constraints.

    Raises:
        BadInput: a quantity that the scene does not have, one that could be better either way, or a
            bound that is no number or leaves nothing.
    """
    quantities = list(problem.quantities)

    def place(asked: Asked) -> int:
        if asked not in quantities:
            quantities.append(asked)
        return quantities.index(asked)

    targets, main, sign = (), None, 1
    if objective is None:
        objective = problem.quantities[0]
    if isinstance(objective, Mapping):
        if not objective:
            raise BadInput("objective", "empty", "a quantity, or at least one target")
        if maximise is not None:
            raise BadInput("maximise", str(maximise), "left out with targets, which are met")
        targets = tuple((place(q), _number(q, value)) for q, value in objective.items())
    else:
        main, sign = place(objective), _sign(objective, maximise)
    limits = []
    for asked, interval in (constraints or {}).items():
        limits += _sides(asked, place(asked), interval)
    kept = tuple(v._replace(low=v.bound.low, high=v.bound.high) for v in problem.variables)
    # Without the ranges, which are the optimiser's business: another range compiles nothing anew.
    made = Problem(problem.design, kept, tuple(quantities), problem.options)
    eqx.filter_eval_shape(made, jax.ShapeDtypeStruct((len(kept),), float))
    return Goal(prepared(made), main, sign, targets, tuple(limits))


@eqx.filter_jit
def _answers(problem: Problem, points):
    # diffrax's checkpoints run backwards only
    backwards = getattr(problem.options.solver, "name", "") == "shooting"
    # Each direction costs about one more solution, forwards by variable and backwards by quantity.
    backwards |= len(problem.variables) > 4 * len(problem.quantities)

    def one(point):
        def values(point):
            answer = problem(point)
            return answer.values, answer

        if backwards:
            slope, answer = jax.jacrev(values, has_aux=True)(point)
        else:
            # not `jacfwd`, where an iterative rule of a derivative gives `ok` an axis of directions
            _, forward, answer = jax.linearize(values, point, has_aux=True)
            slope = jax.vmap(forward, out_axes=1)(jnp.eye(point.size))
        return answer.values, answer.ok & jnp.all(jnp.isfinite(slope)), slope

    return of_each(one, problem, points)


class Solved(NamedTuple):
    """Designs that were solved.

    Attributes:
        values: (n, quantities) in SI units.
        ok: (n,) whether values and slopes can be relied on.
        slope: (n, quantities, variables) derivatives of the values.
    """

    values: Float[Array, "n quantities"]
    ok: Bool[Array, " n"]
    slope: Float[Array, "n quantities variables"]


def solved(problem: Problem, points: Float[Array, "n variables"], batch: int) -> Solved:
    """Solve designs with their derivatives, in batches of one size and so by one program."""
    rows, parts = np.asarray(points), []
    for first in range(0, len(rows), batch):
        some = rows[first : first + batch]
        filled = np.concatenate([some, np.repeat(some[-1:], batch - len(some), 0)])
        parts.append([a[: len(some)] for a in _answers(problem, jnp.asarray(filled))])
    return Solved(*(jnp.concatenate(column) for column in zip(*parts, strict=True)))


def _number(asked: Asked, value) -> float:
    if not math.isfinite(value):
        raise BadInput(name_of(asked), value, "given a finite value to meet")
    return float(value)


def _sign(asked: Asked, maximise: bool | None) -> int:
    if maximise is None:
        better = quantity(asked).better if isinstance(asked, str) else "less"
        if not better:
            raise BadInput(
                "maximise", "absent", f"given: {asked} is not better in either direction"
            )
        maximise = better == "more"
    return -1 if maximise else 1


def _sides(asked: Asked, place: int, interval: Interval) -> list[Limit]:
    name = name_of(asked)
    low, high = interval
    ends = [(-1, low), (1, high)]
    for _, end in ends:
        if end is not None and not math.isfinite(end):
            raise BadInput(name, end, "given finite bounds, or None for no bound")
    if low is None and high is None:
        raise BadInput(name, "without bounds", "given a lower or an upper bound")
    if low is not None and high is not None and low >= high:
        if low > high:
            raise BadInput(name, low, f"given a lower bound below the upper, here {high:g}")
        return [Limit(name, place, 0, float(low))]
    return [Limit(name, place, side, float(end)) for side, end in ends if end is not None]
