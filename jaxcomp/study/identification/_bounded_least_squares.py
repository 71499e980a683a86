r"""Least squares with bounds, priors and robust losses.

$$\min_{l\le p\le h}\ \tfrac12\sum_i\rho\Bigl(\bigl((f_i(p)-y_i)/s_i\bigr)^2\Bigr)
  + \tfrac12\sum_j\bigl((t_j(p_j)-t_j(m_j))/q_j\bigr)^2,$$

where t is the logarithm of a positive parameter, or the parameter itself, and q that of its prior. The
model gives values and exact slopes in one call. Measured values, standard deviations and weights stay
outside of it, so that hold-outs, profiles and repetitions compile nothing again; a weight of zero leaves
a reading out.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from ..._core.errors import BadInput
from ..._core.interrupts import interrupts_raised
from ..._core.words import one_of

Model = Callable[[NDArray], tuple[NDArray, NDArray]]

LOSSES = ("linear", "soft_l1", "huber")
# Evaluations of a start, and how many of them may lower chi-square by less than `_LITTLE` in all: where
# valves have kinks, steps shrink and shrink without a minimum nearby that they would meet.
_MOST = 60
_PATIENCE = 6
_LITTLE = 1e-3
# Evaluations without a value, one after the other, after which a start is given up: each of them quarters
# the step.
_LOST = 12
# Distance over the range below which a start has not moved.
_MOVED = 1e-6


class Parameter(NamedTuple):
    """An unknown number with its bounds and what is known of it beforehand.

    Attributes:
        name: in tables and messages.
        low, high: bounds.
        start: first value, within the bounds.
        prior: mean of what is known beforehand; `None` for nothing.
        sd: its standard deviation, in the unit of the parameter.
        log: count in its logarithm, as suits factors, areas and stiffnesses; linear otherwise.
        unit: SI unit.
    """

    name: str
    low: float
    high: float
    start: float
    prior: float | None = None
    sd: float | None = None
    log: bool = True
    unit: str = ""

    def scaled(self, value: ArrayLike) -> Any:
        """t of a value."""
        if self.log:
            return np.log(value)
        return np.asarray(value, float)

    def slope(self, value: float) -> float:
        """dp/dt at a value."""
        if self.log:
            return value
        return 1.0

    @property
    def prior_width(self) -> float | None:
        """q, the standard deviation of the prior in t."""
        if self.prior is None or self.sd is None:
            return None
        return self.sd / self.slope(self.prior)

    @property
    def reach(self) -> float:
        """The standard deviation of the prior in t, or half the range of the bounds."""
        half = float(self.scaled(self.high) - self.scaled(self.low)) / 2
        return self.prior_width or half


def check_problem(parameters, measured, sd, weight, loss) -> None:
    """Raise what `fit` raises of its arguments, before the model is asked for anything."""
    if loss not in LOSSES:
        raise BadInput("loss", loss, one_of(loss, LOSSES))
    for parameter in parameters:
        if not parameter.low < parameter.high or (parameter.log and parameter.low <= 0):
            raise BadInput(
                parameter.name, parameter.low, f"a range of positive width up to {parameter.high:g}"
            )
        if not parameter.low <= parameter.start <= parameter.high:
            raise BadInput(
                parameter.name,
                parameter.start,
                f"within {parameter.low:g} to {parameter.high:g} at the start",
            )
    used = weight > 0
    if not np.all(sd[used] > 0) or not np.all(np.isfinite(measured[used])):
        raise BadInput("sd", sd, "positive, and every reading finite")
    count = int(used.sum()) + sum(parameter.prior_width is not None for parameter in parameters)
    if count < len(parameters):
        bound = f"at least {len(parameters)}, one for each parameter; give more readings or priors"
        raise BadInput("readings and priors", count, bound)


class _Settled(Exception):
    """Further evaluations gain nothing."""


class LeastSquares:
    """Residuals and slopes over t, with the priors as the last rows."""

    def __init__(self, model: Model, parameters, measured, sd, weight):
        self.model = model
        self.parameters = parameters
        self.measured = measured
        self.sd = sd
        self.weight = weight
        self.rows = []
        low = []
        high = []
        reach = []
        for number, parameter in enumerate(parameters):
            if parameter.prior_width is not None:
                self.rows.append(number)
            low.append(parameter.scaled(parameter.low))
            high.append(parameter.scaled(parameter.high))
            reach.append(parameter.reach)
        self.low = np.array(low)
        self.high = np.array(high)
        self.reach = np.array(reach)
        # SciPy asks for residuals and slopes apart, the model gives both at once.
        self._evaluated: tuple[bytes, tuple[NDArray, NDArray]] | None = None
        self.best = (np.inf, np.zeros(0))
        self.interrupted = False
        # called with cost and t whenever they are the best so far
        self.improved: Callable[[float, NDArray], object] = lambda cost, t: None

    def scaled(self, values: ArrayLike) -> NDArray:
        scaled = []
        for parameter, value in zip(self.parameters, np.asarray(values, float), strict=True):
            scaled.append(parameter.scaled(value))
        return np.array(scaled)

    def values(self, t: NDArray) -> NDArray:
        values = []
        for parameter, x in zip(self.parameters, t, strict=True):
            if parameter.log:
                values.append(np.exp(x))
            else:
                values.append(x)
        return np.array(values)

    def slopes(self, values: NDArray) -> NDArray:
        """dp/dt of all parameters at these values."""
        slopes = []
        for parameter, value in zip(self.parameters, values, strict=True):
            slopes.append(parameter.slope(value))
        return np.array(slopes)

    def of_model(self, t: NDArray) -> tuple[NDArray, NDArray]:
        """Values and slopes over the parameters; those of the last t are kept."""
        key = t.tobytes()
        if self._evaluated is None or self._evaluated[0] != key:
            value, slope = self.model(self.values(t))
            self._evaluated = key, (np.asarray(value, float), np.asarray(slope, float))
        return self._evaluated[1]

    def at(self, t: NDArray) -> tuple[NDArray, NDArray]:
        """Residuals and slopes over t. Readings without weight are zero even where the model fails."""
        value, slope = self.of_model(t)
        values = self.values(t)
        # dp/dt, because the model's slopes are over p.
        scale = self.slopes(values)
        used = self.weight > 0
        factor = np.where(used, np.sqrt(self.weight) / self.sd, 0.0)
        residual = np.where(used, (value - self.measured) * factor, 0.0)
        slope = np.where(used[:, None], slope * factor[:, None] * scale, 0.0)
        prior = np.zeros(len(self.rows))
        prior_slope = np.zeros((len(self.rows), t.size))
        for row, n in enumerate(self.rows):
            parameter = self.parameters[n]
            prior[row] = (t[n] - parameter.scaled(parameter.prior)) / parameter.prior_width
            prior_slope[row, n] = 1 / parameter.prior_width
        return np.concatenate([residual, prior]), np.concatenate([slope, prior_slope])

    def loss(self, name: str):
        """SciPy's loss on the readings and the square on the priors."""
        if name == "linear":
            return "linear"
        readings = self.measured.size

        def rho(z):
            # As SciPy wants them: rho, rho' and rho'' over z, the squares of the residuals.
            out = np.stack([z, np.ones_like(z), np.zeros_like(z)])
            squares = z[:readings]
            plain = np.stack([z, np.ones_like(z), np.zeros_like(z)])
            if name == "soft_l1":
                root = np.sqrt(1 + squares)
                robust = np.stack([2 * (root - 1), 1 / root, -0.5 / root**3])
            else:
                # Both branches are computed: at least one, so that nothing is divided by zero.
                far = np.sqrt(np.maximum(squares, 1.0))
                robust = np.where(
                    squares <= 1,
                    plain[:, :readings],
                    np.stack([2 * far - 1, 1 / far, -0.5 / far**3]),
                )
            out[:, :readings] = robust
            return out

        return rho

    def cost(self, residual: NDArray, loss: str) -> float:
        rho = self.loss(loss)
        square = residual**2
        if not isinstance(rho, str):
            square = rho(square)[0]
        return 0.5 * float(np.sum(square))

    def solve(self, start: NDArray, loss: str, free: NDArray | None = None):
        """SciPy's answer from a start, with `x` all of t; `None` where the model has no value there."""
        if free is None:
            free = np.ones(start.size, bool)

        def full_t(x):
            t = start.copy()
            t[free] = x
            return t

        try:
            with interrupts_raised():
                return self._solve(start, loss, free, full_t)
        except _Settled as settled:
            cost, t, count, lost = settled.args
            stuck = self.stuck(start, t, lost)
            return optimize.OptimizeResult(
                x=t, cost=cost, nfev=count, success=not stuck, lost=lost, stuck=stuck
            )
        except KeyboardInterrupt:
            if not self.best[1].size:
                raise
            self.interrupted = True
            return optimize.OptimizeResult(
                x=self.best[1], cost=self.best[0], nfev=0, success=False, lost=0, stuck=False
            )

    def stuck(self, start: NDArray, end: NDArray, lost: int) -> bool:
        """Whether a start never moved because steps from it, so many, have no value."""
        return lost > 0 and bool(np.all(np.abs(end - start) < _MOVED * (self.high - self.low)))

    def _solve(self, start: NDArray, loss: str, free: NDArray, full_t):
        lowest = np.inf
        place = start
        count = 0
        idle = 0  # evaluations in a row that gained little
        lost = 0  # evaluations without a value
        lost_in_row = 0

        def residual(x):
            nonlocal lowest, place, idle, count, lost, lost_in_row
            t = full_t(x)
            residuals = self.at(t)[0]
            cost = self.cost(residuals, loss)
            count += 1
            if np.isfinite(cost):
                idle += 1
                # The cost is half of chi-square.
                if cost < lowest - _LITTLE / 2:
                    idle = 0
                lost_in_row = 0
            else:
                # no step at all: nothing is known of a minimum
                lost += 1
                lost_in_row += 1
            if cost < lowest:
                lowest = cost
                place = t
            if cost < self.best[0]:
                self.best = cost, t
                self.improved(cost, t)
            if idle > _PATIENCE or lost_in_row >= _LOST:
                raise _Settled(lowest, place, count, lost)
            return residuals

        if not np.all(np.isfinite(residual(start[free]))):
            return None
        if not free.any():
            cost = self.cost(self.at(start)[0], loss)
            return optimize.OptimizeResult(
                x=start, cost=cost, nfev=1, success=True, lost=0, stuck=False
            )
        # strictly inside, as the solver wants its start
        span = self.high - self.low
        begin = np.clip(start, self.low + 1e-9 * span, self.high - 1e-9 * span)
        answer = optimize.least_squares(
            residual,
            begin[free],
            lambda x: self.at(full_t(x))[1][:, free],
            bounds=(self.low[free], self.high[free]),
            # The trust region is a ball in what each parameter may do.
            x_scale=self.reach[free],
            loss=self.loss(loss),  # pyright: ignore[reportArgumentType]
            # a step of 1e-3 standard errors moves chi-square by 1e-6; with kinks of valves in the model
            # more would creep
            ftol=1e-6,
            xtol=1e-6,
            gtol=1e-9,
            max_nfev=_MOST,
        )
        answer.x = full_t(answer.x)
        answer.lost = lost
        # else the tolerance was met by steps that shrank to nothing
        answer.stuck = self.stuck(start, answer.x, lost)
        answer.success = answer.success and not answer.stuck
        return answer
