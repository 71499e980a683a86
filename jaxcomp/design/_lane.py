r"""One start of a search: what it knows, and what it makes of a solved trial.

Objective f and constraints g are dimensionless: in spreads of their quantities over the sample, g <= 0
or g = 0. Constraints enter by the augmented Lagrangian of Powell, Hestenes and Rockafellar,

$$L = f + \tfrac{1}{2\rho} \sum_j \big(\max(0, \mu_j + \rho g_j)^2 - \mu_j^2\big)$$

(without the maximum for a value to be met), whose multipliers are corrected each time L is stationary
to a tolerance that tightens with the violation (Nocedal and Wright 2006, Numerical Optimization, 2nd
ed., section 17.4).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._goal import Goal, Solved
from ._methods import Method
from ._transform import Ranges

STATUS = ("running", "converged", "no better step", "step limit", "no feasible design")
RUNNING, CONVERGED, STUCK, STEP_LIMIT, INFEASIBLE = range(5)

_PENALTY, _GROWTH, _HIGHEST = 10.0, 5.0, 1e7
# The violation has to fall by this factor from one correction to the next, or the penalty grows.
_FALL = 0.25
# [rad] length of the first step, and the least step of any kind: 1e-7 of a range in its middle.
_FIRST, _LEAST = 0.5, 2e-7
# A search that cannot move is at the optimum as well as the solutions are smooth if its slope is
# below this times the tolerance.
_ROUGH = 1e3


class Lane(eqx.Module):
    """One start; with a leading axis for several.

    Attributes:
        free: [rad] (variables,) the accepted place.
        state: of the method.
        at: what was found there (without the leading axis of `Solved`).
        bounds: (limits,) of the constraints, in the units of their quantities.
        multipliers: (limits,) dimensionless.
        penalty: [-] rho.
        violation: [-] at the last correction of the multipliers.
        gain: [-] on the objective of the method, which makes its first step a moderate one.
        stationarity: [-] largest projected slope of the Lagrangian over the range of a variable.
        steps: solved trials.
        status: place in `STATUS`.
    """

    free: Float[Array, " variables"]
    state: Any
    at: Solved
    bounds: Float[Array, " limits"]
    multipliers: Float[Array, " limits"]
    penalty: Float[Array, ""]
    violation: Float[Array, ""]
    gain: Float[Array, ""]
    stationarity: Float[Array, ""]
    steps: Int[Array, ""]
    status: Int[Array, ""]


class Terms(NamedTuple):
    """What shapes the program of a step.

    Attributes:
        targets: places of the quantities with a target; none for an objective.
        limits: (place, side) of the constraints.
    """

    targets: tuple[int, ...]
    limits: tuple[tuple[int, int], ...]


def terms_of(goal: Goal) -> Terms:
    """The part of a goal that the program of a step depends on."""
    limits = tuple((limit.place, limit.side) for limit in goal.limits)
    return Terms(tuple(i for i, _ in goal.targets), limits)


def new_lanes(method: Method, terms: Terms, free, quantities: int, bounds) -> Lane:
    """Lanes at starts (n, variables), not solved yet, with the bounds (n, limits) of each."""
    rows = len(terms.targets) + len(terms.limits)

    def one(free, bounds):
        number, inf = free.size, jnp.asarray(jnp.inf)
        at = Solved(jnp.zeros(quantities), jnp.asarray(False), jnp.zeros((quantities, number)))
        zero = jnp.asarray(0)
        start = Lane(free, method.begin(free, rows), at, bounds, jnp.zeros(len(terms.limits)),
                     jnp.asarray(_PENALTY), inf, jnp.asarray(1.0), inf, zero, zero)  # fmt: skip
        return start

    return jax.vmap(one)(free, bounds)


@eqx.filter_jit
def trials(method: Method, lanes: Lane, ranges: Ranges) -> Float[Array, "n variables"]:
    """[SI] the designs to solve next, one for each start."""
    return jax.vmap(lambda lane: ranges.inside(method.trial(lane.state)))(lanes)


@eqx.filter_jit
def told(
    method: Method, terms: Terms, lanes: Lane, found: Solved, numbers: "Numbers", ranges: Ranges
) -> Lane:
    """The starts after their trials were solved; those that have ended stay as they are."""
    step = lambda lane, found: _told(method, terms, lane, found, numbers, ranges)  # noqa: E731
    return jax.vmap(step)(lanes, found)


class Numbers(NamedTuple):
    """Scales and tolerances of a search.

    Attributes:
        weight: [-] (quantities,) of each in the objective: +1 or -1 for one of them, without targets.
        scale: (quantities,) spread of each quantity.
        middle: (quantities,) origin of each quantity, against cancellation.
        targets: (targets,) values to meet.
        tolerance: [-] of the slope.
        feasible: [-] of the constraints.
    """

    weight: Float[Array, " quantities"]
    scale: Float[Array, " quantities"]
    middle: Float[Array, " quantities"]
    targets: Float[Array, " targets"]
    tolerance: Float[Array, ""]
    feasible: Float[Array, ""]


def _parts(terms: Terms, numbers: Numbers, bounds, values):
    """Objective (or residuals, with targets) and constraints, dimensionless."""
    shown = values / numbers.scale
    if terms.targets:
        places = np.array(terms.targets)
        main = shown[places] - numbers.targets / numbers.scale[places]
    else:
        main = numbers.weight @ ((values - numbers.middle) / numbers.scale)
    sides = [
        (side or 1) * (shown[i] - bounds[row] / numbers.scale[i])
        for row, (i, side) in enumerate(terms.limits)
    ]
    return main, jnp.stack(sides) if sides else jnp.zeros(0)


def _pressed(terms: Terms, multipliers, penalty, limits) -> Array:
    """mu + rho g, kept above zero for inequalities: the multipliers as corrected here."""
    free = np.array([side == 0 for _, side in terms.limits], bool)
    pressed = multipliers + penalty * limits
    return jnp.asarray(jnp.where(free, pressed, jnp.maximum(pressed, 0.0)))


def _goal(method: Method, terms: Terms, numbers, ranges, lane: Lane, found: Solved, trial):
    """The Lagrangian (or its residuals) around a solved trial, infinite if that failed."""
    zeroed = lambda a: jnp.where(found.ok, a, 0.0)  # noqa: E731
    values, slope, place = zeroed(found.values), zeroed(found.slope), ranges.inside(trial)

    def goal(free):
        near = values + slope @ (ranges.inside(free) - place)
        main, limits = _parts(terms, numbers, lane.bounds, near)
        pressed = _pressed(terms, lane.multipliers, lane.penalty, limits)
        rows = pressed / jnp.sqrt(lane.penalty)
        if method.squares:
            rows = jnp.concatenate([jnp.atleast_1d(main), rows])
            return jnp.where(found.ok, rows, jnp.inf)
        main = jnp.sum(main**2) / 2 if terms.targets else main
        return jnp.where(found.ok, lane.gain * (main + jnp.sum(rows**2) / 2), jnp.inf)

    return goal


def _moderate(method: Method, terms, numbers, ranges, lane: Lane, found: Solved, trial):
    """The lane with the gain that makes a steepest descent from here move by `_FIRST` at most."""
    if method.squares:
        return lane
    lane = eqx.tree_at(lambda l: l.gain, lane, jnp.asarray(1.0))
    slope = jax.grad(_goal(method, terms, numbers, ranges, lane, found, trial))(trial)
    gain = jnp.minimum(1.0, _FIRST / jnp.maximum(jnp.max(jnp.abs(slope)), 1e-300))
    return eqx.tree_at(lambda l: l.gain, lane, gain)


def _told(method: Method, terms: Terms, lane: Lane, found: Solved, numbers, ranges) -> Lane:
    first, trial = lane.steps == 0, method.trial(lane.state)
    moderate = _moderate(method, terms, numbers, ranges, lane, found, trial)
    lane = _where(first, moderate, lane)
    free, state = method.tell(
        lane.free, lane.state, _goal(method, terms, numbers, ranges, lane, found, trial)
    )
    accepted = found.ok & (first | jnp.all(free == trial))
    at = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), found, lane.at)
    new = eqx.tree_at(
        lambda l: (l.free, l.state, l.at, l.steps), lane, (free, state, at, lane.steps + 1)
    )
    new = _judged(method, terms, new, numbers, ranges)
    # A start that fails was chosen by the user: there is no place to go back to.
    new = eqx.tree_at(lambda l: l.status, new, jnp.where(first & ~found.ok, INFEASIBLE, new.status))
    return _where(lane.status == RUNNING, new, lane)


def _judged(method: Method, terms: Terms, lane: Lane, numbers: Numbers, ranges: Ranges) -> Lane:
    """Whether the lane has ended; if the Lagrangian is stationary, with corrected multipliers."""
    main, limits = _parts(terms, numbers, lane.bounds, lane.at.values)
    pressed = _pressed(terms, lane.multipliers, lane.penalty, limits)
    weight = numbers.weight
    if terms.targets:
        weight = jnp.zeros_like(weight).at[np.array(terms.targets)].add(main)
    for row, (i, side) in enumerate(terms.limits):
        weight = weight.at[i].add((side or 1) * pressed[row])
    slope = (weight / numbers.scale) @ lane.at.slope * ranges.width
    share = (1 + jnp.sin(lane.free)) / 2
    stationarity = jnp.max(jnp.abs(share - jnp.clip(share - slope, 0.0, 1.0)))
    ahead = method.trial(lane.state)
    stands = jnp.max(jnp.abs(ahead - lane.free)) < _LEAST
    # complementarity and violation in one: a slack constraint whose multiplier is zero counts nothing
    change = jnp.abs(pressed - lane.multipliers) / lane.penalty
    violation = jnp.max(change, initial=0.0)
    flat = stationarity <= numbers.tolerance
    ended = jnp.where(
        flat | (stands & (stationarity <= _ROUGH * numbers.tolerance)), CONVERGED, STUCK
    )
    lane = eqx.tree_at(lambda l: l.stationarity, lane, stationarity)
    if not terms.limits:
        status = jnp.where(flat | stands, ended, RUNNING)
        return eqx.tree_at(lambda l: l.status, lane, status)

    kept = violation <= numbers.feasible
    status = jnp.where(kept & (flat | stands), ended, RUNNING)
    hopeless = (lane.penalty >= _HIGHEST) & ~kept
    enough = jnp.maximum(numbers.tolerance, jnp.clip(0.1 * violation, 0.0, 0.1))
    correct = (status == RUNNING) & (stands | (stationarity <= enough))
    status = jnp.where(correct & hopeless, INFEASIBLE, status)
    grown = jnp.where(violation > _FALL * lane.violation, _GROWTH * lane.penalty, lane.penalty)
    # The multipliers as corrected here belong to the slope above, so the result carries them.
    multipliers = jnp.where(correct | (status != RUNNING), pressed, lane.multipliers)
    begun = method.again(lane.free, lane.state)
    fresh = eqx.tree_at(
        lambda l: (l.multipliers, l.penalty, l.violation, l.state),
        lane,
        (pressed, grown, violation, begun),
    )
    # The new Lagrangian is known at the place of the old one: that costs no solution.
    goal = _goal(method, terms, numbers, ranges, fresh, lane.at, lane.free)
    fresh = eqx.tree_at(lambda l: l.state, fresh, method.tell(lane.free, begun, goal)[1])
    out = _where(correct & (status == RUNNING), fresh, lane)
    return eqx.tree_at(lambda l: (l.status, l.multipliers), out, (status, multipliers))


def _where(condition: Bool[Array, ""], new, old):
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b) if eqx.is_array(a) else a, new, old)
