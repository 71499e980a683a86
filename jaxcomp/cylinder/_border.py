r"""Newton's method for cycles behind pipes: the blocks of the panels with a border of harmonics.

The waves c at the flanges are unknowns beside those of the panels, z:

$$F(z, c) = 0,\qquad G(c, q(z)) = c - \text{answer of the networks to the flows } q = 0 .$$

A pressure enters a panel by its values at the nodes alone, so that its columns are few before they are
multiplied with the harmonics; the border is condensed to the matrix
$S = G_c + G_q\,(q_c + q_z z_c)$ of the size of c. Every step is two solutions with the blocks as they are
without pipes.
"""

from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .._core.extremes import max_of, maximum, minimum
from .._core.polynomials import gauss
from .._core.roots import AbstractRoot
from ._cycle_collocation import (
    AbstractEquations,
    Blocks,
    Factors,
    assemble,
    condense,
    keeps_within,
    residual,
    solve_factors,
    solve_stages,
)
from ._cylinder_system import Cylinders, FlangeJacobian
from ._event_panels import Mesh, Unknowns, at_points
from ._quadrature import Quadrature, quadrature
from ._waves import Line, Observed, SideWaves, Waves, lines_of

# [-] How far a valve may pass seat or stop between nodes, in parts of the highest two terms of its lift:
# beyond 64 harmonics of the pressure a panel does not resolve it to 1e-9, and a valve that leaves its
# stop slowly seemed to pass it by 4e-7 on panels whose work and flow were right to 3e-6.
_OF_LAST_TERMS = 1.0
# [-] of the line's pressure: how far a step of the waves is followed where the valves' sequence changes.
_LARGEST_STEP = 0.1


class Flows(NamedTuple):
    """Slopes of the harmonics of the flows in the panels.

    Attributes:
        by_state: (p, s, o, n) of the flows at the nodes.
        by_angle: (p, s, o)
        weights: (p, s, h) of these in their harmonics.
        by_left, by_right: (p, o, h) of the harmonics in the edges of each panel.
    """

    by_state: Float[Array, "p s o n"]
    by_angle: Float[Array, "p s o"]
    weights: Float[Array, "p s h"]
    by_left: Float[Array, "p o h"]
    by_right: Float[Array, "p o h"]


class Columns(NamedTuple):
    """Answer of the panels to pressures at their nodes, and all round the revolution to each harmonic.

    Attributes:
        basis: (p, s, k, c) pressures at the nodes for each harmonic of each flange.
        nodes: (p, s n, s k) of the nodes for the pressures at them, the panel's inputs held.
        ends: (p, n, s k) of its end.
        inputs: (p, n + 2, c) of the inputs of all panels for each harmonic.
    """

    basis: Float[Array, "p s k c"]
    nodes: Float[Array, "p m q"]
    ends: Float[Array, "p n q"]
    inputs: Float[Array, "p i c"]


class Bordered(NamedTuple):
    """The linearised equations, condensed."""

    factors: Factors
    flows: Flows
    columns: Columns
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


def fixed_responses(system: Cylinders, waves: Waves) -> tuple:
    """Responses of the networks that do not change with their waves; `None` of others."""

    def fixed_response(line, side):
        if not line.is_fixed:
            return None
        return line.responses(side)

    return _per_side(fixed_response, lines_of(system.shared), waves)


def answers(lines: tuple[Line | None, Line | None], waves: Waves, flows, responses=None) -> Waves:
    """Waves that the networks make of the flows.

    Args:
        lines: the networks.
        waves: their gas, friction and orifices.
        flows: through the flanges of each network.
        responses: of networks that are known.
    """
    flows = iter(flows)

    def answer(line, side, response):
        return line.answer_of(_response_of(line, side, response), side, next(flows))

    return _per_side(answer, lines, waves, responses or (None, None))


def _response_of(line: Line, side: SideWaves, response):
    """Response of a network to its waves, where it is not known already."""
    if response is None:
        response = line.responses(side)
    return response


def _per_side(function, lines, *parts) -> tuple:
    """Values of a function of each line that is a network, and its parts."""
    sides = []
    for line, *of_line in zip(lines, *parts, strict=True):
        value = None
        if line is not None:
            value = function(line, *of_line)
        sides.append(value)
    return tuple(sides)


def evaluate(
    system: Cylinders, mesh: Mesh, z: Unknowns, waves: Waves, responses=None
) -> tuple[Both, Array]:
    """Residuals of panels and waves, and the event functions."""
    system = system.with_waves(waves)

    def law(angle, state, flags):
        rates, observed = system.observe(angle, state, flags)
        return rates.state, rates.events, observed

    slopes, events, observed = at_points(law, mesh, z)
    panels = residual(system, mesh, z, slopes, events)
    flows = observed_harmonics(system, observed[:, :-1], harmonic_weights(system, z))
    answer = answers(lines_of(system.shared), waves, flows, responses)
    return Both(panels, jax.tree.map(jnp.subtract, waves, answer)), events


