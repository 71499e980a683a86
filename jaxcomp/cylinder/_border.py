r"""Newton's method for cycles behind pipes: the blocks of the panels with a border of harmonics.

The waves c at the flanges are unknowns beside those of the panels, z:

$$F(z, c) = 0,\qquad G(c, q(z)) = c - \text{answer of the networks to the flows } q = 0 .$$

A pressure enters a panel by its values at the nodes alone, so that its columns are few before they are
multiplied with the harmonics; the border is condensed to the matrix
$S = G_c + G_q\,(q_c + q_z z_c)$ of the size of c. Every step is two solutions with the blocks as they are
without pipes.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import max_of, maximum, minimum
from .._core.polynomials import gauss
from .._core.roots import AbstractRoot
from ._collocation import (
    FAST,
    LOST,
    MOST_WITH_ONE,
    Branches,
    Factors,
    Residual,
    assemble,
    branches_of,
    factorise,
    keeps_within,
    residual,
    solve_factors,
    solve_stages,
)
from ._panels import Mesh, Unknowns, at_points
from ._system import Cylinders
from ._waves import Line, Observed, Quadrature, SideWaves, Waves, lines_of, quadrature

# [-] of the line's pressure: how far a step of the waves is followed where the valves' sequence changes.
_LARGEST_STEP = 0.05


class Slopes(NamedTuple):
    """Derivatives of what the panels see of the flanges, and show them.

    Attributes:
        state: (p, s + 1, n, k) of the rates in the pressures.
        event: (p, k) of the event function at the end of each panel in them.
        observed: (p, s, o) flows through the flanges.
        by_state: (p, s, o, n) of these.
        by_angle: (p, s, o)
        by_pressure: (p, s, o, k)
        basis: (p, s + 1, k, c) pressures for each harmonic of each flange.
        weights: of the flows in their harmonics.
    """

    state: Float[Array, "p m n k"]
    event: Float[Array, "p k"]
    observed: Float[Array, "p s o"]
    by_state: Float[Array, "p s o n"]
    by_angle: Float[Array, "p s o"]
    by_pressure: Float[Array, "p s o k"]
    basis: Float[Array, "p m k c"]
    weights: Quadrature


class Bordered(NamedTuple):
    """The linearised equations, condensed."""

    factors: Factors
    slopes: Slopes
    widths: Float[Array, " p"]
    by_flow: Float[Array, "b o h"]  # of G in the harmonics of the flows
    border: tuple[Array, Array]  # factors of S


class Both(NamedTuple):
    """Unknowns, or residuals, of panels and waves."""

    panels: Any  # `Unknowns` or `Residual`
    waves: Waves


def observed_harmonics(system: Cylinders, observed, weights: Quadrature) -> tuple[Observed, ...]:
    """Harmonics of the flows through the flanges of each network, from their values at the nodes."""
    return system.of_sides(jnp.einsum("pjo,pjh->oh", observed, weights.nodes))


def harmonic_weights(system: Cylinders, z: Unknowns) -> Quadrature:
    """Weights of flows at the nodes of panels in their harmonics."""
    nodes = z.points.shape[1] - 1
    return quadrature(system.first, system.phase[0], z.edges, nodes, system.orders)


def answers(lines: tuple[Line | None, Line | None], waves: Waves, flows) -> Waves:
    """Waves that the networks make of the flows."""
    return _per_side(lambda line, side, flow: line.answer(side, flow), lines, waves, flows)


def _per_side(function, lines, waves: Waves, flows) -> Waves:
    sides = []
    flows = iter(flows)
    for line, side in zip(lines, waves, strict=True):
        sides.append(None if line is None else function(line, side, next(flows)))
    return sides[0], sides[1]


def evaluate(system: Cylinders, mesh: Mesh, z: Unknowns, waves: Waves) -> tuple[Both, Array]:
    """Residuals of panels and waves, and the event functions."""
    system = system.with_waves(waves)

    def law(angle, state, flags):
        rates = system.rates(angle, state, flags)
        return rates.state, rates.events, system.observe(rates.streams)

    slopes, events, observed = at_points(law, mesh, z)
    panels = residual(system, mesh, z, slopes, events)
    flows = observed_harmonics(system, observed[:, :-1], harmonic_weights(system, z))
    answer = answers(lines_of(system.shared), waves, flows)
    return Both(panels, jax.tree.map(jnp.subtract, waves, answer)), events


def linearise(system: Cylinders, mesh: Mesh, z: Unknowns, waves: Waves) -> Bordered:
    """The linearised equations of panels and waves, condensed."""
    system = system.with_waves(waves)
    parts = at_points(system.jacobian_at_flanges, mesh, z)
    _, blocks, _ = assemble(system, mesh, z, *parts.panels)
    weights = harmonic_weights(system, z)
    which = maximum(mesh.event, 0)[:, None, None]
    event = jnp.take_along_axis(parts.events_by_pressure[:, -1], which, axis=1)[:, 0]
    slopes = Slopes(
        state=parts.state_by_pressure,
        event=jnp.where(blocks.has_event[:, None], event, 0.0),
        observed=parts.observed[:, :-1],
        by_state=parts.observed_by_state[:, :-1],
        by_angle=parts.observed_by_angle[:, :-1],
        by_pressure=parts.observed_by_pressure[:, :-1],
        basis=parts.basis,
        weights=weights,
    )
    factors = factorise(blocks)
    width = jnp.diff(z.edges)
    flows = jnp.einsum("pjo,pjh->oh", slopes.observed, weights.nodes)
    by_flow, by_waves = _border_slopes(system, waves, flows)
    columns = _columns(system, factors, slopes, width)
    count = slopes.basis.shape[-1]
    through = jnp.einsum("boh,ohc->bc", by_flow, columns)
    matrix = by_waves.at[:, :count].add(through)
    lu, _, order = lax.linalg.lu(matrix)
    return Bordered(factors, slopes, width, by_flow, (lu, order))


def _packed(waves: Waves):
    """All unknowns of waves as a vector, those of pressures before the others, and the way back."""
    pressures = [side.pressure for side in waves if side is not None]
    behind_pressures = [side[1:] for side in waves if side is not None]
    vector, back = ravel_pytree((pressures, behind_pressures))

    def unpacked(vector) -> Waves:
        pressures, behind_pressures = back(vector)
        sides = iter(zip(pressures, behind_pressures, strict=True))
        unpacked_sides = []
        for side in waves:
            if side is None:
                unpacked_sides.append(None)
                continue
            pressure, following = next(sides)
            unpacked_sides.append(SideWaves(pressure, *following))
        return unpacked_sides[0], unpacked_sides[1]

    return vector, unpacked


def _border_slopes(system: Cylinders, waves: Waves, flows: Float[Array, "o h"]):
    """Derivatives of G in the flows (b, o, h) and in the waves (b, b)."""
    lines = lines_of(system.shared)
    vector, unpacked = _packed(waves)
    pressures = sum(side.pressure.size for side in waves if side is not None)
    responses = tuple(
        None if line is None else line.responses(side)
        for line, side in zip(lines, waves, strict=True)
    )

    def with_responses(waves, flows):
        parts = []
        observed = iter(system.of_sides(flows))
        for line, side, response in zip(lines, waves, responses, strict=True):
            answer = None if line is None else line.answer_of(response, side, next(observed))
            parts.append(answer)
        return _packed((parts[0], parts[1]))[0]

    def all_answers(waves):
        return _packed(answers(lines, waves, system.of_sides(flows)))[0]

    by_flow = -jax.jacfwd(lambda flows: with_responses(waves, flows))(flows)
    by_waves = jnp.eye(vector.size)
    behind_pressures = vector.size - pressures
    if not behind_pressures:
        return by_flow, by_waves
    drops = sum(side.drops.size for side in waves if side is not None)

    def moved(function, behind_pressures):
        return function(unpacked(jnp.concatenate([vector[:pressures], behind_pressures])))

    if drops:
        # the responses do not depend on the drops, and are not solved for each of them
        fixed = jax.jacfwd(lambda x: moved(lambda w: with_responses(w, flows), x))
        by_waves = by_waves.at[:, pressures:].add(-fixed(vector[pressures:]))
    places = _places_of_few(waves)
    if places.size:

        def at_few(few):
            behind_pressures = vector[pressures:].at[places].set(few)
            return moved(all_answers, behind_pressures)

        few = jax.jacfwd(at_few)(vector[pressures:][places])
        columns = pressures + places
        unit = jnp.eye(vector.size)[:, columns]
        by_waves = by_waves.at[:, columns].set(unit - few)
    return by_flow, by_waves


def _places_of_few(waves: Waves) -> np.ndarray:
    """Where temperatures and friction stand among the unknowns behind the pressures."""
    places = []
    start = 0
    for side in waves:
        if side is None:
            continue
        start += side.drops.size
        count = side.temperature.size + side.friction.size
        places += list(range(start, start + count))
        start += count
    return np.array(places, int)


def _columns(system: Cylinders, factors: Factors, slopes: Slopes, width) -> Float[Array, "o h c"]:
    """Harmonics of the flows for each harmonic of the pressures, with the panels as they answer."""
    panels, s, _, n = slopes.by_state.shape
    k = slopes.event.shape[-1]
    rule = gauss(s)
    basis = slopes.basis[:, :s].reshape(panels, s * k, -1)
    basis_at_ends = slopes.basis[:, s]
    integral = jnp.asarray(rule.integral)
    pushed_nodes = jnp.einsum("p,ij,pjnk->pinjk", width, integral, slopes.state[:, :s])
    pushed_nodes = pushed_nodes.reshape(panels, s * n, s * k)
    ends = jnp.einsum("p,j,pjnk->pnjk", width, jnp.asarray(rule.weights), slopes.state[:, :s])
    nodes = solve_stages(factors.stages, pushed_nodes)
    own_nodes = nodes @ basis
    own_ends = (factors.out @ nodes + ends.reshape(panels, n, s * k)) @ basis
    pushed = jnp.einsum("pk,pkc->pc", slopes.event, basis_at_ends)
    pulled = jnp.einsum("pn,pnc->pc", factors.gradient, own_ends)
    own_edge = -factors.share[:, None] * (pushed + pulled)
    own_end = own_ends + factors.by_edge[:, :, None] * own_edge[:, None]
    panel_ends = jnp.concatenate([factors.jump @ own_end, own_edge[:, None]], axis=1)
    after = _around(factors.maps, panel_ends)
    states = jnp.roll(after, 1, axis=0).at[0, n].set(0.0)
    edges = jnp.concatenate([states[:, n], jnp.zeros((1, panel_ends.shape[-1]))])
    inputs = jnp.concatenate([states, edges[1:, None]], axis=1)
    points = factors.nodes @ inputs + own_nodes
    points = points.reshape(panels, s, n, -1)
    observed = jnp.einsum("pjon,pjnc->pjoc", slopes.by_state, points)
    observed += jnp.einsum("pjok,pjkc->pjoc", slopes.by_pressure, slopes.basis[:, :s])
    return _moved_harmonics(slopes, observed, edges)


def _moved_harmonics(slopes: Slopes, observed, edges):
    """Change of the harmonics (o, h, c) with flows at the nodes (p, s, o, c) and edges (p + 1, c)."""
    s = observed.shape[1]
    places = gauss(s).nodes
    angle = edges[:-1, None] * (1 - places)[:, None] + edges[1:, None] * places[:, None]
    observed = observed + slopes.by_angle[..., None] * angle[:, :, None]
    weights = slopes.weights
    of_left = jnp.einsum("pjo,pjh->poh", slopes.observed, weights.to_left)
    of_right = jnp.einsum("pjo,pjh->poh", slopes.observed, weights.to_right)
    moved = jnp.einsum("pjoc,pjh->ohc", observed, weights.nodes)
    moved += jnp.einsum("poh,pc->ohc", of_left, edges[:-1])
    return moved + jnp.einsum("poh,pc->ohc", of_right, edges[1:])


def _around(
    maps: Float[Array, "p m m"], panel_ends: Float[Array, "p m c"]
) -> Float[Array, "p m c"]:
    """The ends of all panels where each follows from the one before, of many columns."""
    size = maps.shape[-1]

    def pass_panel(before, panel):
        matrix, columns = panel
        after = matrix @ before
        return after.at[:, size:].add(columns), None

    start = jnp.eye(size, size + panel_ends.shape[-1])
    revolution, _ = lax.scan(pass_panel, start, (maps, panel_ends))
    first = jnp.linalg.solve(jnp.eye(size) - revolution[:, :size], revolution[:, size:])

    def follow(before, panel):
        matrix, columns = panel
        after = matrix @ before + columns
        return after, after

    return lax.scan(follow, first, (maps, panel_ends))[1]


def solve_bordered(linear: Bordered, right_hand_side: Both) -> Both:
    """Solve the linearised equations; linear in `right_hand_side`."""
    vector, unpacked = _packed(right_hand_side.waves)
    alone = solve_factors(linear.factors, right_hand_side.panels)
    slopes = linear.slopes
    s = slopes.observed.shape[1]
    observed = jnp.einsum("pjon,pjn->pjo", slopes.by_state, alone.points[:, :s])
    flows = _moved_harmonics(slopes, observed[..., None], alone.edges[:, None])[..., 0]
    right = vector - jnp.einsum("boh,oh->b", linear.by_flow, flows)
    lu, order = linear.border
    half = lax.linalg.triangular_solve(
        lu, right[order][:, None], left_side=True, lower=True, unit_diagonal=True
    )
    waves = lax.linalg.triangular_solve(lu, half, left_side=True, lower=False)[:, 0]
    pressures = slopes.basis @ waves[: slopes.basis.shape[-1]]
    rule = gauss(s)
    integral = jnp.asarray(np.vstack([rule.integral, rule.weights]))
    pushed = jnp.einsum("pjnk,pjk->pjn", slopes.state[:, :s], pressures[:, :s])
    points = jnp.einsum("p,ij,pjn->pin", linear.widths, integral, pushed)
    events = jnp.einsum("pk,pk->p", slopes.event, pressures[:, s])
    panels = Residual(
        right_hand_side.panels.points + points,
        right_hand_side.panels.ends,
        right_hand_side.panels.events - events,
    )
    return Both(solve_factors(linear.factors, panels), unpacked(waves))


class BorderReport(NamedTuple):
    """Report on the end of Newton's method."""

    size: Float[Array, ""]  # [-] of the last step
    steps: Int[Array, ""]  # with a Jacobian of their own
    holds: Bool[Array, ""]  # whether all branches hold
    first: Waves  # change of the waves in the first step
    # [rad] where a branch is left most, infinite where they hold at all nodes
    left_at: Float[Array, ""]


