r"""Constants fitted to readings, and what they are worth.

Covariance, chi-square and prediction intervals follow Seber and Wild, Nonlinear Regression (1989),
sections 2.1, 5.1 and 5.2.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats
from scipy.stats import qmc

from ..._core.errors import BadInput
from ..._core.words import one_of
from ._bounded_least_squares import LeastSquares, Model, Parameter, check_problem
from ._directions import Direction, directions_of

# Distance from a bound, over the range, at which a parameter counts as held by it.
_AT_BOUND = 1e-3
# Change of chi-square below which two minima are both told, and distance in standard errors above which
# they are two.
_NEAR = 4.0
_APART = 0.1
# Further starts where no step of any start had a value, and their spread over the ranges.
_OTHERS = 3
_NEARBY = 0.3


class Minimum(NamedTuple):
    """Where a start ended: parameters and chi-square with the priors."""

    estimate: NDArray
    chi_square: float


class Prediction(NamedTuple):
    """Prediction of readings by a fitted model.

    Attributes:
        value: (n,)
        model_sd: (n,) by the uncertainty of the parameters.
        sd: (n,) with that of a reading.
        half_width: (n,) of the 95 % interval of a reading as the standard deviations are given.
        inflated: (n,) the same with the scatter of the fit: t max(1, s) times the whole deviation.
    """

    value: NDArray
    model_sd: NDArray
    sd: NDArray
    half_width: NDArray
    inflated: NDArray


@dataclasses.dataclass(frozen=True)
class Fit:
    """Parameters fitted to readings, and what they are worth.

    Attributes:
        parameters: what was fitted.
        estimate: (p,) the values.
        covariance: (p, p) in the parameters.
        measured, sd, weight: (m,) readings, their standard deviations and weights.
        value, slope: (m,), (m, p) of the model at the estimate, over the parameters.
        robust: (m,) weights that the loss gave to readings.
        chi_square: sum of squares, with that of the priors.
        freedom: readings and priors less parameters.
        directions: combinations of parameters, the best known first.
        at_bound: (p,) whether a bound holds it.
        minima: other minima with a chi-square within 4.
        steps: evaluations of the model by the best start.
        converged: whether the solver met its tolerance.
        failed_starts: starts at which the model has no value.
        interrupted: whether an interrupt ended it, with the best values so far.
        lost_steps: evaluations of the best start at which the model had no value.
        stuck: whether the best start never moved, since no step from it had a value.
    """

    parameters: tuple[Parameter, ...]
    estimate: NDArray
    covariance: NDArray
    measured: NDArray
    sd: NDArray
    weight: NDArray
    value: NDArray
    slope: NDArray
    robust: NDArray
    chi_square: float
    freedom: int
    directions: tuple[Direction, ...]
    at_bound: NDArray
    minima: tuple[Minimum, ...]
    steps: int
    converged: bool
    failed_starts: int
    loss: str = "linear"
    model: Model | None = dataclasses.field(default=None, repr=False, compare=False)
    interrupted: bool = False
    lost_steps: int = 0
    stuck: bool = False

    @property
    def standard_error(self) -> NDArray:
        """(p,) in the units of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> NDArray:
        """(p, p)"""
        error = self.standard_error
        return self.covariance / np.outer(error, error)

    @property
    def prior_share(self) -> NDArray:
        """(p,) standard error over that of the prior; not a number without one."""
        shares = np.full(len(self.parameters), np.nan)
        error = self.standard_error
        for n, parameter in enumerate(self.parameters):
            if parameter.prior_width is not None:
                # over dp/dt, since the width of the prior is one of t
                shares[n] = error[n] / parameter.slope(self.estimate[n]) / parameter.prior_width
        return shares

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-square if the model and the deviations hold."""
        if self.freedom <= 0:
            return np.nan
        return float(stats.chi2.sf(self.chi_square, self.freedom))

    @property
    def scatter(self) -> float:
        """s, root of chi-square over its degrees of freedom; 1 without any."""
        if self.freedom <= 0:
            return 1.0
        return float(np.sqrt(self.chi_square / self.freedom))

    @property
    def residual(self) -> NDArray:
        """(m,) computed less measured, in standard deviations."""
        return (self.value - self.measured) / self.sd

    def interval(self, level: float = 0.95, inflated: bool = False) -> tuple[NDArray, NDArray]:
        """Ends of the linear intervals of the parameters, with the scatter of the fit if `inflated`."""
        half = self._quantile(level, inflated) * self.standard_error
        return self.estimate - half, self.estimate + half

    def predict(self, value: ArrayLike, slope: ArrayLike, sd: ArrayLike = 0.0) -> Prediction:
        """Prediction of readings where the model has these values and slopes.

        Args:
            value: (n,) of the model at the estimate.
            slope: (n, p) over the parameters.
            sd: (n,) of a reading.
        """
        value = np.asarray(value, float)
        slope = np.asarray(slope, float)
        model = np.sqrt(np.einsum("np,pq,nq->n", slope, self.covariance, slope))
        total = np.hypot(model, sd)
        return Prediction(
            value=value,
            model_sd=model,
            sd=total,
            half_width=self._quantile(0.95, inflated=False) * total,
            inflated=self._quantile(0.95, inflated=True) * total,
        )

    def profile(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Ends of the interval of a parameter over which chi-square rises by its quantile.

        All others are fitted again at every value. An end that lies outside the bounds is not a number.

        Args:
            name: of the parameter.
            level: of the interval.

        Raises:
            BadInput: no such parameter, or a fit that was loaded and has no model.
        """
        names = [parameter.name for parameter in self.parameters]
        if name not in names:
            raise BadInput("name", name, one_of(name, names))
        if self.model is None:
            raise BadInput("model", "absent", "that of the fit, for a profile")
        at = names.index(name)
        rise = stats.chi2.ppf(level, 1)
        parameter = self.parameters[at]
        problem = LeastSquares(self.model, self.parameters, self.measured, self.sd, self.weight)
        centre = parameter.scaled(self.estimate[at])
        error = self.standard_error[at]
        error = float(error / parameter.slope(self.estimate[at]))
        estimate = problem.scaled(self.estimate)

        def excess(t: float) -> float:
            """Root of the rise of chi-square over the wanted one; nearly linear in t."""
            begin = estimate.copy()
            begin[at] = t
            free = np.arange(estimate.size) != at
            answer = problem.solve(begin, self.loss, free)
            grown = np.inf
            if answer is not None:
                grown = max(2 * answer.cost - self._cost(problem), 0.0)
            return float(np.sqrt(grown / rise)) - 1

        ends = []
        for sign, bound in (
            (-1, parameter.scaled(parameter.low)),
            (1, parameter.scaled(parameter.high)),
        ):
            end = centre + sign * np.sqrt(rise) * error
            end = _within_bound(end, bound, sign)
            over = -1.0
            # Outwards until the end is bracketed, or is a bound.
            for _ in range(6):
                over = excess(end)
                if over >= 0 or end == bound:
                    break
                # The root of the rise is nearly linear: 1/(1 + over) of the way is the end, and a
                # tenth more brackets it.
                end = centre + (end - centre) * min(2.0, 1.1 / max(1 + over, 0.1))
                end = _within_bound(end, bound, sign)
            if not np.isfinite(over) or over < 0:
                ends.append(np.nan)
                continue
            root = optimize.brentq(excess, centre, end, xtol=1e-7 * error, rtol=1e-13)
            if parameter.log:
                root = np.exp(root)
            ends.append(float(root))
        return ends[0], ends[1]

    def _cost(self, problem: LeastSquares) -> float:
        residual, _ = problem.at(problem.scaled(self.estimate))
        return 2 * problem.cost(residual, self.loss)

    def _quantile(self, level: float, inflated: bool) -> float:
        tail = (1 + level) / 2
        if not inflated or self.freedom <= 0:
            return float(stats.norm.ppf(tail))
        # A small scatter may be luck: it never makes an interval narrower.
        return float(stats.t.ppf(tail, self.freedom)) * max(1.0, self.scatter)