def linearise(
    system: Cylinders, mesh: Mesh, z: Unknowns, waves: Waves, responses=None
) -> tuple[Both, Bordered]:
    """Residuals of panels and waves, and their linearised equations, condensed."""
    system = system.with_waves(waves)
    parts = at_points(system.jacobian_at_flanges, mesh, z)
    panels, blocks, _ = assemble(system, mesh, z, *parts.panels)
    weights = harmonic_weights(system, z)
    which = maximum(mesh.event, 0)[:, None, None]
    # an event at the end of a panel moves with the pressure there; edges without one do not
    event = jnp.take_along_axis(parts.events_by_pressure[:, -1], which, axis=1)[:, 0]
    event = jnp.where(blocks.has_event[:, None], event, 0.0)
    factors, *pushed = _condensed(blocks, parts, jnp.diff(z.edges))
    observed = parts.observed[:, :-1]
    flows = Flows(
        by_state=parts.observed_by_state[:, :-1],
        by_angle=parts.observed_by_angle[:, :-1],
        weights=weights.nodes,
        by_left=jnp.einsum("pjo,pjh->poh", observed, weights.to_left),
        by_right=jnp.einsum("pjo,pjh->poh", observed, weights.to_right),
    )
    columns = _columns(factors, *pushed, parts.basis, event)
    harmonics = jnp.einsum("pjo,pjh->oh", observed, weights.nodes)
    answer = answers(lines_of(system.shared), waves, system.of_sides(harmonics), responses)
    remainder = Both(panels, jax.tree.map(jnp.subtract, waves, answer))
    by_flow, by_waves = _border_slopes(system, waves, harmonics, responses)
    by_pressure = parts.observed_by_pressure[:, :-1]
    followed = _harmonic_columns(factors, flows, by_pressure, columns)
    through = jnp.einsum("boh,ohc->bc", by_flow, followed)
    # pressures alone act on the cylinders: the other unknowns of the waves, behind them in the
    # vector, have slopes of the networks only
    matrix = by_waves.at[:, : through.shape[1]].add(through)
    lu, _, order = lax.linalg.lu(matrix)
    return remainder, Bordered(factors, flows, columns, by_flow, (lu, order))


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


def _border_slopes(system: Cylinders, waves: Waves, flows: Float[Array, "o h"], fixed=None):
    """Derivatives of G in the flows (b, o, h) and in the waves (b, b)."""
    lines = lines_of(system.shared)
    vector, unpacked = _packed(waves)
    pressures = sum(side.pressure.size for side in waves if side is not None)

    # a linear solution for every harmonic, which no flow changes: once, and not in every direction
    responses = _per_side(_response_of, lines, waves, fixed or (None, None))

    def with_responses(waves, flows):
        return _packed(answers(lines, waves, system.of_sides(flows), responses))[0]

    def all_answers(waves):
        return _packed(answers(lines, waves, system.of_sides(flows)))[0]

    # the signs are those of G = c - answer
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
        by_drops = jax.jacfwd(lambda x: moved(lambda w: with_responses(w, flows), x))
        by_waves = by_waves.at[:, pressures:].add(-by_drops(vector[pressures:]))
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


def _condensed(blocks: Blocks, parts: FlangeJacobian, width) -> tuple[Factors, Array, Array]:
    """Panels condensed, and what their nodes (p, s n, s k) and ends (p, n, s k) do for the pressures."""
    panels, points, n, k = parts.state_by_pressure.shape
    s = points - 1
    rule = gauss(s)
    by_pressure = parts.state_by_pressure[:, :s]
    pushed = jnp.einsum("p,ij,pjnk->pinjk", width, jnp.asarray(rule.integral), by_pressure)
    pushed = pushed.reshape(panels, s * n, s * k)
    lu, _, order = lax.linalg.lu(blocks.stages)
    # inputs and pressures at once: BLAS is asked once
    solved = solve_stages((lu, order), jnp.concatenate([blocks.inputs, pushed], axis=2))
    # the first columns are those of a panel without pipes, the others those of the pressures at
    # its nodes
    factors = condense(blocks, (lu, order), solved[..., : n + 2])
    nodes = solved[..., n + 2 :]
    pushed = jnp.einsum("p,j,pjnk->pnjk", width, jnp.asarray(rule.weights), by_pressure)
    return factors, nodes, blocks.out @ nodes + pushed.reshape(panels, n, s * k)