def newton(system: Cylinders, mesh: Mesh, start: Both, tolerance, max_steps: int):
    """The periodic cycle with its waves near a start, with its report."""

    def falling(size, previous_size, steps):
        going = (size > tolerance) & ((size > 1e-10) | (size < 0.3 * previous_size))
        return going & (size < LOST) & (steps < max_steps)

    def going_on(carry):
        _, size, previous_size, steps, _, _ = carry
        return falling(size, previous_size, steps) & mesh.fits

    counts = jnp.ones(start.panels.left.shape[1]).at[system.columns(4, 7)].set(0.0)

    def size_of(step: Both):
        parts = [max_of(jnp.abs(step.panels.points * counts))]
        parts.append(max_of(jnp.abs(step.panels.edges)))
        parts += [max_of(jnp.abs(leaf)) for leaf in jax.tree.leaves(step.waves) if leaf.size]
        size = max_of(jnp.stack(parts))
        return jnp.where(jnp.isfinite(size), size, 2 * LOST)

    def advance(carry):
        unknowns, _, _, steps, first, _ = carry
        remainder, _ = evaluate(system, mesh, *unknowns)
        linear = linearise(system, mesh, *unknowns)

        def fast(carry):
            _, _, size, previous_size, count, _, _ = carry
            shrinks_fast = (
                (size > tolerance) & (size < FAST * previous_size) & (count <= MOST_WITH_ONE)
            )
            return shrinks_fast | (count == 0)

        def step(carry):
            unknowns, remainder, previous_size, _, count, moved, _ = carry
            step = solve_bordered(linear, jax.tree.map(jnp.negative, remainder))
            size = size_of(step)
            unknowns = jax.tree.map(lambda x, d: jnp.where(size < LOST, x + d, x), unknowns, step)
            remainder, events = evaluate(system, mesh, *unknowns)
            moved = jax.tree.map(lambda a, b: jnp.where(count == 0, a, b), step.waves, moved)
            return (
                unknowns,
                remainder,
                size,
                previous_size,
                count + 1,
                moved,
                branches_of(unknowns.panels, events),
            )

        endless = jnp.asarray(jnp.inf)
        begin = (unknowns, remainder, endless, endless, none, first, unknown)
        unknowns, _, size, before, _, moved, branches = lax.while_loop(fast, step, begin)
        first = jax.tree.map(lambda a, b: jnp.where(steps == 0, a, b), moved, first)
        return unknowns, size, before, steps + 1, first, branches

    none = jnp.zeros((), int)
    no_change = jax.tree.map(jnp.zeros_like, start.waves)
    unknown = Branches(jnp.asarray(False), jnp.asarray(jnp.inf))
    begin = (start, jnp.asarray(1.0), jnp.asarray(LOST), none, no_change, unknown)
    unknowns, size, _, steps, first, branches = lax.while_loop(going_on, advance, begin)
    holds = branches.hold & keeps_within(system, mesh, unknowns.panels)
    return unknowns, BorderReport(size, steps, holds, first, branches.left_at)


