"""Locate load reversals within a stroke and place panel edges there.

Where a load reverses the losses have a kink, and where a load comes close to zero its magnitude turns
within a very short angle. Either place depends on the motion, so it is found on a first solution and
moves with the last one.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import clip, max_of, maximum, min_of, minimum
from .._core.lookup import row_and_column
from .._core.roots import AbstractFixedPoint, FixedPointReport, frozen, settle
from ._iteration import (
    PLACE_UNIT,
    Motion,
    OrbitParameters,
    Resolution,
    Reversals,
    improve,
    initial_motion,
    revolution,
    rounding_of,
)
from ._panels import NO_WIDTH, Panels

# Change at which the first solutions, which only place the reversals, are good enough.
_PLACING = 1e-5
# The same of the second where the places stay in the last.
_HELD = 1e-8
# Solutions one after the other, each with the places of the one before.
_ROUNDS = 3
# Halvings of a bracket: of 0.1 rad they leave 1e-6 rad, which the iterations polish with the slope.
_HALVINGS = 16
# Sign changes of one quantity that are looked at.
_OF_ONE = 12
# [rad] What keeps a place off a kink that is known; over less no slope is told, since the errors of the
# panels' ends count there.
_ASIDE = 1e-7
# [-] Least share of a slope that is taken from what two iterations tell. One of the half, which was the
# motion's doing, had a place go to and fro by 0.97, below the shift that tells the slope anew, in one of
# a million designs; where it is true, a place still comes closer by 0.2.
_SHALLOWEST = 0.6
# [rad] Shift of a place from which two iterations tell the slope there.
_FAR = 1e-11


class _Brackets(NamedTuple):
    """Where sign changes were seen: kinks, then near-zero loads."""

    low: Float[Array, " k"]
    high: Float[Array, " k"]
    lowest: Float[Array, " k"]  # where a better motion may still have them
    highest: Float[Array, " k"]
    row: Int[Array, " k"]  # which quantity changes; -1 for a place not used


# Unknowns of an orbit, with the load reversals at which its panels end, and how its search ended.
CrankSolution = tuple[Motion, tuple[Reversals, FixedPointReport]]


class OrbitProblem(AbstractFixedPoint):
    """The periodic motion as a fixed point, on panels that end at the load reversals."""

    resolution: Resolution  # of the panels
    # how many of the quantities that mark reversals are kinks; the others belong to loads that come
    # close to zero
    kinks: int = eqx.field(static=True)
    tolerance: float | Float[Array, ""]
    max_iterations: int = eqx.field(static=True)
    # whether places follow the motion in the last iterations; those of derivatives they follow always
    follow: bool = eqx.field(static=True, default=True)
    # the solution where it has been found: derivatives want its equations, and no second search
    solution: CrankSolution | None = None

    def step(self, parameters: OrbitParameters, data, unknowns: Motion) -> Motion:
        reversals, _ = data
        return improve(parameters, self.resolution, reversals, unknowns)[0]

    def solve(self, parameters: OrbitParameters) -> CrankSolution:
        """Solve on panels between the known kinks, place the reversals, solve and place again.

        Then solve with places that follow the motion, or stay. All rounds share one iteration.
        """
        if self.solution is not None:
            return frozen(self.solution)
        constants = frozen(parameters)
        motion = initial_motion(constants, self.resolution)
        places = motion.places
        # none is in use; the motion is the final one if there are no places
        final = jnp.asarray(not places.size)
        unused = jnp.full(places.shape, -1)
        reversals = Reversals(unused, jnp.ones_like(places), places, places, final)
        if not places.size:
            return self._on_known_panels(constants, reversals, motion)

        def round_(index, carry):
            motion, reversals, brackets, _ = carry
            is_last = index == _ROUNDS - 1
            if self.follow:
                reversals = eqx.tree_at(lambda r: r.moving, reversals, is_last)
            placing = _PLACING
            if not self.follow:
                placing = jnp.where(index == 0, _PLACING, _HELD)
            tolerance = jnp.where(is_last, self.tolerance, placing)
            motion, marks, reversals, report = self._iterated(
                constants, reversals, motion, tolerance
            )
            motion, reversals, brackets = lax.cond(
                is_last,
                lambda: (motion, reversals, brackets),
                lambda: self._place(constants, motion, marks, brackets, index == 0),
            )
            return motion, reversals, brackets, report

        nowhere = _Brackets(places, places, places, places, reversals.row)
        report = FixedPointReport(jnp.asarray(0), jnp.ones(()), jnp.asarray(False))
        motion, reversals, _, report = lax.fori_loop(
            0, _ROUNDS, round_, (motion, reversals, nowhere, report)
        )
        return motion, (reversals, report)

    def _on_known_panels(self, parameters: OrbitParameters, reversals: Reversals, motion: Motion):
        """The solution without places of reversals."""
        # panels that stay where they are need not be cut in every iteration
        cut = revolution(parameters, self.resolution, motion.places)

        def step(motion, _):
            return improve(parameters, self.resolution, reversals, motion, cut)[0], None

        limits = self.tolerance, self.max_iterations, rounding_of(parameters)
        motion, _, report = settle(step, motion, None, *limits)
        return motion, (reversals, report)

    def _iterated(
        self, parameters: OrbitParameters, reversals: Reversals, motion: Motion, tolerance
    ):
        """One round: the motion, what marks reversals at its nodes, reversals and report."""
        cut = None
        if not self.follow:
            # as above, places that stay in a round
            cut = revolution(parameters, self.resolution, motion.places)

        def step(motion, auxiliary):
            _, reversals, before = auxiliary
            better, marks, value = improve(parameters, self.resolution, reversals, motion, cut)
            at_places = motion.places, value
            if self.follow:
                reversals = _by_secant(reversals, before, at_places)
            return better, (marks, reversals, at_places)

        _, marks, _ = eqx.filter_eval_shape(improve, parameters, self.resolution, reversals, motion)
        unknown = jnp.full_like(motion.places, jnp.nan)
        auxiliary = jnp.zeros(marks.shape, marks.dtype), reversals, (unknown, unknown)
        limits = tolerance, self.max_iterations, rounding_of(parameters)
        motion, (marks, reversals, _), report = settle(step, motion, auxiliary, *limits)
        return motion, marks, reversals, report

    def _place(self, parameters, motion: Motion, marks, brackets: _Brackets, first):
        """Place the reversals of a motion, with the motion on the new panels."""
        grid = self.resolution.panels_between(parameters.edges, motion.places)
        located = self._brackets_of(grid, marks)
        brackets = jax.tree.map(lambda a, b: jnp.where(first, a, b), located, brackets)
        places, reversals = _bisect(grid, parameters.edges, marks, brackets)
        reversals = eqx.tree_at(lambda r: r.moving, reversals, jnp.asarray(not self.follow))
        new = self.resolution.panels_between(parameters.edges, places)
        angle = clip(new.angle, grid.edges[0], grid.edges[-1])
        count = new.angle.size
        joints = motion.joints[..., :count].reshape(-1, *new.angle.shape)
        angle = jnp.concatenate([angle.ravel(), clip(places, grid.edges[0], grid.edges[-1])])
        values = jnp.concatenate([jnp.stack([motion.energy, motion.acceleration]), joints])
        energy, acceleration, *joints = grid.interpolate(values, angle)
        journals = motion.journals
        if journals is not None:
            journals = grid.interpolate(journals, new.angle)
        moved = Motion(
            energy[:count].reshape(new.angle.shape),
            acceleration[:count].reshape(new.angle.shape),
            motion.first_energy,
            jnp.stack(joints),
            places / PLACE_UNIT,
            journals,
        )
        return moved, reversals, brackets

    def _brackets_of(self, grid: Panels, marks: Float[Array, "q p s"]) -> _Brackets:
        """Sign changes inside the panels: the first of the kinks, the sharpest near-zero loads."""
        ends = np.array([1e-3, 1 - 1e-3])
        x = np.concatenate([ends[:1], grid.rule.nodes, ends[1:]])
        angle = grid.edges[:-1, None] + grid.width[:, None] * x
        at_ends = marks @ grid.rule.through(ends).T
        values = jnp.concatenate([at_ends[..., :1], marks, at_ends[..., 1:]], axis=-1)
        changes = (values[..., 1:] * values[..., :-1] < 0) & (grid.width[:, None] > NO_WIDTH)
        count = self.resolution.reversals
        loads = (marks.shape[0] - self.kinks) // 2
        along = slice(self.kinks, self.kinks + loads)
        # The magnitude turns within an angle of the load that is left over the rate of the other.
        rate = jnp.abs(jnp.diff(values[along], axis=-1)) / jnp.diff(angle)
        width = jnp.abs(values[self.kinks + loads :, :, :-1]) / (rate + 1e-300)
        # Of the kinks the first, by their order in the rows: each is a real edge. Of the near-zero loads
        # the sharpest, since only these bend within less than a panel.
        order = jnp.arange(changes[: self.kinks].size, dtype=width.dtype)
        rank = jnp.concatenate([order.reshape(changes[: self.kinks].shape), width])
        of_each_kind = []
        for begin, end in ((0, self.kinks), (self.kinks, self.kinks + loads)):
            shape = rank[begin:end].shape
            flags = changes[begin:end].reshape(shape[0], shape[1] * shape[2])
            index = _first_of_each(flags, min(count, _OF_ONE))
            score = rank[begin:end].ravel().at[index].get(mode="fill", fill_value=jnp.inf)
            score = jnp.concatenate([score, jnp.full(count, jnp.inf)])
            best, order = lax.top_k(-score, count)
            index = jnp.concatenate([index, jnp.zeros(count, int)])[order]
            used = best > -jnp.inf
            row, of_row = row_and_column(jnp.where(used, index, 0), shape[1] * shape[2])
            panel, sample = row_and_column(of_row, shape[2])
            # an unused place goes to the first edge, where it makes a panel of no width
            low = jnp.where(used, angle[panel, sample], grid.edges[0])
            high = jnp.where(used, angle[panel, sample + 1], grid.edges[0])
            # beyond a kink another reversal may lie
            room = 0.3 * (high - low)
            lowest = maximum(low - room, grid.edges[panel])
            highest = minimum(high + room, grid.edges[panel + 1])
            row = jnp.where(used, row + begin, -1).astype(int)
            of_each_kind.append(_Brackets(low, high, lowest, highest, row))
        return jax.tree.map(lambda *parts: jnp.concatenate(parts), *of_each_kind)


def _first_of_each(flags: Bool[Array, "q n"], count: int) -> Int[Array, " m"]:
    """Flat indices of the first few flags of every row; beyond the array where there are no more.

    To sort all takes longer than an iteration.
    """
    size = flags.shape[1]
    places = jnp.where(flags, jnp.arange(size), size)

    def after(previous, _):
        next_ = min_of(jnp.where(places > previous[:, None], places, size), axis=1)
        return next_, next_

    start = jnp.full(flags.shape[0], -1, places.dtype)
    _, columns = lax.scan(after, start, length=count)
    rows = size * jnp.arange(flags.shape[0])
    return jnp.where(columns < size, rows + columns, flags.size).T.ravel()


def _by_secant(reversals: Reversals, before, after) -> Reversals:
    """Reversals with the slopes that two iterations, (places, values) each, tell of.

    Those of `_bisect` belong to polynomials across a kink or beside it: a place followed by them comes
    closer by 0.1 to 0.25 only in an iteration.
    """
    moved, change = (new - old for new, old in zip(after, before, strict=True))
    far = jnp.abs(moved) > _FAR
    share = change / jnp.where(far, moved, 1.0) / reversals.slope
    # the motion, too, moves the value: a slope of another size is its doing
    plausible = far & (share > 0.5) & (share < 2.0)
    slope = jnp.where(plausible, maximum(share, _SHALLOWEST), 1.0) * reversals.slope
    return eqx.tree_at(lambda r: r.slope, reversals, slope)


def _bisect(
    grid: Panels,
    known_edges: Float[Array, " e"],
    marks: Float[Array, "q p s"],
    brackets: _Brackets,
):
    """Places of the reversals and what else is known of them, by the polynomials of what marks them.

    A better motion moves them a little: a bracket that has lost its reversal is widened.

    Args:
        grid: panels of the motion.
        known_edges: [rad] those of them that are kinks whatever the motion.
        marks: what marks the reversals, at the nodes of the panels.
        brackets: where the reversals were seen.
    """
    marks_in_row = jnp.take(marks, maximum(brackets.row, 0), axis=0)

    @jax.jit
    def value(angle):
        panel = grid.panel_of(angle)
        width = grid.width[panel]
        x = (angle - grid.edges[panel]) / jnp.where(width > 0, width, 1.0)
        values = marks_in_row[jnp.arange(marks_in_row.shape[0]), panel]
        return jnp.sum(values * grid.rule.weights_at(x), axis=-1)

    def halve(_, ends):
        low, high, at_low, at_high = ends
        middle = 0.5 * (low + high)
        at_middle = value(middle)
        left_side = at_middle * at_low > 0
        return (
            jnp.where(left_side, middle, low),
            jnp.where(left_side, high, middle),
            jnp.where(left_side, at_middle, at_low),
            jnp.where(left_side, at_high, at_middle),
        )

    ends = jnp.stack([brackets.low, brackets.high])
    lost = jnp.prod(value(ends), axis=0) > 0
    ends = jnp.where(lost, jnp.stack([brackets.lowest, brackets.highest]), ends)
    start = (*ends, *value(ends))
    low, high, at_low, at_high = lax.fori_loop(0, _HALVINGS, halve, start)
    rise = at_high - at_low
    width = high - low
    # a reversal that a better motion has lost, because it ran into a kink, is not used
    steep = (brackets.row >= 0) & (rise != 0) & (width > 0) & (at_low * at_high <= 0)
    near = rise / jnp.where(steep, width, 1.0)
    places = low - jnp.where(steep, at_low / jnp.where(steep, near, 1.0), low - grid.edges[0])
    # The halvings may end on an edge of the panels, where the polynomials jump by their own error: the
    # slope there is that of the jump. A wider span tells the slope of the quantity; to the right, since
    # it is evaluated there, and two reversals at one place make it turn. Not beyond a known kink: with
    # the slope behind the end of the re-expansion, a twentieth of that before it, a reversal just
    # before it hopped to and fro.
    ahead = known_edges - places[:, None]
    before = places + max_of(jnp.where(ahead <= 0, ahead, -jnp.pi), axis=1) + _ASIDE
    behind = places + min_of(jnp.where(ahead > 0, ahead, jnp.pi), axis=1) - _ASIDE
    span = minimum(0.1 * (brackets.high - brackets.low), behind - places)
    at_near_end, at_far_end = value(jnp.stack([places + 0.1 * span, places + span]))
    roomy = steep & (span > _ASIDE)
    wide = (at_far_end - at_near_end) / jnp.where(roomy, 0.9 * span, 1.0)
    slope = jnp.where(roomy & (jnp.sign(wide) == jnp.sign(near)), wide, near)
    slope = jnp.where(steep, slope, 1.0)
    row = jnp.where(steep, brackets.row, -1)
    places = jnp.where(steep, clip(places, before, behind), places)
    return places, Reversals(row, slope, before, behind, jnp.asarray(False))
