r"""`tolerance`: what the scatter of production does to a machine."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..._core.arguments import bounds_by_names, counted, listed_names
from ..._core.declared import computed, computed_part, computed_word
from ..._core.display import Shown, shown
from ..._core.errors import BadInput
from ..._core.evidence import Check, all_solved
from ..._core.results import Data, Result
from ...machine import HasMachine, Machine, machine_of
from .. import AnalysisOptions, prepared
from .._labels import variable_label
from .._problem import Problem, RequestedQuantity, name_of, problem_of, solves_gas
from .._variables import by_name
from . import _answer
from ._moments import (
    Curvature,
    Keep,
    Local,
    Moments,
    Sampled,
    local,
    moments,
    sampled,
    shares,
    solved_rows,
)
from ._reliability import Limit, Reliability, reliability
from ._scatter import Correlations, Sampling, Scatter, Within, scatter_of

if TYPE_CHECKING:
    from distributed import Client

# From here on a method is said to disagree with the samples: share of the samples' deviation.
_DISAGREES = 0.1
# Samples if their number is left open: ordinary machines, and those whose gas is solved with valves.
_MANY = 16384
_FEW = 512


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Tolerances(Result):
    """Scatter of the quantities of a machine.

    Attributes:
        problem: the quantities as functions of the scattered variables.
        scatter: of the variables, in the order of the problem.
        nominal: [SI] (variables,) nominal values.
        deviation: [SI] (variables,) standard deviations of the variables.
        value: [SI] (quantities,) of the nominal machine.
        local: value, slope and curvature at the mean machine.
        first_order, second_order: moments from these; the second `None` without curvature.
        shares: [-] (quantities, variables) of the variance, from the highest order known.
        swings: [SI] (2, variables, quantities) with one variable at its low or high limit, the
            others at their means; NaN where it cannot be solved.
        sampled: Monte Carlo.
        reliability: of each limit.
    """

    problem: Problem
    scatter: Scatter
    nominal: Float[np.ndarray, " variables"]
    deviation: Float[np.ndarray, " variables"]
    value: Float[np.ndarray, " quantities"]
    local: Local
    first_order: Moments
    second_order: Moments | None
    shares: Float[np.ndarray, "quantities variables"]
    swings: Float[np.ndarray, "2 variables quantities"]
    sampled: Sampled
    reliability: tuple[Reliability, ...]

    table_dims: ClassVar[tuple[str, ...]] = ("sample",)

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Whether all machines that were drawn have a result."""
        del tolerance
        return (all_solved("Machines of the sample", int(self.failed), int(self.samples)),)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has every machine that was drawn."""
        for place, (name, unit) in enumerate(zip(self.names, self.problem.units, strict=True)):
            yield Data(f"nominal.{name}", unit, self.value[place])
            yield Data(f"mean.{name}", unit, self.sampled.mean[place])
            yield Data(f"deviation.{name}", unit, self.sampled.deviation[place])
            for variable, share in self.ranking(name):
                yield Data(f"share_of_variance.{name}.{variable}", "", share)
        for risk in self.reliability:
            name = f"probability_{risk.limit.side}_limit.{risk.limit.quantity}"
            doc = f"of a value {risk.limit.side} {risk.limit.bound:g} in SI"
            yield Data(name, "", risk.sampled, doc=doc)
        yield Data("solved", "", self.sampled.ok, self.table_dims)
        drawn = self.scatter.at(self.nominal, self.sampled.normals)
        yield from self.problem.columns(drawn, self.sampled.values, self.table_dims)

    @computed("kg m")
    def corrections(self) -> dict[str, Any]:
        """[kg m] Balancing of the machine, by plane."""
        return dict(self.problem.design.corrections)

    @computed_part(_answer.ScatteredVariable, by_name=True, key="variables")
    def scattered_variables(self) -> dict[str, _answer.ScatteredVariable]:
        """Every variable and its tolerance, by name."""
        variables = {}
        for place, name in enumerate(self.variables):
            variables[name] = _answer.scattered_variable(self, place)
        return variables

    @computed_part(_answer.Correlation)
    def correlations(self) -> tuple[_answer.Correlation, ...]:
        """Correlations of the variables, as they were given."""
        return tuple(_answer.Correlation(pair, value) for pair, value in self.scatter.given)

    @computed("")
    def samples(self) -> int:
        """Number of machines drawn."""
        return len(self.sampled.ok)

    @computed("")
    def failed(self) -> int:
        """Number of machines without a solution."""
        return int(np.sum(~self.sampled.ok))

    @computed_part(_answer.ScatteredQuantity, by_name=True)
    def quantities(self) -> dict[str, _answer.ScatteredQuantity]:
        """Every quantity and its scatter, by name."""
        quantities = {}
        for place, name in enumerate(self.names):
            quantities[name] = _answer.scattered_quantity(self, place)
        return quantities

    @computed_part(_answer.BrokenLimit)
    def limits(self) -> tuple[_answer.BrokenLimit, ...]:
        """Every limit, and how probable it is to be broken."""
        return tuple(_answer.broken_limit(self, risk) for risk in self.reliability)

    def sentences(self, *permitted: _answer.Permitted) -> tuple[str, ...]:
        """The answer in a sentence for each limit, or for each quantity where there is none.

        Args:
            permitted: of the function of that name: each has a sentence as well.
        """
        return tuple(_answer.sentences(self, permitted))

    def label(self, variable: str) -> str:
        """A variable in words."""
        return variable_label(self.problem.design, variable)

    def shown(self, quantity: str) -> Shown:
        """Format in which a quantity is shown."""
        place = self.names.index(quantity)
        return shown(quantity, self.problem.units[place], self.value[place])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return self.problem.names

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables."""
        return self.problem.variable_names

    def ranking(self, quantity: str) -> list[tuple[str, float]]:
        """Variables and their shares of the variance [-], the largest first.

        Raises:
            BadInput: a quantity that was not asked for.
        """
        if quantity not in self.names:
            raise BadInput("quantity", quantity, f"one of {', '.join(self.names)}")
        row = self.shares[self.names.index(quantity)]
        return sorted(zip(self.variables, row.tolist(), strict=True), key=lambda p: -abs(p[1]))

    @computed_word()
    def remarks(self) -> tuple[str, ...]:
        """Where the methods disagree, and what could not be solved, in words."""
        out = []
        if self.failed:
            out.append(f"{self.failed} of {self.samples} samples could not be solved")
        if not self.local.ok:
            out.append("the derivatives cannot be relied on: a design near the mean is not solved")
        for place, name in enumerate(self.names):
            out += _disagreements(self, place, name)
        for risk in self.reliability:
            if not len(risk.points):
                out.append(
                    f"{risk.limit.quantity}: no machine within 12 deviations is "
                    f"{risk.limit.side} {risk.limit.bound:g}"
                )
            elif not risk.agrees:
                low, high = risk.sampled_interval
                out.append(
                    f"{risk.limit.quantity}: first-order probability {risk.first_order:.3g} of breaking "
                    f"the limit, {low:.3g} to {high:.3g} by the samples"
                )
        return tuple(out)