def _columns(factors: Factors, nodes, ends, basis, event) -> Columns:
    """Answer of the panels to the pressures at the flanges.

    Args:
        factors: of the panels.
        nodes, ends: of `_condensed`.
        basis: (p, s + 1, k, c) pressures at all points for each harmonic.
        event: (p, k) of the event function at the end of each panel in the pressures.
    """
    panels, points, k, _ = basis.shape
    n = ends.shape[1]
    # few pressures of a panel, those at its end behind those at its nodes, before they are multiplied
    # with the harmonics
    pulled = jnp.einsum("pn,pnq->pq", factors.gradient, ends)
    edge = -factors.share[:, None] * jnp.concatenate([pulled, event], axis=1)
    # the pressure at the end of a panel acts on its event alone: Gauss's rule has no node there
    end = jnp.concatenate([ends, jnp.zeros((panels, n, k))], axis=2)
    end = end + factors.by_edge[:, :, None] * edge[:, None]
    answer = jnp.concatenate([factors.jump @ end, edge[:, None]], axis=1)
    panel_ends = answer @ basis.reshape(panels, points * k, -1)
    before = jnp.roll(_around(factors.maps, panel_ends), 1, axis=0).at[0, n].set(0.0)
    following = jnp.roll(before[:, n], -1, axis=0)
    inputs = jnp.concatenate([before, following[:, None]], axis=1)
    return Columns(basis[:, :-1], nodes, ends, inputs)


def _harmonic_columns(factors: Factors, flows: Flows, by_pressure, columns: Columns):
    """Harmonics of the flows (o, h, c) for each harmonic of the pressures, as the panels answer.

    Few rows of flows are put together before they are multiplied with the columns.
    """
    panels, s, o, n = flows.by_state.shape
    k = by_pressure.shape[-1]
    of_inputs = flows.by_state @ factors.nodes.reshape(panels, s, n, n + 2)
    # an edge carries the nodes along: angle (1 - c) left + c right
    places = jnp.asarray(gauss(s).nodes)[:, None]
    of_inputs = of_inputs.at[..., n].add(flows.by_angle * (1 - places))
    of_inputs = of_inputs.at[..., n + 1].add(flows.by_angle * places)
    of_nodes = flows.by_state @ columns.nodes.reshape(panels, s, n, s * k)
    # a flow feels the pressure at its own node at once, besides what the panel's states do
    node = np.arange(s)
    of_nodes = (
        of_nodes.reshape(panels, s, o, s, k).at[:, node, :, node].add(by_pressure.swapaxes(0, 1))
    )
    rows = jnp.concatenate([of_inputs, of_nodes.reshape(panels, s, o, s * k)], axis=3)
    basis = columns.basis.reshape(panels, s * k, -1)
    answers = jnp.concatenate([columns.inputs, basis], axis=1)
    observed = rows.reshape(panels, s * o, -1) @ answers
    moved = jnp.einsum("pjoc,pjh->ohc", observed.reshape(panels, s, o, -1), flows.weights)
    moved += jnp.einsum("poh,pc->ohc", flows.by_left, columns.inputs[:, n])
    return moved + jnp.einsum("poh,pc->ohc", flows.by_right, columns.inputs[:, n + 1])


def _harmonics_of_panels(flows: Flows, change: Unknowns) -> Float[Array, "o h"]:
    """Change of the harmonics of the flows with the panels."""
    s = flows.by_state.shape[1]
    places = gauss(s).nodes
    begin = change.edges[:-1]
    end = change.edges[1:]
    angle = begin[:, None] * (1 - places) + end[:, None] * places
    # flows change with states and angles of the nodes, and their weights in the harmonics with the
    # edges
    observed = jnp.einsum("pjon,pjn->pjo", flows.by_state, change.points[:, :s])
    observed += flows.by_angle * angle[..., None]
    moved = jnp.einsum("pjo,pjh->oh", observed, flows.weights)
    moved += jnp.einsum("poh,p->oh", flows.by_left, begin)
    return moved + jnp.einsum("poh,p->oh", flows.by_right, end)


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
    # BLAS would share out the solution for many columns among threads, which wait for each other
    inverse = jnp.linalg.inv(jnp.eye(size) - revolution[:, :size])
    first = inverse @ revolution[:, size:]

    def follow(before, panel):
        matrix, columns = panel
        after = matrix @ before + columns
        return after, after

    return lax.scan(follow, first, (maps, panel_ends))[1]


def solve_border(border: tuple[Array, Array], right: Float[Array, " b"]) -> Float[Array, " b"]:
    """Waves of the condensed equations, by the factors of their matrix."""
    lu, order = border
    half = lax.linalg.triangular_solve(
        lu, right[order][:, None], left_side=True, lower=True, unit_diagonal=True
    )
    return lax.linalg.triangular_solve(lu, half, left_side=True, lower=False)[:, 0]


def blank_border(waves: Waves) -> tuple[Array, Array]:
    """Factors of the condensed equations before any were linearised: those of waves alone."""
    size = _packed(waves)[0].size
    return jnp.eye(size), jnp.arange(size, dtype=jnp.int32)


