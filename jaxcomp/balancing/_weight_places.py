r"""Weights where they can go: at given places, of any mass or out of a stock, added or taken off.

Any masses $m_j \ge 0$ at places are a convex problem. Weights of a stock are combinations, of which
the best is found and proven: with the triangle of a QR decomposition, $\|W(V_0 + CB)\|^2 = c^2 +
\|R(B - B^*)\|^2$, planes are decided one after the other, each combination adding what no later plane
can take off again; what adds more than the best whole combination so far is left out unseen (sphere
decoder: U. Fincke and M. Pohst 1985, Improved methods for calculating vectors of short length in a
lattice, Mathematics of Computation 44, 463-471; here with any finite sets).
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._core.errors import BadInput
from .._core.status import Status
from .._core.words import one_of
from ._balance import Balance, PlacedWeights, balance
from ._influence import Influence
from ._least_squares import least_squares
from ._weight_sums import Candidate, Choices, WeightSums

# Sums of weights to list of one plane, and points to look at in all: seconds of work each. A look into a
# list takes as long as some hundred points of a pair of them.
_MOST_SUMS = 1_500_000
_MOST_POINTS = 20_000_000
_LOOK = 100
# Sums of a plane that acts like the others, of which each has to be tried.
_MOST_ALIKE = 20_000
# [-] Of the correction: no weight of any mass is larger, which makes bounds finite.
_BEYOND_REASON = 1e3
# [-] Of the unit in which masses are solved for: smaller ones are none.
_NO_MASS = 1e-9


class Places(eqx.Module):
    """Places for weights in one plane.

    Attributes:
        angles: [rad] (places,)
        radius: [m] at which weights sit; absent: that of the plane, or masses are what is added at the
            radius of the trial weights.
        removed: whether mass is taken off, as by drilling; otherwise it is added.
        largest: [kg] that one place takes, of weights of any mass.
    """

    angles: Float[np.ndarray, " places"] = eqx.field(
        converter=lambda x: np.atleast_1d(np.asarray(x, float))
    )
    radius: float | None = None
    removed: bool = False
    largest: float = np.inf

    def __check_init__(self):
        if not self.angles.size or not np.all(np.isfinite(self.angles)):
            raise BadInput("angles", self.angles, "at least one, all finite")
        for field in ("radius", "largest"):
            value = getattr(self, field)
            if value is not None and not value > 0:
                raise BadInput(field, value, "> 0")


class _Plane(NamedTuple):
    """Places of a plane of the system.

    Attributes:
        arm: [m] times a mass is its unbalance, below zero where mass is taken off; 1 where the
            corrections of the system are masses.
        radius: [m] whether the arm is one; `None` where weights are what is added.
        directions: (places,) unit vectors of the places, complex.
        places: as they were given.
    """

    arm: float
    radius: float | None
    directions: np.ndarray
    places: Places


def placed(
    influence: Influence,
    places: Places | Mapping[str, Places],
    masses: Sequence[float] | None = None,
    *,
    counts: Sequence[int] | None = None,
    per_place: int = 1,
    most_weights: int = 4,
) -> Balance:
    """The weights at given places that leave least vibration, in the weighted sum of squares.

    Of any mass they are the lightest that reach what can be reached. Out of a stock they are the best
    of all combinations, which the result proves: its `bound` equals its `objective`. Where
    combinations are too many for that the status says so, and the gap how much better one might be.

    Args:
        influence: the system; its numbers have to be concrete.
        places: in all planes, or by plane; a plane that is not named takes no weights.
        masses: [kg] of the weights in stock; absent: weights of any mass.
        counts: how many of each mass the stock has for all planes; absent: any number.
        per_place: weights of a stock that one place takes.
        most_weights: of a stock in one plane.

    Raises:
        BadInput: an unknown plane, a mass that is not positive, numbers of weights below 1, another
            number of `counts` than of masses, or a radius beside trial weights in units of mass.
    """
    planes = _planes(influence, places)
    if masses is None:
        return _any_masses(influence, planes)
    stock = np.asarray(masses, float)
    _check_stock(stock, counts, per_place, most_weights)
    limits = None
    if counts is not None:
        limits = np.asarray(counts, int)
    sums = {}
    for number, plane in planes.items():
        # place by place, with all of the stock at each: combinations are grown in this order
        place = np.repeat(np.arange(plane.directions.size), stock.size)
        kind = np.tile(np.arange(stock.size), plane.directions.size)
        unbalance = plane.arm * stock[kind] * plane.directions[place]
        most_in_plane = min(most_weights, per_place * plane.directions.size)
        choices = Choices(unbalance, stock[kind], place, kind, per_place, most_in_plane, limits)
        sums[number] = WeightSums(choices, _MOST_SUMS)
    search = _Search(influence, sums, limits)
    search.run()
    return _stock_balance(influence, planes, search)


def as_weights(solution: Balance, radii: Mapping[str, float], removed: Collection[str]) -> Balance:
    """A balance with one weight in each plane, wherever its angle is.

    Args:
        solution: of any method.
        radii: [m] by plane; those of the system for others.
        removed: planes in which mass is taken off, opposite to the correction.
    """
    influence = solution.influence
    angles = np.angle(np.asarray(solution.correction))
    places = {}
    for name, angle in zip(influence.planes, angles.tolist(), strict=True):
        taken_off = name in removed
        if taken_off:
            angle += np.pi
        places[name] = Places([angle], radius=radii.get(name), removed=taken_off)
    planes = _planes(influence, places)
    sizes = np.abs(np.asarray(solution.correction))
    arms = np.array([abs(plane.arm) for plane in planes.values()])
    owner = np.arange(sizes.size)
    weights = _weights(influence, planes, owner, sizes / arms, _all_angles(planes))
    return dataclasses.replace(solution, weights=weights)


def _all_angles(planes: Mapping[int, _Plane]) -> np.ndarray:
    """[rad] Angles of all places, plane by plane."""
    return np.concatenate([plane.places.angles for plane in planes.values()])


def _check_stock(stock, counts, per_place, most_weights) -> None:
    if not stock.size or not np.all(np.isfinite(stock) & (stock > 0)):
        raise BadInput("masses", stock, "at least one, all > 0")
    for field, value in (("per_place", per_place), ("most_weights", most_weights)):
        if value < 1:
            raise BadInput(field, value, ">= 1")
    if counts is not None and len(counts) != stock.size:
        raise BadInput("counts", len(counts), f"a number for each of {stock.size} masses")
    if counts is not None and min(counts) < 0:
        raise BadInput("counts", min(counts), ">= 0")


def _planes(influence: Influence, places) -> dict[int, _Plane]:
    """Places by number of the plane."""
    by_name: Any = dict.fromkeys(influence.planes, places)
    if isinstance(places, Mapping):
        by_name = places
    for name in by_name:
        if name not in influence.planes:
            raise BadInput(f"places.{name}", name, one_of(name, influence.planes))
    if not by_name:
        raise BadInput("places", "none", "of at least one plane")
    planes = {}
    for number, name in enumerate(influence.planes):
        if name in by_name:
            plane_places = by_name[name]
            radius = _radius(influence, number, plane_places)
            arm = 1.0 if radius is None else radius
            if plane_places.removed:
                arm = -arm
            planes[number] = _Plane(arm, radius, np.exp(1j * plane_places.angles), plane_places)
    return planes


def _radius(influence: Influence, number: int, places: Places) -> float | None:
    """[m] Radius of the weights in a plane; `None` where they are what is added."""
    if influence.trial == "kg":
        if places.radius is not None:
            problem = "absent where the trial weights are masses, at the radius of all weights"
            raise BadInput("radius", places.radius, problem)
        return None
    if places.radius is not None:
        return places.radius
    if influence.radius is None or not np.isfinite(influence.radius[number]):
        return None
    return float(influence.radius[number])


# ------------------------------------------------------------------- weights of any mass
def _any_masses(influence: Influence, planes: Mapping[int, _Plane]) -> Balance:
    """The lightest weights of any mass that leave least."""
    from scipy.optimize import lsq_linear

    matrix, initial = (np.asarray(x) for x in influence.weighted)
    owners = []
    arms = []
    limits = []
    for number, plane in planes.items():
        count = plane.directions.size
        owners.append(np.full(count, number))
        arms.append(plane.arm * plane.directions)
        limits.append(np.full(count, plane.places.largest))
    owner = np.concatenate(owners)
    arms = np.concatenate(arms)
    columns = matrix[:, owner] * arms
    unit = _mass_unit(columns, initial)
    upper = np.minimum(np.concatenate(limits) / unit, _BEYOND_REASON)
    # Masses are real: each complex row is two real ones.
    system = unit * np.vstack([np.real(columns), np.imag(columns)])
    right = -np.append(np.real(initial), np.imag(initial))
    size = max(float(np.linalg.norm(initial)), 1e-300)
    # an active-set method, whose masses end on their bounds exactly
    answer = lsq_linear(system / size, right / size, (0.0, upper), method="bvls", tol=1e-15)
    masses = np.clip(answer.x, 0.0, upper)
    low = _dual_bound(system / size, right / size, masses, upper)
    # The same vibration by less mass, plane by plane: only sums count.
    light = np.zeros(masses.size)
    for number in planes:
        in_plane = owner == number
        light[in_plane] = _lightest(arms[in_plane], masses[in_plane], upper[in_plane])
    light = np.where(light < _NO_MASS, 0.0, light) * unit
    correction = np.zeros(len(influence.planes), complex)
    np.add.at(correction, owner, arms * light)
    objective = float(np.linalg.norm(initial + matrix @ correction))
    weights = _weights(influence, planes, owner, light, _all_angles(planes))
    return balance(
        influence,
        jnp.asarray(correction),
        jnp.asarray(objective),
        jnp.asarray(min(low * size, objective)),
        "weights of any mass at places, least squares",
        # An objective that is rounding of the vibration before is proven by itself.
        Status.where(objective - low * size > 1e-9 * size, Status.not_converged, Status.converged),
        weights=weights,
    )


def _mass_unit(columns: np.ndarray, initial: np.ndarray) -> float:
    """[kg] A mass that does about as much as the vibration before."""
    strength = np.linalg.norm(columns, axis=0).max()
    size = np.linalg.norm(initial)
    if strength > 0 and size > 0:
        return float(size / strength)
    return 1.0


def _dual_bound(system, right, masses, upper) -> float:
    """A value that no masses within their bounds get below: the dual problem at their residual."""
    # For any r and all masses within their bounds, |b - A m|^2 >= 2 r.(b - A m) - |r|^2, and r.A m is
    # at most that of the bounds where A^T r is positive, and of no mass elsewhere.
    residual = right - system @ masses
    gain = np.maximum(system.T @ residual, 0.0)
    squares = 2 * (residual @ right - np.sum(upper * gain)) - residual @ residual
    return float(np.sqrt(max(squares, 0.0)))


def _lightest(arms, masses, upper) -> np.ndarray:
    """The least masses with the same sum, of which at most two are neither none nor full."""
    from scipy.optimize import linprog

    total = np.sum(arms * masses)
    if not masses.max() > 0:
        return masses
    # In shares of the largest mass, and sums over that at the longest arm: the programme's tolerances
    # are absolute.
    scale = float(np.abs(arms).max()) * max(float(masses.max()), 1e-300)
    rows = np.stack([np.real(arms), np.imag(arms)]) * masses.max() / scale
    target = np.array([np.real(total), np.imag(total)]) / scale
    ends = upper / masses.max()
    answer = linprog(
        np.ones(masses.size), A_eq=rows, b_eq=target, bounds=[(0, end) for end in ends]
    )
    if answer.status != 0:
        return masses
    shares = np.where(answer.x > ends * (1 - 1e-9), ends, answer.x)
    shares = np.where(shares < 1e-9, 0.0, shares)
    inside = np.flatnonzero((shares > 0) & (shares < ends))
    if 0 < inside.size <= 2:  # to all digits, which a linear programme does not promise
        fixed = shares.copy()
        fixed[inside] = 0.0
        shares[inside] = np.linalg.lstsq(rows[:, inside], target - rows @ fixed, rcond=None)[0]
    error = np.linalg.norm(rows @ shares - target)
    if error > 1e-9 or np.any(shares < 0):
        return masses
    return shares * masses.max()


def _weights(influence: Influence, planes, owner, masses, angles) -> PlacedWeights:
    """The weights that are there, with their places."""
    present = np.flatnonzero(masses > 0)
    owner = owner[present]
    masses = masses[present]
    radii = []
    removed = []
    for number in owner:
        radii.append(planes[number].radius or np.nan)
        removed.append(planes[number].places.removed)
    radius = np.array(radii, float)
    has_radius = np.isfinite(radius)
    mass = masses
    unbalance = np.full(owner.size, np.nan)
    if influence.trial != "kg":
        # in a plane without a radius what is solved for is mass times radius
        mass = np.where(has_radius, masses, np.nan)
        unbalance = masses * np.where(has_radius, radius, 1.0)
    return PlacedWeights(
        plane=owner,
        angle=angles[present],
        mass=mass,
        unbalance=unbalance,
        removed=np.array(removed, bool),
    )


# ------------------------------------------------------------------- weights of a stock
class _Search:
    """Best combinations of the sums of all planes.

    Attributes:
        lowest, picked: the least root of the sum of squares, and the combination of each plane.
        unseen: what the branches that were not looked at may reach, infinite if there are none.
    """

    def __init__(self, influence: Influence, sums: Mapping[int, WeightSums], counts):
        matrix, initial = (np.asarray(x) for x in influence.weighted)
        # The plane with the fewest sums is decided first, so that fewest branches open.
        self.order = sorted(sums, key=lambda number: -sums[number].size)
        self.sums = [sums[number] for number in self.order]
        count = len(self.order)
        q, r = np.linalg.qr(matrix[:, self.order])
        # With fewer readings than planes the triangle lacks rows: zeros, for planes of which the others
        # can undo any choice.
        self.r = np.zeros((count, count), complex)
        self.r[: r.shape[0]] = r
        self.target = np.zeros(count, complex)
        self.target[: r.shape[0]] = -(q.conj().T @ initial)
        # By Pythagoras what no correction reaches stays.
        self.unreachable = max(
            float(np.linalg.norm(initial) ** 2 - np.linalg.norm(self.target) ** 2), 0.0
        )
        # Columns of planes that act alike leave nothing for the later of them but rounding.
        self.negligible = 1e-12 * max(float(np.abs(self.r).max()), 1e-300)
        self.counts = counts
        self.lowest = np.inf
        self.picked = []
        self.unseen = np.inf
        self.points = 0

    def run(self) -> None:
        """Look at all that can be better than the best so far."""
        self._descend(len(self.sums) - 1, self.target, self.unreachable, [], self.counts)

    def _descend(self, level, targets, below, path, free) -> None:
        slope = self.r[level, level]
        steep = abs(slope) > self.negligible
        centre = 0j
        if steep:
            centre = complex(targets[level] / slope)
        sums = self.sums[level]
        self.points += sums.size if sums.paired else _LOOK
        nearest = sums.nearest(centre, free)
        if nearest is None:
            return
        # The nearest sum first: it gives a whole combination early, by which the others are measured.
        self._take(level, targets, below, path, free, nearest)
        if level == 0:
            return
        if not steep and (sums.paired or sums.size > _MOST_ALIKE):
            self.unseen = min(self.unseen, float(np.sqrt(below)))
            return
        # Further from the centre than this, the plane alone adds more than the best so far leaves.
        room = np.sqrt(max(self.lowest**2 - below, 0.0))
        radius = room / abs(slope) if steep else np.inf
        near = sums.within(centre, radius, free)
        for place in range(near.distance.size):
            candidate = sums.candidate(near, place)
            if candidate.picks == nearest.picks:
                continue
            cost = below + abs(slope * (candidate.sum - centre)) ** 2 if steep else below
            if cost >= self.lowest**2 * (1 - 1e-12):
                # The nearest come first; of a plane that acts like others the distance says nothing.
                if steep:
                    break
                continue
            if self.points > _MOST_POINTS:
                self.unseen = min(self.unseen, float(np.sqrt(cost)))
                break
            self._take(level, targets, below, path, free, candidate)

    def _take(self, level, targets, below, above, free, candidate: Candidate) -> None:
        """Decide one plane, and go on to the next."""
        residual = targets[level] - self.r[level, level] * candidate.sum
        cost = below + abs(residual) ** 2
        path = [*above, candidate]
        if level == 0:
            # of combinations that leave the same to rounding the lightest counts
            mass = sum(decided.mass for decided in path)
            size = float(np.sqrt(cost))
            better = size < self.lowest * (1 - 1e-12)
            if better or (size <= self.lowest * (1 + 1e-12) and mass < self._mass()):
                self.lowest = min(size, self.lowest)
                self.picked = path
            return
        # one stock for all planes: what this one takes, the later ones do not have
        remaining = None
        if free is not None:
            remaining = free - self.sums[level].used(candidate.picks)
        further_targets = targets - self.r[:, level] * candidate.sum
        self._descend(level - 1, further_targets, cost, path, remaining)

    def _mass(self) -> float:
        return sum(candidate.mass for candidate in self.picked)

    def combinations(self) -> dict[int, Candidate]:
        """The combination of each plane."""
        return dict(zip(reversed(self.order), self.picked, strict=True))


def _stock_balance(influence: Influence, planes: Mapping[int, _Plane], search: _Search) -> Balance:
    correction = np.zeros(len(influence.planes), complex)
    owner = []
    masses = []
    angles = []
    for number, candidate in search.combinations().items():
        correction[number] = candidate.sum
        choices = search.sums[search.order.index(number)].choices
        for pick in candidate.picks:
            owner.append(number)
            masses.append(choices.mass[pick])
            angles.append(planes[number].places.angles[choices.place[pick]])
    objective = float(np.asarray(influence.size(jnp.asarray(correction))))
    complete = all(sums.complete for sums in search.sums)
    bound = objective
    if not complete or search.unseen < search.lowest:
        # No combination leaves less than weights of any mass in any number.
        free = float(least_squares(influence).objective)
        unseen = search.unseen if complete else 0.0
        bound = max(free, unseen)
    bound = min(bound, objective)
    # by plane, and by angle within it: an angle is below 2 pi
    ranks = []
    for number, angle in zip(owner, angles, strict=True):
        ranks.append(number * 1e3 + angle % (2 * np.pi))
    order = np.argsort(ranks)
    return balance(
        influence,
        jnp.asarray(correction),
        jnp.asarray(objective),
        jnp.asarray(bound),
        "weights of a stock at places, least squares",
        Status.where(bound < objective, Status.not_converged, Status.converged),
        weights=_weights(
            influence,
            planes,
            np.array(owner, int)[order],
            np.array(masses, float)[order],
            np.array(angles, float)[order],
        ),
    )