def limited(system: Cylinders, before: Waves, change: Waves) -> Waves:
    """Waves after a change, of which so much is followed as stays within 5 % of the line's pressure."""
    largest = jnp.zeros(())
    for side in change:
        if side is not None:
            amplitude = jnp.sqrt(jnp.sum(side.pressure**2, axis=1))
            largest = maximum(largest, max_of(amplitude))
    finite = jnp.isfinite(largest)
    share = minimum(1.0, _LARGEST_STEP / jnp.where(finite & (largest > 0), largest, 1.0))
    share = jnp.where(finite, share, 0.0)
    return jax.tree.map(lambda x, d: x + share * jnp.where(finite, d, 0.0), before, change)


class AttachedWaves(AbstractRoot):
    """The equations of a cycle behind pipes that was found: its root follows the parameters."""

    system: Cylinders
    mesh: Mesh
    solution: Both

    def solve(self):
        return self.solution

    def residual(self, unknowns):
        remainder = evaluate(self.system, self.mesh, *unknowns)[0]
        # a line without pipes is no leaf, as an equation that nothing moves would be
        return remainder.panels, _packed(remainder.waves)[0]

    def newton_correction(self, unknowns, residual):
        linear = linearise(self.system, self.mesh, *unknowns)
        panels, waves = jax.tree.map(jnp.negative, residual)
        _, unpacked = _packed(unknowns.waves)
        return solve_bordered(linear, Both(panels, unpacked(waves)))