def chord_step(
    system: Cylinders, mesh: Mesh, z: Unknowns, waves: Waves, responses, border
) -> Waves:
    """Change of the waves by their equations as they were linearised elsewhere.

    Args:
        system: the cylinders.
        mesh, z: panels of a march behind the waves, which solves their equations well enough.
        waves: behind which was marched.
        responses: of networks that do not change with their waves.
        border: factors of the condensed equations.
    """
    system = system.with_waves(waves)

    def law(angle, state, flags):
        return system.observe(angle, state, flags)[1]

    observed = at_points(law, mesh, z)[:, :-1]
    flows = observed_harmonics(system, observed, harmonic_weights(system, z))
    # a march has solved the equations of the panels: only those of the waves have a residual
    answer = answers(lines_of(system.shared), waves, flows, responses)
    vector, unpacked = _packed(jax.tree.map(jnp.subtract, waves, answer))
    return unpacked(-solve_border(border, vector))


def solve_bordered(linear: Bordered, right_hand_side: Both) -> Both:
    """Solve the linearised equations; linear in `right_hand_side`."""
    vector, unpacked = _packed(right_hand_side.waves)
    # panels with waves held, then waves by the condensed matrix with what these panels deliver,
    # then what the pressures do to the panels
    alone = solve_factors(linear.factors, right_hand_side.panels)
    flows = _harmonics_of_panels(linear.flows, alone)
    right = vector - jnp.einsum("boh,oh->b", linear.by_flow, flows)
    waves = solve_border(linear.border, right)
    columns = linear.columns
    basis = columns.basis
    n = linear.factors.jump.shape[-1]
    pressures = (basis @ waves[: basis.shape[-1]]).reshape(basis.shape[0], -1)
    inputs = columns.inputs @ waves[: basis.shape[-1]]
    by_inputs = jnp.concatenate([linear.factors.nodes, linear.factors.ends], axis=1)
    by_pressures = jnp.concatenate([columns.nodes, columns.ends], axis=1)
    points = jnp.einsum("pmi,pi->pm", by_inputs, inputs)
    points += jnp.einsum("pmq,pq->pm", by_pressures, pressures)
    panels = Unknowns(
        alone.points + points.reshape(alone.points.shape),
        alone.left + inputs[:, :n],
        alone.edges + jnp.append(inputs[:, n], 0.0),
    )
    return Both(panels, unpacked(waves))


class BorderEquations(AbstractEquations):
    """The equations of a cycle behind pipes.

    Attributes:
        responses: of networks that do not change with their waves.
    """

    # A first step by more than a stop of a valve does not come back, or to other branches: its waves are
    # followed as far as is safe, and the next march meets them.
    lost: ClassVar[float] = 1.0
    # Another Jacobian costs as much as seven steps.
    fast: ClassVar[float] = 0.3
    most_with_one: ClassVar[int] = 10

    system: Cylinders
    mesh: Mesh
    responses: Any

    def linearise(self, unknowns):
        return linearise(self.system, self.mesh, *unknowns, self.responses)

    def evaluate(self, unknowns):
        return evaluate(self.system, self.mesh, *unknowns, self.responses)

    def solve(self, linear, right_hand_side):
        return solve_bordered(linear, right_hand_side)

    def panels(self, unknowns):
        return unknowns.panels

    def waves(self, unknowns):
        return unknowns.waves

    def border(self, linear):
        return linear.border

    def blank_border(self, unknowns):
        return blank_border(unknowns.waves)

    def keeps_within(self, unknowns):
        return keeps_within(self.system, self.mesh, unknowns.panels, _OF_LAST_TERMS)

    def size(self, step, weights):
        # Whether a step is lost is seen in lifts and angles: a plate that moves fast weighs little.
        size = super().size(step, weights)
        in_scales = super().size(step, jnp.sign(weights))
        return jnp.where(in_scales < self.lost, size, maximum(size, self.lost))


def _amplitude_of(waves: Waves) -> Float[Array, ""]:
    """[-] Largest pressure of waves at any flange, by its root mean square, over that of the line."""
    largest = jnp.zeros(())
    for side in waves:
        if side is not None:
            amplitude = jnp.sqrt(jnp.sum(side.pressure**2, axis=1))
            largest = maximum(largest, max_of(amplitude))
    return largest


def limited(before: Waves, change: Waves) -> Waves:
    """Waves after a change, of which is followed what stays within a tenth of the line's pressure."""
    # a change that is not finite is left out altogether: a share of it would be no number either
    largest = _amplitude_of(change)
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
        _, linear = linearise(self.system, self.mesh, *unknowns)
        panels, waves = jax.tree.map(jnp.negative, residual)
        _, unpacked = _packed(unknowns.waves)
        return solve_bordered(linear, Both(panels, unpacked(waves)))