def tolerance(
    scene: Machine | HasMachine | Problem,
    tolerances: Mapping[str, Within] | None = None,
    quantities: Sequence[RequestedQuantity] | None = None,
    *,
    correlations: Correlations | None = None,
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    options: AnalysisOptions | None = None,
    samples: int | None = None,
    sampling: Sampling = "sobol",
    seed: int = 0,
    curvature: Curvature = "differences",
    client: "Client | None" = None,
    progress: bool = True,
    keep: Keep | None = None,
) -> Tolerances:
    """Scatter of a machine by production tolerances, by derivatives and by Monte Carlo.

    Args:
        scene: of `jaxcomp.load`, a `Machine`, or a `Problem`, whose variables are the scattered ones.
        tolerances: of each variable by name or pattern, see `within`, `Variable` and `matching`. Set
            in this order.
        quantities: see `available_quantities`; or functions of a `DesignResult`. Efficiency
            if absent.
        correlations: [-] of the deviations of two variables, by pairs of names.
        limits: [SI] (low, high) by quantity, `None` for an open end: the probability of breaking
            each is computed.
        options: of the analysis of a design.
        samples: machines of the Monte Carlo. If absent, 16384; 512 where the gas is solved with its
            valves, since each of these costs as much as fifty others.
        sampling: Sobol's points, scrambled; a Latin hypercube; or independent draws.
        seed: of the samples.
        curvature: how the second order comes about, see `local`; `None` for the first alone.
        client: of a Dask cluster whose workers solve the samples, see `sweep`; this process if absent.
        progress: show a bar on standard error, if that is a terminal.
        keep: called as work goes on with the machines (n, variables) drawn so far, their quantities
            (n, quantities), both in SI units, and whether each could be solved.

    Raises:
        ConnectionError: the scheduler of the cluster was lost.
        BadInput: an unknown variable or quantity, a tolerance that takes a variable out of its
            bounds, correlations that cannot be, or an option that makes no sense.
    """
    listed_names("quantities", quantities)
    if samples is not None:
        counted("samples", samples, high=2**24)
    limits = bounds_by_names("limits", limits)
    tolerances = {} if tolerances is None else tolerances
    scatter_of(tolerances)  # refuses what is no tolerance, before its name is looked up
    if not isinstance(scene, Problem):
        tolerances = by_name(machine_of(scene), tolerances)
        # Whatever has a limit is computed as well.
        names = [name_of(quantity) for quantity in quantities or ()]
        quantities = [*(quantities or ())]
        for name in limits:
            if name not in names:
                quantities.append(name)
    scatter = scatter_of(tolerances, correlations)
    problem = problem_of(scene, "tolerances", tuple(scatter.tolerances), quantities, options)
    checked_limits = _limits(limits, problem)
    nominal = np.asarray(problem.current)
    _check(problem, scatter, nominal)
    problem = prepared(problem)
    deviation = scatter.deviation(nominal)
    covariance = scatter.covariance(nominal)
    excess = jnp.array([band.excess for band in scatter.tolerances.values()])
    expansion = local(problem, scatter.mean(nominal), deviation, curvature)
    if samples is None:
        samples = _MANY
        if solves_gas(problem):
            samples = _FEW
    monte_carlo = sampled(
        problem, scatter, nominal, samples, sampling, seed, progress, client, keep
    )
    value, swings = _one_at_a_time(problem, scatter, nominal)
    second_order = None
    if expansion.curvature is not None:
        second_order = moments(expansion, covariance, excess)
    risks = []
    for limit in checked_limits:
        risk = reliability(
            problem, scatter, nominal, limit, monte_carlo, seed=seed, progress=progress
        )
        risks.append(risk)
    return Tolerances(
        problem=problem,
        scatter=scatter,
        nominal=nominal,
        deviation=np.asarray(deviation),
        value=value,
        local=expansion,
        first_order=moments(expansion._replace(curvature=None), covariance, excess),
        second_order=second_order,
        shares=shares(expansion, covariance, excess),
        swings=swings,
        sampled=monte_carlo,
        reliability=tuple(risks),
    )


