"""A revolution on panels between the events of its valves: how they are laid, what is read off them.

The equations that their unknowns solve are those of `_cycle_collocation`.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import legendre

from .._core.extremes import clip, max_of, maximum, min_of, minimum
from .._core.fields import ANY, NONNEGATIVE, quantity
from .._core.lookup import interval_of, row_and_column
from .._core.polynomials import cubic_step, gauss, legendre_columns
from ..gas import AbstractGas
from ._cylinder import Case
from ._gas_balance import FREE
from ._march import BEND, Record, within_steps
from ._revolutions import START, TURN

# Mass, temperature and both lifts among the states of a cylinder. Velocities are left out: they are
# slopes of the lifts, with scales that say little of the flow.
RESOLVED = (0, 1, 2, 5)


class Mesh(NamedTuple):
    """Branches and events of p panels."""

    flags: Int[Array, "p f"]  # branches, six of each cylinder
    event: Int[Array, " p"]  # at the end, -1 for none
    code: Int[Array, " p"]  # of the jump there
    fits: Bool[Array, ""]  # whether there are enough panels for the events


class Unknowns(NamedTuple):
    """A revolution on panels."""

    # states at the s Gauss nodes and at the end, before anything jumps there
    points: Float[Array, "p s+1 n"]
    left: Float[Array, "p n"]  # at the beginnings
    edges: Float[Array, " p+1"]  # [rad]; those without an event do not move


def is_edge(record: Record) -> Bool[Array, " n"]:
    """Whether a panel has to end where a step of a march does: at an event or a given angle."""
    return (record.event >= 0) | (record.event == BEND)


class Layout(NamedTuple):
    """Panels as they are laid after a march.

    Attributes:
        mesh: their branches and events.
        unknowns: the march on them.
        kink_distance: [rad] largest of a kink of the rates from the nearest edge.
    """

    mesh: Mesh
    unknowns: Unknowns
    kink_distance: Float[Array, ""]


def lay_mesh(record: Record, panels: int, nodes: int, kinks: Callable | None = None) -> Layout:
    """Panels after the steps of a march: at least one between events, more where steps are many.

    Given angles are edges as well, but no events: they do not move.

    Args:
        record: of a revolution.
        panels: how many.
        nodes: Gauss nodes on each.
        kinks: (k,) functions of angle, state and branches at whose zeros the rates have a kink, which
            are edges where any is free; none if absent.
    """
    used = jnp.isfinite(record.angle)
    happens = used & is_edge(record)
    interval = jnp.cumsum(happens) - happens  # of every step
    count = jnp.sum(happens) + 1
    steps = jnp.zeros(panels).at[jnp.where(used, interval, panels)].add(1.0, mode="drop")
    exists = jnp.arange(panels) < count

    # spare panels go one by one to the interval of which each panel holds most steps: where the
    # march took short steps the solution bends most
    def add(_, share):
        # an interval of no width wants none
        return share.at[jnp.argmax(jnp.where(exists, steps / share, -1.0))].add(1)

    spare = panels - minimum(count, panels)
    share = lax.fori_loop(0, spare, add, jnp.ones(panels, int))
    share = jnp.where(exists, share, 0)

    panel = jnp.arange(panels)
    ends = jnp.cumsum(share)
    of = clip(jnp.searchsorted(ends, panel, side="right"), 0, panels - 1)
    within = panel - (ends - share)[of]
    first_row = (jnp.cumsum(steps) - steps)[of]
    # edges between events stand by number of step, not by angle, so that they gather where the
    # steps are short
    place = first_row + steps[of] * within / share[of]
    row = clip(place.astype(int), 0, record.angle.size - 1)
    edges = record.angle[row] + (place - row) * record.width[row]
    edges = jnp.concatenate([edges, jnp.asarray([START + TURN])])
    last_row = clip((first_row + steps[of] - 1).astype(int), 0, record.angle.size - 1)
    ends_interval = within == share[of] - 1
    event = jnp.where(ends_interval, maximum(record.event[last_row], -1), -1)
    code = jnp.where(event >= 0, record.code[last_row], 0)
    mesh = Mesh(record.flags[first_row.astype(int)], event, code, count <= panels)

    at = partial(within_steps, record)
    kink_distance = jnp.zeros(())
    if kinks is not None:
        is_free = ~ends_interval[:-1]
        at_kinks, kink_distance = _with_kinks(kinks, at, edges, mesh.flags, is_free, nodes)
        # an edge that has moved stands within another step
        moved_row = jnp.searchsorted(record.angle, at_kinks[:-1], side="right") - 1
        row = jnp.where(at_kinks[:-1] == edges[:-1], row, moved_row)
        edges = at_kinks
    # the last point's row is the panel's own: rows of no width share an angle
    angle, _ = point_angles(edges, nodes)
    points = jax.vmap(jax.vmap(at))(angle)
    # the state before the jump: at the angle of an event the cubic of the next step has jumped
    ended = jnp.where(ends_interval[:, None], record.end[last_row], points[:, -1])
    unknowns = Unknowns(points.at[:, -1].set(ended), jax.vmap(at)(edges[:-1], row), edges)
    return Layout(mesh, unknowns, kink_distance)


def _with_kinks(
    kinks: Callable, at: Callable, edges, flags, is_free: Bool[Array, " p-1"], nodes: int
) -> tuple[Float[Array, " p+1"], Float[Array, ""]]:
    """Edges of which free ones stand at the kinks of the rates next to them.

    An edge at a kink need not move with it: what a panel misses of a kink that enters it grows with the
    square of the way. Within a panel a kink costs an error of the panel's width squared.

    Args:
        kinks: as `lay_mesh` takes them.
        at: the marched state at an angle.
        edges: [rad] (p + 1,)
        flags: (p, f) branches of the panels.
        is_free: whether each inner edge is neither an event nor a given angle.
        nodes: Gauss nodes on each panel.

    Returns:
        The edges [rad], and the largest distance [rad] of a kink from the nearest of them: without any
        free edge next to it, or with another kink on its panel, a kink stays within.
    """
    angle, width = point_angles(edges, nodes)
    angle = jnp.concatenate([edges[:-1, None], angle], axis=1)

    def along(angles, flags):
        return jax.vmap(lambda angle: kinks(angle, at(angle), flags))(angles)

    values: Array = jax.vmap(along)(angle, flags)
    before = values[:, :-1]
    after = values[:, 1:]
    crosses = (before > 0) != (after > 0)
    # by the straight line between two points, as an edge near the kink is enough
    share = before / jnp.where(crosses, before - after, 1.0)
    gaps = jnp.diff(angle, axis=1)[..., None]
    places = jnp.where(crosses, angle[:, :-1, None] + share * gaps, jnp.inf)
    place = min_of(places.reshape(edges.size - 1, -1), axis=1)  # the first of a panel

    is_inside = jnp.isfinite(place) & (width > 1e-7)
    nearer_left = place - edges[:-1] < 0.5 * width
    left_is_free = jnp.concatenate([jnp.zeros(1, bool), is_free])
    right_is_free = jnp.concatenate([is_free, jnp.zeros(1, bool)])
    takes_left = is_inside & left_is_free & (nearer_left | ~right_is_free)
    takes_right = is_inside & right_is_free & ~takes_left
    # where both panels beside an edge want it, the one before it has it; the other kink stays
    # within its panel, which the distance tells
    inner = jnp.where(takes_left[1:], place[1:], edges[1:-1])
    inner = jnp.where(takes_right[:-1], place[:-1], inner)
    moved_edges = edges.at[1:-1].set(inner)

    places = places.ravel()
    after = clip(jnp.searchsorted(moved_edges, places), 1, edges.size - 1)
    distance = minimum(places - moved_edges[after - 1], moved_edges[after] - places)
    return moved_edges, max_of(jnp.where(jnp.isfinite(places), jnp.abs(distance), 0.0))


def point_angles(edges, nodes: int):
    """Angles [rad] of the Gauss nodes and the end (p, s + 1), and widths [rad] of the panels (p,)."""
    width = jnp.diff(edges)
    places = np.append(gauss(nodes).nodes, 1.0)
    return edges[:-1, None] + width[:, None] * places, width


def at_points(function, mesh: Mesh, z: Unknowns):
    """A function of angle, state and branches at all points of all panels.

    The points of all panels are one axis: a second axis would have each operation traced twice.
    """
    angle, _ = point_angles(z.edges, z.points.shape[1] - 1)
    flags = jnp.repeat(mesh.flags, angle.shape[1], axis=0)
    states = z.points.reshape(angle.size, -1)
    values = jax.vmap(function)(angle.ravel(), states, flags)
    return jax.tree.map(lambda value: value.reshape(*angle.shape, *value.shape[1:]), values)


class SolvedPressure(AbstractGas):
    """The pressure of a solved cycle, by the polynomials of its panels.

    Args:
        edges: [rad] (p + 1,) of the panels over one revolution; of several cylinders with an axis of
            these before, as all entries.
        values: [Pa] (p, s + 1) at the Gauss nodes and at the end of every panel.
        kinks: [rad] (k,) where the crank begins another panel.
        back_pressure: [Pa] behind the piston.
    """

    in_files: ClassVar[bool] = False  # the solver makes it

    edges: Float[Array, "*c p"] = quantity("rad", ANY, shape=(...,))
    values: Float[Array, "*c p m"] = quantity("Pa", ANY, shape=(...,))
    kinks: Float[Array, "*c k"] = quantity("rad", ANY, shape=(...,))
    back_pressure: Float[Array, "*c"] = quantity("Pa", NONNEGATIVE, shape=(...,))

    @property
    def behind_piston(self):
        return self.back_pressure if self.edges.ndim == 1 else self.back_pressure[0]

    def event_angles(self):
        return self.kinks

    def pressure(self, stroke):
        if self.edges.ndim == 1:
            return over_panels(self.edges, self.values, stroke.angle)
        angles = jnp.broadcast_to(stroke.angle, (self.edges.shape[0], *stroke.angle.shape[1:]))
        return jax.vmap(
            lambda cylinder, angle: over_panels(cylinder.edges, cylinder.values, angle)
        )(self, angles)


def over_panels(
    edges: Float[Array, " p"], values: Float[Array, "p m"], angle: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """The polynomials of panels at crank angles of any revolution.

    Args:
        edges: [rad] (p + 1,) of one revolution.
        values: (p, m) at the Gauss nodes and at the end of every panel.
        angle: [rad]
    """
    start = edges[0]
    count = values.shape[1]
    angle = start + jnp.mod(angle - start, 2 * jnp.pi)
    panel = interval_of(edges, angle)
    width = jnp.diff(edges)[panel]
    x = (angle - edges[panel]) / jnp.where(width > 0, width, 1.0)
    weights = jnp.moveaxis(legendre_columns(2 * x - 1, count), 0, -1) @ _to_series(count)
    return jnp.sum(weights * values[panel], axis=-1)


def highest(values: Float[Array, "p m"]) -> Float[Array, ""]:
    """Largest value of the polynomials through values at the points of every panel.

    Its place needs no derivative: the slope vanishes there.
    """
    fixed = lax.stop_gradient(values)
    x = np.linspace(0, 1, 8 * values.shape[1] + 1)
    to_series = _to_series(values.shape[1])
    samples = fixed @ (legendre.legvander(2 * x - 1, values.shape[1] - 1) @ to_series).T
    panel, column = row_and_column(jnp.argmax(samples), samples.shape[1])
    column = clip(column, 1, x.size - 2)
    # a parabola through the highest sample and its neighbours: an error of the place counts with
    # its square
    before, middle, after = (samples[panel, column + i] for i in (-1, 0, 1))
    bend = before - 2 * middle + after
    shift = jnp.where(bend < 0, 0.5 * (before - after) / jnp.where(bend < 0, bend, 1.0), 0.0)
    place = jnp.asarray(x)[column] + clip(shift, -1, 1) * x[1]
    return legendre_columns(2 * place - 1, values.shape[1]) @ (to_series @ values[panel])


def last_terms(values: Float[Array, "*n m"]) -> Float[Array, "*n"]:
    """Size of the highest two terms of the polynomials through values at the points of panels."""
    return jnp.sum(jnp.abs(values @ _to_series(values.shape[-1])[-2:].T), axis=-1)


def resolution(z: Unknowns, columns: Sequence[int] | np.ndarray = RESOLVED) -> Float[Array, ""]:
    """[-] Highest two terms of the polynomials of mass, temperature and lifts, over their scales.

    Args:
        z: on panels.
        columns: where these stand among the states, those of one cylinder behind those of another.
    """
    states = z.points[..., jnp.asarray(columns)]
    wide = (jnp.diff(z.edges) > 1e-7)[:, None, None]
    terms = jnp.abs(jnp.einsum("kj,pjn->pkn", _to_series(states.shape[1])[-2:], states))
    return max_of(jnp.sum(jnp.where(wide, terms, 0.0), axis=1))


def turning_margins(case: Case, mesh: Mesh, z: Unknowns) -> Float[Array, "2 2"]:
    """Angles by which free valves turn, or would turn, beyond seat and stop where that is nearest to
    nothing.

    Returns:
        [-] of the stop, suction and discharge valve by seat and stop: positive where the valve touches
        and its own motion would have turned it so far beyond; negative where it turns so far before.
        Infinite where nothing turns there, or the force presses on.
    """
    angle, width = point_angles(z.edges, z.points.shape[1] - 1)
    angle = jnp.concatenate([z.edges[:-1, None], angle], axis=1)
    states = jnp.concatenate([z.left[:, None], z.points], axis=1)
    pace = case.speed / jax.vmap(jax.vmap(case.speed_at))(angle)
    gap = jnp.diff(angle, axis=1)
    wide = maximum(width, 1e-7)
    # slope at the end of a panel, from the values at its points
    count = z.points.shape[1]
    slope = legendre.legvander([1.0], count - 1)
    # P_k'(1) = k (k + 1)/2, doubled since a panel has half the width of [-1, 1]
    slope = np.array([k * (k + 1) for k in range(count)]) * slope[0] @ _to_series(count)
    margins = []
    for which in range(2):
        free = (mesh.flags[:, 3 * which] == FREE) & (width > 1e-7)
        for place in range(2):
            # towards the stop, or towards the seat
            if place:
                beyond = states[..., 2 + 3 * which] - 1
                sense = 1
            else:
                beyond = -states[..., 2 + 3 * which]
                sense = -1
            rate = states[..., 3 + 3 * which] * pace * sense
            bend = rate[:, 1:] @ slope / wide
            touches = free & (mesh.event == 4 * which + place) & (bend < 0)
            # height of the parabola on which the valve would have flown on beyond the contact
            would = rate[:, -1] ** 2 / (2 * jnp.where(touches, -bend, 1.0))
            turns = free[:, None] & (rate[:, :-1] > 0) & (rate[:, 1:] <= 0)
            share = rate[:, :-1] / jnp.where(turns, rate[:, :-1] - rate[:, 1:], 1.0)
            ends = (beyond[:, :-1], beyond[:, 1:]), (rate[:, :-1], rate[:, 1:])
            does = minimum(cubic_step(share, gap, *ends), 0.0)
            candidates = jnp.concatenate(
                [jnp.where(touches, would, jnp.inf), jnp.where(turns, does, -jnp.inf).ravel()]
            )
            margins.append(candidates[jnp.argmin(jnp.abs(candidates))])
    return jnp.stack(margins).reshape(2, 2)


@cache
def _to_series(count: int) -> np.ndarray:
    """Legendre coefficients from the values at the points of a panel."""
    places = np.append(gauss(count - 1).nodes, 1.0)
    return np.linalg.inv(legendre.legvander(2 * places - 1, count - 1))