def fit(
    model: Model,
    parameters: Sequence[Parameter],
    measured: ArrayLike,
    sd: ArrayLike,
    *,
    weight: ArrayLike = 1.0,
    loss: str = "linear",
    starts: int = 5,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    keep: Callable[[NDArray, float], None] | None = None,
) -> Fit:
    """Fit parameters to readings.

    Args:
        model: values (m,) and slopes (m, p) over the parameters, from the parameters (p,). A value that
            is not a number makes the solver shorten its step.
        parameters: (p,) unknowns.
        measured: (m,) readings.
        sd: (m,) their standard deviations.
        weight: (m,) of the readings; zero leaves one out.
        loss: of the readings: "linear" for squares, "soft_l1" or "huber" against outliers.
        starts: how many; the first is that of the parameters, the others a Latin hypercube in the
            bounds.
        seed: of the hypercube.
        progress: told before every start.
        keep: given the best values and their chi-square whenever there are better ones.

    An interrupt ends the fit with the best values so far, where there are any.

    Raises:
        BadInput: an unknown loss, bounds that hold no start, a deviation that is not positive, lists of
            different lengths, fewer readings and priors than parameters, or a model without a value at
            every start.
    """
    parameters = tuple(parameters)
    measured = np.asarray(measured, float)
    sd = np.broadcast_to(np.asarray(sd, float), measured.shape)
    weight = np.broadcast_to(np.asarray(weight, float), measured.shape)
    check_problem(parameters, measured, sd, weight, loss)
    problem = LeastSquares(model, parameters, measured, sd, weight)
    if keep is not None:
        problem.improved = lambda cost, t: keep(problem.values(t), 2 * cost)
    first = problem.scaled([parameter.start for parameter in parameters])
    points = [first]
    if starts > 1:
        cube = qmc.LatinHypercube(first.size, rng=seed).random(starts - 1)
        points += list(problem.low + cube * (problem.high - problem.low))
    answers = []
    number = 0
    for number, point in enumerate(_with_others(points, answers, problem, seed), 1):
        if progress is not None:
            best = "the first"
            if answers:
                best = f"chi-square {2 * problem.best[0]:.4g} so far"
            progress(f"start {number} of {max(number, len(points))}, {best}")
        answer = problem.solve(point, loss)
        if answer is not None:
            answers.append(answer)
        if problem.interrupted:
            break
    if not answers:
        value, _ = problem.of_model(first)
        bad = np.flatnonzero(~np.isfinite(value) & (weight > 0))
        raise BadInput("start", bad.tolist(), "one at which all readings have a computed value")
    best = min(answers, key=lambda answer: answer.cost)
    return _fit(problem, best, answers, loss, number - len(answers))


