r"""The probability that a quantity exceeds its limit.

First order (Hasofer and Lind 1974): in the space of independent standard normal variables u the most
likely machine that reaches the limit is the nearest one, at the distance beta, and P = Phi(-beta). Second
order (Hohenbichler and Rackwitz 1988, J. Eng. Mech. 114, 2195): the curvatures kappa of the limit there
bend it,

    P = Phi(-beta) prod_i (1 + psi kappa_i)^(-1/2),      psi = phi(beta) / Phi(-beta).

A quantity near its own optimum reaches the limit on several sides; every nearest point that is found
counts, and their probabilities add up, which is an upper bound (Ditlevsen 1979). Samples about the points
(Melchers 1989) check both orders where plain samples are too few.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.optimize import minimize

from ..._core.declared import QUANTITY, Record, computed, held, part, reading, word
from .._problem import Problem, solved
from ._moments import Sampled, solved_rows
from ._scatter import Scatter

# Of the largest distance from the limit at a start: how exactly a nearest point lies on it.
_ON_LIMIT = 1e-6
# Two searches that end closer than this found the same point.
_SAME = 0.3
# Half a difference of slopes for the curvatures of the limit, in standard deviations.
_STEP = 0.25
# Factors of the second order below which it no longer is one: the limit bends with the sphere.
_STRAIGHT = 0.2
# How far out a search starts, in standard deviations.
_FAR = 3.0


@dataclass(frozen=True)
class Limit(Record):
    """A bound that machines should keep.

    Attributes:
        quantity: name.
        bound: [SI]
        above: whether more than it is a failure, or less.
    """

    quantity: str = word()
    bound: float = reading(QUANTITY)
    above: bool = word(key="broken_above", default=True)

    def broken(self, values):
        """Where values [SI] break it."""
        if self.above:
            return values > self.bound
        return values < self.bound

    @property
    def side(self) -> str:
        """Where failures lie: "above" or "below" the bound."""
        return "above" if self.above else "below"


@dataclass(frozen=True, eq=False)
class Reliability(Record):
    """Probability that a limit is broken.

    Attributes:
        limit: the limit.
        sampled: [-] share of the samples that break it.
        sampled_interval: [-] its 95 % interval.
        beta: [-] distance of the nearest point; negative if the mean machine breaks the limit; NaN
            if none was found.
        first_order, second_order: [-] probabilities; NaN if no point was found, or if the limit bends
            too much for the second order.
        near_points, near_points_error: [-] probability by samples about the nearest points, and its
            standard error; NaN as above.
        points: [-] (points, variables) u of the nearest points, the nearest first.
        design: [SI] (variables,) the most likely machine that breaks the limit.
        importance: [-] (variables,) squared direction cosines of the nearest point; they sum to one.
    """

    limit: Limit = part(Limit, inline=True)
    sampled: float = reading("")
    sampled_interval: tuple[float, float] = reading("")
    beta: float = reading("")
    first_order: float = reading("")
    second_order: float = reading("")
    near_points: float = reading("")
    near_points_error: float = reading("")
    points: Float[np.ndarray, "points variables"] = held()
    design: Float[np.ndarray, " variables"] = held()
    importance: Float[np.ndarray, " variables"] = held()

    @computed("")
    def nearest_points(self) -> int:
        """Number of nearest points."""
        return len(self.points)

    @property
    def agrees(self) -> bool:
        """Whether the first order lies in the interval of the samples, or within a quarter of it."""
        low, high = self.sampled_interval
        return bool(0.75 * low <= self.first_order <= 1.25 * high)


class _LimitState:
    """Distance of a machine beyond a limit in the space of u, with its slope; each solved once."""

    def __init__(self, problem: Problem, scatter: Scatter, nominal, limit: Limit, progress: bool):
        self.problem = problem
        self.limit = limit
        self.size = len(nominal)
        self.progress = progress
        self.place = problem.names.index(limit.quantity)
        # the search calls both a thousand times, and outside of a program their operations take longer
        self.machines = jax.jit(lambda u: scatter.at(nominal, u))
        self.slope_of_machines = jax.jit(jax.vmap(jax.jacfwd(self.machines)))
        self.solutions: dict[bytes, tuple[float, np.ndarray]] = {}

    def __call__(self, points) -> tuple[np.ndarray, np.ndarray]:
        """(n,) how far beyond the limit, positive for failures, and (n, variables) its slope."""
        points = np.atleast_2d(np.asarray(points, float))
        new = [p for p in points if p.tobytes() not in self.solutions]
        if new:
            u = jnp.asarray(np.stack(new))
            sign = 1.0 if self.limit.above else -1.0
            # a search asks for one machine after the other: in a batch it would be solved eight times
            solutions = solved(self.problem, self.machines(u), batch=1)
            beyond = sign * (solutions.values[:, self.place] - self.limit.bound)
            by_value = solutions.slope[:, self.place]
            # Chain rule: slopes over the numbers of the machine, times those of the numbers over u.
            by_u = self.slope_of_machines(u)
            slope = np.einsum("nv,nvu->nu", by_value, by_u)
            beyond = np.where(solutions.ok, beyond, np.nan).tolist()
            slope = np.where(solutions.ok[:, None], sign * slope, np.nan)
            for point, distance, gradient in zip(new, beyond, slope, strict=True):
                self.solutions[point.tobytes()] = distance, gradient
        distances = []
        gradients = []
        for point in points:
            distance, gradient = self.solutions[point.tobytes()]
            distances.append(distance)
            gradients.append(gradient)
        return np.array(distances), np.stack(gradients)

    def bent(self, point) -> tuple[float, np.ndarray, np.ndarray]:
        """Value, slope (n,) and curvature (n, n), by differences of slopes, at a point (n,)."""
        steps = _STEP * np.eye(self.size)
        value, slope = self(np.concatenate([point[None], point + steps, point - steps]))
        ahead, behind = np.split(slope[1:], 2)
        bent = (ahead - behind) / (2 * _STEP)
        return value[0], slope[0], (bent + bent.T) / 2

    def starts(self) -> np.ndarray:
        """Along the slope at the mean, and to both sides along what bends the quantity most."""
        value, slope, bent = self.bent(np.zeros(self.size))
        starts = []
        steep = np.linalg.norm(slope)
        if np.isfinite(steep) and steep > 0:
            # The nearest point to first order, as far as a search may start.
            starts.append(np.clip(-value / steep, -_FAR, _FAR) * slope / steep)
        if np.all(np.isfinite(bent)):
            # Downwards: along the first the quantity bends most towards failure.
            vectors = np.linalg.eigh(bent)[1][:, ::-1]
            for direction in vectors.T[:2]:
                starts += [_FAR * direction, -_FAR * direction]
        if starts:
            return np.stack(starts)
        return np.ones((1, self.size))

    def nearest_points(self) -> np.ndarray:
        """(points, n) all points of the limit that are nearest in their surroundings, sorted."""
        starts = self.starts()
        # Makes the tolerance of the search a number without unit.
        scale = np.nanmax(np.abs(self(starts)[0]))
        ends = []
        if not (np.isfinite(scale) and scale > 0):
            return np.zeros((0, self.size))
        constraint = {
            "type": "eq",
            "fun": lambda u: self(u)[0][0] / scale,
            "jac": lambda u: self(u)[1][0] / scale,
        }
        options = {"maxiter": 100, "ftol": 1e-10}
        for start in starts:
            answer = minimize(
                # Half the square of the distance: smooth where the mean itself is on the limit.
                lambda u: (0.5 * u @ u, u),
                start,
                jac=True,
                method="SLSQP",
                constraints=constraint,
                options=options,
            )
            # Beyond 12 deviations lie 2e-33 of all machines.
            on_limit = abs(constraint["fun"](answer.x)) < _ON_LIMIT
            if answer.success and on_limit and np.linalg.norm(answer.x) < 12:
                ends.append(answer.x)
        distinct: list[np.ndarray] = []
        for point in sorted(ends, key=np.linalg.norm):
            if all(np.linalg.norm(point - other) > _SAME for other in distinct):
                distinct.append(point)
        return np.reshape(distinct, (-1, self.size))

    def second_order(self, points, failed: bool) -> float:
        """The probability by curvature; NaN where the limit bends too much."""
        total = 0.0
        # Of a mean machine that breaks the limit the nearest point alone bounds what is safe.
        if failed:
            points = points[:1]
        for point in points:
            beta = np.linalg.norm(point)
            _, slope, bent = self.bent(point)
            steep = np.linalg.norm(slope)
            flat = np.linalg.svd(slope[None] / steep)[2][1:]  # directions along the limit
            curvature = -np.linalg.eigvalsh(flat @ bent @ flat.T) / steep
            if failed:  # what is safe lies beyond, and bends the other way
                curvature = -curvature
            growth = 1 + stats.norm.pdf(beta) / stats.norm.sf(beta) * curvature
            if not np.all(growth > _STRAIGHT):
                return np.nan
            total += stats.norm.sf(beta) / np.sqrt(np.prod(growth))
        if failed:
            return float(1 - total)
        return float(min(1.0, total))

    def about(self, points, count: int, seed: int) -> tuple[float, float]:
        """The probability by samples about the points, and its standard error."""
        rng = np.random.default_rng(seed)
        centres = rng.integers(len(points), size=count)
        u = points[centres] + rng.standard_normal((count, self.size))
        title = None
        if self.progress:
            title = f"Machines near the limit of {self.limit.quantity}"
        values, ok = solved_rows(self.problem, self.machines(u), title)
        # phi(u) over the mixture of bells about the points
        away = [-0.5 * np.sum((u - p) ** 2, 1) for p in points]
        # In logarithms: far from all points the densities underflow.
        weight = np.exp(-0.5 * np.sum(u**2, 1) - np.logaddexp.reduce(away, axis=0)) * len(points)
        parts = weight * (self.limit.broken(values[:, self.place]) & ok)
        return float(parts.mean()), float(parts.std(ddof=1) / np.sqrt(count))


def reliability(
    problem: Problem,
    scatter: Scatter,
    nominal,
    limit: Limit,
    samples: Sampled,
    around: int | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Reliability:
    """The probability that a limit is broken, in several ways.

    Beside plain samples, which are solved already, so many machines around the nearest points are drawn
    and solved; none for 0. If that is left open, half as many as plain samples and 4096 at most.
    """
    state = _LimitState(problem, scatter, nominal, limit, progress)
    if around is None:
        around = min(len(samples.ok) // 2, 4096)
    share, interval = _sampled_share(limit, samples.values[samples.ok, state.place])
    points = state.nearest_points()
    undefined = np.full(len(nominal), np.nan)
    if not len(points):
        return Reliability(
            limit=limit,
            sampled=share,
            sampled_interval=interval,
            beta=np.nan,
            first_order=np.nan,
            second_order=np.nan,
            near_points=np.nan,
            near_points_error=np.nan,
            points=points,
            design=undefined,
            importance=undefined,
        )
    # Where the mean machine breaks the limit, what is safe is the tail of the distribution.
    failed = state(np.zeros(len(nominal)))[0][0] > 0
    distance = np.linalg.norm(points, axis=1)
    if failed:
        beta = -distance[0]
        first_order = stats.norm.sf(beta)
    else:
        beta = distance[0]
        first_order = min(1.0, stats.norm.sf(distance).sum())
    near_points = np.nan
    near_points_error = np.nan
    if around and not failed:
        near_points, near_points_error = state.about(points, around, seed)
    importance = undefined
    if distance[0] > 0:
        importance = (points[0] / distance[0]) ** 2
    return Reliability(
        limit=limit,
        sampled=share,
        sampled_interval=interval,
        beta=float(beta),
        first_order=float(first_order),
        second_order=state.second_order(points, failed),
        near_points=near_points,
        near_points_error=near_points_error,
        points=points,
        design=np.asarray(scatter.at(nominal, points[0])),
        importance=importance,
    )


def _sampled_share(limit: Limit, values) -> tuple[float, tuple[float, float]]:
    """Share of the samples that break a limit, and its 95 % interval."""
    if not values.size:
        return np.nan, (np.nan, np.nan)
    broken = int(np.sum(limit.broken(values)))
    interval = stats.binomtest(broken, values.size).proportion_ci(method="wilson")
    return broken / values.size, (float(interval.low), float(interval.high))
