"""Changes of side in mid-stroke: where they are, and panel edges that go with them.

Where a load changes its side the losses have a kink, and where it comes close to zero its magnitude
turns within a very short angle. Either place depends on the motion, so it is found on a first
solution and moves with the last one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from .._implicit import settle
from ..compressor import Compressor, kink_angles, loads_at
from ..friction import JointLoads
from ..mechanism import CrankState
from ._passes import (
    ENERGY_FLOOR,
    Motion,
    Turn,
    better_motion,
    initial_motion,
    lay_turn,
    transfer,
    turn_edges,
)


class Resolution(eqx.Module):
    """How finely a turn is cut.

    Attributes:
        nodes: Gauss nodes on every panel.
        kinks: how many kinks, and how many pinches, may become panel edges.
        grading: how often the panels beside a pinch are cut again, towards it.
        max_passes: passes allowed to each solution.
    """

    nodes: int = eqx.field(static=True)
    kinks: int = eqx.field(static=True)
    grading: int = eqx.field(static=True)
    max_passes: int = eqx.field(static=True)


def lay_with_changes(compressor: Compressor, edges, inner, resolution: Resolution) -> Turn:
    """Panels between the edges of the turn and the places of the changes."""
    return lay_turn(compressor, _merge(edges, _graded(inner, resolution)), resolution.nodes)


class _Brackets(eqx.Module):
    """Where changes of side were seen: the first kinks, then pinches."""

    low: Float[Array, " k"]
    high: Float[Array, " k"]
    row: Int[Array, " k"]  # which quantity changes; -1 for a place not used


class Changes(eqx.Module):
    """Changes of side, each with the slope of the quantity that changes."""

    angle: Float[Array, " k"]
    slope: Float[Array, " k"]
    row: Int[Array, " k"]


def place_changes(compressor: Compressor, resolution: Resolution) -> tuple[Changes, Turn, Motion]:
    """The changes of side, with the motion that placed them.

    All rounds have the same shapes, so that they compile once.
    """
    edges = turn_edges(kink_angles(compressor))
    unused = jnp.full(2 * resolution.kinks, edges[0])
    nowhere = _Brackets(unused, unused, jnp.full(2 * resolution.kinks, -1))

    def lay(inner):
        return lay_with_changes(compressor, edges, inner, resolution)

    def place(round_, carry):
        changes, turn, motion, brackets = carry
        new = lay(changes.angle)
        motion = transfer(turn, motion, new)
        motion, _ = settle(
            lambda m: better_motion(compressor, new, m), motion, 1e-7, resolution.max_passes
        )
        brackets = lax.cond(
            round_ == 0,
            lambda: _find_changes(compressor, new, motion, resolution.kinks),
            lambda: brackets,
        )
        return _bisect(compressor, new, motion, brackets), new, motion, brackets

    base = lay(unused)
    none = Changes(unused, jnp.ones_like(unused), nowhere.row)
    changes, turn, motion, _ = lax.fori_loop(
        0, 2, place, (none, base, initial_motion(base), nowhere)
    )
    return changes, turn, motion


def changes_of(compressor: Compressor, turn: Turn, motion: Motion, kinks: int) -> Changes:
    """The changes of side of a motion that is known."""
    return _bisect(compressor, turn, motion, _find_changes(compressor, turn, motion, kinks))


def _loads_between(compressor: Compressor, turn: Turn, motion: Motion, angle) -> JointLoads:
    energy, acceleration = turn.grid.interpolate((motion.energy, motion.acceleration), angle)
    inertia, _ = compressor.mechanism.inertia(angle)
    speed = jnp.sqrt(2 * jnp.maximum(energy, ENERGY_FLOOR) * turn.energy_scale / inertia)
    state = CrankState(angle, speed, acceleration * turn.speed_scale**2)
    return loads_at(compressor, state, evidence=False)


def _find_changes(compressor, turn: Turn, motion: Motion, count: int) -> _Brackets:
    """The first `count` changes of side of kinks, and as many of pinches, inside the panels."""
    grid = turn.grid
    x = jnp.concatenate([jnp.array([1e-3]), jnp.asarray(grid.rule.nodes), jnp.array([1 - 1e-3])])
    angle = grid.edges[:-1, None] + grid.width[:, None] * x
    loads = _loads_between(compressor, turn, motion, angle)
    found, kinds = [], (loads.kinks, loads.pinches)
    for first_row, values in zip((0, loads.kinks.shape[0]), kinds, strict=True):
        sides = jnp.sign(values)
        changes = (sides[..., 1:] * sides[..., :-1] < 0) & (grid.width[:, None] > 1e-9)
        row, panel, left = jnp.nonzero(changes, size=count, fill_value=-1)
        # an unused place goes to the first edge, where it makes a panel of no width
        low = jnp.where(row >= 0, angle[panel, left], grid.edges[0])
        high = jnp.where(row >= 0, angle[panel, left + 1], grid.edges[0])
        found.append(_Brackets(low, high, jnp.where(row >= 0, row + first_row, -1)))
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)


def change_values(compressor, turn: Turn, motion: Motion, row, angle):
    """The quantity of each row at its angle, of shape (..., k)."""
    loads = _loads_between(compressor, turn, motion, angle)
    every = jnp.concatenate([loads.kinks, loads.pinches])
    row = jnp.broadcast_to(jnp.maximum(row, 0), angle.shape)
    return jnp.take_along_axis(every, row[None], axis=0)[0]


def _bisect(compressor, turn: Turn, motion: Motion, brackets: _Brackets) -> Changes:
    """Place the changes. The brackets are widened, since a better motion moves them a little."""
    room = 0.3 * (brackets.high - brackets.low)

    def value(angle):
        return change_values(compressor, turn, motion, brackets.row, angle)

    def halve(_, ends):
        low, high, at_low, at_high = ends
        middle = 0.5 * (low + high)
        here = value(middle)
        left_side = here * at_low > 0
        return (
            jnp.where(left_side, middle, low),
            jnp.where(left_side, high, middle),
            jnp.where(left_side, here, at_low),
            jnp.where(left_side, at_high, here),
        )

    low, high = brackets.low - room, brackets.high + room
    # 16 halvings of a bracket of 0.1 rad leave 1e-6 rad; the final passes polish with the slope
    start = (low, high, *value(jnp.stack([low, high])))
    low, high, at_low, at_high = lax.fori_loop(0, 16, halve, start)
    used = brackets.row >= 0
    rise, width = at_high - at_low, high - low
    steep = used & (rise != 0) & (width > 0)
    near = rise / jnp.where(steep, width, 1.0)
    angle = low - jnp.where(steep, at_low / jnp.where(steep, near, 1.0), low - turn.grid.edges[0])
    # The halvings may end on an edge of the panels, where the motion jumps by its own error: the slope
    # there is that of the jump. A wider span tells the slope of the quantity.
    span = 0.1 * (brackets.high - brackets.low)
    before, after = value(jnp.stack([angle - span, angle + span]))
    wide = (after - before) / jnp.where(steep, 2 * span, 1.0)
    slope = jnp.where(jnp.sign(wide) == jnp.sign(near), wide, near)
    slope = jnp.where(steep, slope, 1.0)
    return Changes(angle, slope, jnp.where(steep, brackets.row, -1))


def _graded(inner, resolution: Resolution):
    """Inner edges with the panels beside the pinches cut in geometric progression."""
    kinks, pinches = jnp.split(inner, 2)
    distance = 0.1 * 0.15 ** jnp.arange(resolution.grading)
    around = jnp.concatenate([-distance, distance, jnp.zeros(1)])
    return jnp.concatenate([kinks, (pinches[:, None] + around).ravel()])


def _merge(edges, inner):
    return jnp.sort(jnp.concatenate([edges, jnp.clip(inner, edges[0], edges[-1])]))