def _with_others(points, answers, problem: LeastSquares, seed: int) -> Iterator[NDArray]:
    """The starts, and further ones near the first while every one was stuck."""
    yield from points
    first = points[0]
    span = problem.high - problem.low
    cube = qmc.LatinHypercube(first.size, rng=seed + 1).random(_OTHERS)
    for share in cube:
        if not answers or not all(answer.stuck for answer in answers) or problem.interrupted:
            return
        # nearer than the others, as a machine that runs is likely to be
        other = first + _NEARBY * (share - 0.5) * span
        yield np.clip(other, problem.low, problem.high)


def _fit(problem: LeastSquares, best, answers, loss: str, failed: int) -> Fit:
    parameters = problem.parameters
    t = best.x
    residual, slope = problem.at(t)
    value, model_slope = problem.of_model(t)
    readings = value.size
    rho = problem.loss(loss)
    robust = np.ones(readings)
    if not isinstance(rho, str):
        robust = rho(residual**2)[1][:readings]
    # Gauss-Newton's matrix of a robust loss: each reading counts by rho'.
    weighted = slope.copy()
    weighted[:readings] *= np.sqrt(robust)[:, None]
    inverse = _inverse(weighted, problem.reach)
    values = problem.values(t)
    scale = problem.slopes(values)
    span = problem.high - problem.low
    return Fit(
        parameters=parameters,
        estimate=values,
        covariance=inverse * np.outer(scale, scale),
        measured=problem.measured,
        sd=problem.sd,
        weight=problem.weight,
        value=value,
        slope=model_slope,
        robust=robust,
        chi_square=float(np.sum(residual**2)),
        freedom=int((problem.weight > 0).sum()) + len(problem.rows) - t.size,
        directions=tuple(directions_of(problem, t, slope[:readings] * np.sqrt(robust)[:, None])),
        at_bound=np.minimum(t - problem.low, problem.high - t) < _AT_BOUND * span,
        minima=tuple(_other_minima(problem, best, answers, np.sqrt(np.diag(inverse)))),
        steps=int(best.nfev),
        converged=bool(best.success),
        failed_starts=failed,
        loss=loss,
        model=problem.model,
        interrupted=problem.interrupted,
        lost_steps=int(best.lost),
        stuck=bool(best.stuck),
    )


def _inverse(slope: NDArray, reach: NDArray) -> NDArray:
    """(p, p) covariance of t; infinite variances of parameters that nothing tells."""
    # Scaled by the reach of each parameter, so that the decomposition sees numbers of one size; by
    # singular values, as the product of slopes would square their range.
    _, singular, rows = np.linalg.svd(slope * reach, full_matrices=False)
    determined = singular > 1e-14 * singular[0]
    inverse = (
        (rows[determined].T / singular[determined] ** 2) @ rows[determined] * np.outer(reach, reach)
    )
    # A direction that nothing tells stays out; what it moves has no finite error.
    undetermined = (np.abs(rows[~determined]) > 1e-6).any(axis=0)
    inverse[undetermined, undetermined] = np.inf
    return inverse


def _within_bound(end: float, bound: float, sign: int) -> float:
    """An end of an interval, or the bound where the end lies beyond it."""
    if sign < 0:
        return max(end, bound)
    return min(end, bound)


def _is_apart(place: NDArray, earlier_places: Sequence[NDArray], error: NDArray) -> bool:
    """Whether a place differs from every earlier one by more than its error."""
    return all((np.abs(place - other) > _APART * error).any() for other in earlier_places)


def _other_minima(problem: LeastSquares, best, answers, error: NDArray) -> Iterator[Minimum]:
    """Where other starts ended nearly as low, each place once; `error` tells places apart."""
    places = [best.x]
    for answer in sorted(answers, key=lambda answer: answer.cost):
        near = 2 * (answer.cost - best.cost) < _NEAR
        if near and _is_apart(answer.x, places, error):
            places.append(answer.x)
            yield Minimum(problem.values(answer.x), 2 * float(answer.cost))