def _check(problem: Problem, scatter: Scatter, nominal) -> None:
    """Refuse tolerances in per cent of a value of zero, and tolerances that lead out of bounds."""
    for (name, band), value in zip(scatter.tolerances.items(), nominal, strict=True):
        if band.relative and value == 0:
            raise BadInput(name, 0.0, "different from zero for a relative tolerance")
    for end in np.asarray(scatter.limits(nominal)):
        for variable, value in zip(problem.variables, end, strict=True):
            if not bool(variable.bound.holds(value)):
                bound = f"{variable.bound}, at every limit of tolerance"
                raise BadInput(variable.name, float(value), bound)


def _limits(limits, problem: Problem) -> list[Limit]:
    out = []
    for name, (low, high) in limits.items():
        if name not in problem.names:
            raise BadInput("limits", name, f"one of {', '.join(problem.names)}")
        if low is None and high is None:
            raise BadInput(f"limits.{name}", "without bounds", "given a lower or an upper bound")
        for end, above in ((low, False), (high, True)):
            if end is None:
                continue
            if not np.isfinite(end):
                raise BadInput(f"limits.{name}", end, "finite, or None for no bound")
            out.append(Limit(name, float(end), above))
    return out


def _one_at_a_time(problem: Problem, scatter: Scatter, nominal):
    """Nominal quantities, and with each variable in turn at both limits."""
    n = len(nominal)
    ends = np.asarray(scatter.limits(nominal))
    points = np.tile(np.asarray(scatter.mean(nominal)), (2, n, 1))
    # Row i of either half has variable i at a limit and all others at their means.
    points[:, np.arange(n), np.arange(n)] = ends
    values, _ = solved_rows(problem, np.concatenate([nominal[None], points.reshape(-1, n)]))
    return values[0], values[1:].reshape(2, n, -1)


def _disagreements(study: Tolerances, place: int, name: str) -> list[str]:
    truth = study.sampled
    allowed = _DISAGREES * truth.deviation[place]
    look = shown(name, study.problem.units[place], truth.mean[place])
    orders = {"first": study.first_order, "second": study.second_order}
    out = []
    for word, order in orders.items():
        if order is None:
            continue
        for field in order._fields:
            estimate = getattr(order, field)[place]
            reference = getattr(truth, field)[place]
            error = getattr(truth, f"{field}_error")[place]
            if not abs(estimate - reference) <= max(allowed, 4 * error):
                text_of = look.text if field == "mean" else look.difference
                texts = f"{text_of(estimate)} against {text_of(reference)} by the samples"
                out.append(f"{look.words}: {word}-order {field} {texts}")
    return out
