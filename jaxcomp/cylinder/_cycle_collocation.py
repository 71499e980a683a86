r"""The periodic cycle by collocation on panels between events, with the event angles as unknowns.

Panel p begins with the state $y_p$ after whatever jumped there; at its Gauss nodes
$Y_i = y_p + w\sum_j A_{ij} f(\theta_j, Y_j)$, at its end $y_p + w\sum_j b_j f_j$, which the next panel
begins with after the jump of the event there, if any; an event fixes the angle of the edge by
$G(\theta, y) = 0$. What branches hold on a panel and which event ends it are integers, so that one
program serves all designs. Newton's method condenses every panel to its ends and runs once round the
revolution. Derivatives of any order follow from the implicit function theorem with the same blocks.
"""

from abc import abstractmethod
from functools import partial
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.elimination import solve_triangles
from .._core.extremes import max_of, maximum, min_of
from .._core.lookup import row_and_column
from .._core.polynomials import gauss
from .._core.roots import AbstractRoot
from ._cylinder_system import Cylinders
from ._event_panels import Mesh, Unknowns, at_points, highest, last_terms
from ._gas_balance import FLAGS, FREE

# [-] How far an event function may be negative at a node before its branch counts as left.
_LEFT = 1e-6
# [-] The same of the largest lift beyond seat or stop. What a touch costs goes with the root of how far
# the valve would pass: 4e-7 of the flow here.
_PASSED = 1e-9
# [-] A step of Newton's method beyond this has lost the solution.
LOST = 10.0
# [-] Size of a step below which one that shrinks no more is rounding: up to 3e-9 of 130 events.
_ROUNDING = 1e-8


class Residual(NamedTuple):
    """Residual of the equations, shaped as the unknowns they determine."""

    points: Float[Array, "p s+1 n"]
    ends: Float[Array, "p n"]
    events: Float[Array, " p"]


def evaluate(system: Cylinders, mesh: Mesh, z: Unknowns) -> tuple[Residual, Array]:
    """The equations of the periodic cycle, and the event functions."""

    def law(angle, state, flags):
        rates = system.rates(angle, state, flags)
        return rates.state, rates.events

    slopes, events = at_points(law, mesh, z)
    return residual(system, mesh, z, slopes, events), events


def residual(system: Cylinders, mesh: Mesh, z: Unknowns, slopes, events) -> Residual:
    rule = gauss(z.points.shape[1] - 1)
    integral = jnp.asarray(np.vstack([rule.integral, rule.weights]))
    width = jnp.diff(z.edges)[:, None, None]
    # Gauss's rule: slopes at the nodes, integrated up to every node and to the end; the slope at
    # the end, where only the event function counts, is not used
    moved = width * jnp.einsum("ij,pja->pia", integral, slopes[:, :-1])
    jumped = jax.vmap(system.jump)(mesh.event, mesh.code, z.points[:, -1])
    if system.cases.cylinder.walls is not None:
        jumped = jumped.at[-1].set(system.next_revolution(jumped[-1]))
    value = jnp.take_along_axis(events[:, -1], maximum(mesh.event, 0)[:, None], axis=1)[:, 0]
    return Residual(
        z.points - z.left[:, None] - moved,
        # behind the last panel comes the first one, which makes the cycle periodic; an edge
        # without an event stays, and its equation is 0 = 0
        jnp.roll(z.left, -1, axis=0) - jumped,
        jnp.where(mesh.event >= 0, value, 0.0),
    )


class Blocks(NamedTuple):
    """The Jacobian of each panel. Its n + 2 inputs are its beginning and its two edges; m = n s."""

    stages: Float[Array, "p m m"]  # of the nodes
    inputs: Float[Array, "p m n+2"]  # what the inputs put on their right-hand sides
    out: Float[Array, "p n m"]  # from the nodes to the end of the panel
    direct: Float[Array, "p n n+2"]  # from the inputs to it
    jump: Float[Array, "p n n"]
    # gradient of the event function in the state and in the angle
    event: Float[Array, "p n+1"]
    has_event: Bool[Array, " p"]


def linearise(system: Cylinders, mesh: Mesh, z: Unknowns) -> tuple[Residual, Blocks, Array]:
    """The equations, their Jacobian and the event functions, from one evaluation of the law."""
    return assemble(system, mesh, z, *at_points(system.jacobian, mesh, z))


def assemble(system: Cylinders, mesh: Mesh, z: Unknowns, values, slopes_of_state, slopes_of_events):
    """The equations, their Jacobian and the event functions, from what `Cylinders.jacobian` gives."""
    panels = z.points.shape[0]
    s = z.points.shape[1] - 1
    n = z.points.shape[2]
    rule = gauss(s)
    a, b, c = map(jnp.asarray, (rule.integral, rule.weights, rule.nodes))
    slope, events = values
    by_state, by_angle = slopes_of_state
    events_by_state, events_by_angle = slopes_of_events
    remainder = residual(system, mesh, z, slope, events)
    slope = slope[:, :s]
    by_state = by_state[:, :s]
    by_angle = by_angle[:, :s]
    w = jnp.diff(z.edges)[:, None, None]
    # rows (i a) by node and state, columns (j b): the identity less w a_ij times the Jacobian at j
    stages = jnp.eye(s * n) - (
        w[..., None, None] * a[:, None, :, None] * by_state.transpose(0, 2, 1, 3)[:, None]
    ).reshape(panels, s * n, s * n)
    # an edge moves the nodes and changes the width
    moved = [w * by_angle * x[:, None] + sign * slope for x, sign in ((1 - c, -1.0), (c, 1.0))]
    moved = jnp.stack(moved, axis=-1)
    ones = jnp.broadcast_to(jnp.tile(jnp.eye(n), (s, 1)), (panels, s * n, n))
    by_edges = jnp.einsum("ij,pjak->piak", a, moved).reshape(panels, s * n, 2)
    out = jnp.einsum("p,j,pjab->pajb", w[:, 0, 0], b, by_state).reshape(panels, n, s * n)
    direct = jnp.concatenate(
        [jnp.broadcast_to(jnp.eye(n), (panels, n, n)), jnp.einsum("j,pjak->pak", b, moved)], axis=2
    )
    jumps = jax.vmap(jax.jacfwd(system.jump, argnums=2))
    jump_by_state = jumps(mesh.event, mesh.code, z.points[:, -1])
    if system.cases.cylinder.walls is not None:
        # behind the jump at the end of the revolution the wall is warmed: a further factor of the
        # last panel
        turn = jax.jacfwd(system.next_revolution)(z.points[-1, -1])
        jump_by_state = jump_by_state.at[-1].set(turn @ jump_by_state[-1])
    which = maximum(mesh.event, 0)[:, None, None]
    gradient = jnp.concatenate([events_by_state[:, -1], events_by_angle[:, -1, :, None]], axis=2)
    blocks = Blocks(
        stages,
        jnp.concatenate([ones, by_edges], axis=2),
        out,
        direct,
        jump_by_state,
        jnp.take_along_axis(gradient, which, axis=1)[:, 0],
        mesh.event >= 0,
    )
    return remainder, blocks, events


class Factors(NamedTuple):
    """`Blocks`, eliminated: what a right-hand side needs to be solved for."""

    stages: tuple[Array, Array]  # factors and permutation of the nodes' equations
    # (p, n s, n + 2) and (p, n, n + 2) what the nodes and the end of a panel owe to its inputs
    nodes: Float[Array, "p m n+2"]
    ends: Float[Array, "p n n+2"]
    gradient: Float[Array, "p n"]  # of the event function in the state
    # inverse slope of the event function along the angle of the edge, 0 without an event
    share: Float[Array, " p"]
    by_edge: Float[Array, "p n"]  # what the end owes to its edge
    # of the blocks
    out: Float[Array, "p n m"]
    jump: Float[Array, "p n n"]
    # from the beginning of a panel and its angle to those of the next
    maps: Float[Array, "p n+1 n+1"]


def solve_stages(stages: tuple[Array, Array], right_side):
    factors, order = stages
    shuffled = jnp.take_along_axis(right_side, order[:, :, None], axis=1)
    return solve_triangles(factors, shuffled)


def factorise(blocks: Blocks) -> Factors:
    """Condense every panel to its ends."""
    factors, _, order = lax.linalg.lu(blocks.stages)
    return condense(blocks, (factors, order), solve_stages((factors, order), blocks.inputs))


def condense(blocks: Blocks, stages: tuple[Array, Array], nodes: Float[Array, "p m i"]) -> Factors:
    """Condense every panel to its ends, with the equations of its nodes solved.

    Args:
        blocks: of all panels.
        stages: factors and permutation of the nodes' equations.
        nodes: what these owe to the inputs.
    """
    n = blocks.jump.shape[-1]
    ends = blocks.out @ nodes + blocks.direct

    # the edge at the end follows its event, and is no input any more
    gradient = blocks.event[:, :n]
    by_edge = ends[:, :, n + 1]
    slope = jnp.sum(gradient * by_edge, axis=1) + blocks.event[:, n]
    # double where: without an event the slope of the function that stands in its place may be zero
    share = jnp.where(blocks.has_event, 1 / jnp.where(blocks.has_event, slope, 1.0), 0.0)
    edge = -share[:, None] * jnp.einsum("pa,pak->pk", gradient, ends[:, :, : n + 1])
    end = ends[:, :, : n + 1] + by_edge[:, :, None] * edge[:, None]
    maps = jnp.concatenate([blocks.jump @ end, edge[:, None]], axis=1)
    # the angle at which the revolution begins does not move
    maps = maps.at[0, :, n].set(0.0)
    return Factors(stages, nodes, ends, gradient, share, by_edge, blocks.out, blocks.jump, maps)


def _product(a, b):
    """a @ b of small matrices, as a sum: a loop with a matrix product is no single kernel for XLA."""
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def _around(maps: Float[Array, "p m m"], panel_ends: Float[Array, "p m"]) -> Float[Array, "p m"]:
    """The ends x of all panels where each follows from the one before, x_p = A_p x_(p-1) + b_p."""

    def pass_panel(before, panel):
        # one column for what is given, the others for the beginning
        matrix, vector = panel
        after = _product(matrix, before)
        return after.at[:, 0].add(vector), None

    size = maps.shape[-1]
    start = jnp.eye(size, size + 1, k=1)
    revolution, _ = lax.scan(pass_panel, start, (maps, panel_ends))
    # x_0 = R x_0 + r round the revolution: of a cycle with a multiplier of one this has no unique
    # solution
    first = jnp.linalg.solve(jnp.eye(size) - revolution[:, 1:], revolution[:, 0])

    def follow(before, panel):
        matrix, vector = panel
        after = _product(matrix, before[:, None])[:, 0] + vector
        return after, after

    return lax.scan(follow, first, (maps, panel_ends))[1]


def solve_factors(factors: Factors, right_hand_side: Residual) -> Unknowns:
    """Solve the linearised equations; linear in their right-hand side, which is kept apart for that."""
    panels = right_hand_side.points.shape[0]
    s = right_hand_side.points.shape[1] - 1
    n = right_hand_side.points.shape[2]
    own_nodes = solve_stages(
        factors.stages, right_hand_side.points[:, :s].reshape(panels, s * n, 1)
    )
    own_ends = (factors.out @ own_nodes)[:, :, 0] + right_hand_side.points[:, -1]
    own_edge = factors.share * (
        right_hand_side.events - jnp.sum(factors.gradient * own_ends, axis=1)
    )
    own_end = own_ends + factors.by_edge * own_edge[:, None]
    own_new = jnp.einsum("pab,pb->pa", factors.jump, own_end) + right_hand_side.ends
    panel_ends = jnp.concatenate([own_new, own_edge[:, None]], axis=1)

    # one linear operation, whose transpose goes round the other way
    maps = factors.maps
    turned = jnp.roll(maps[::-1], 1, axis=0).transpose(0, 2, 1)
    after = lax.custom_linear_solve(
        lambda x: x - (maps @ jnp.roll(x, 1, axis=0)[:, :, None])[:, :, 0],
        panel_ends,
        lambda _, right_hand_side: _around(maps, right_hand_side),
        lambda _, right_hand_side: _around(turned, right_hand_side[::-1])[::-1],
    )
    states = jnp.roll(after, 1, axis=0).at[0, n].set(0.0)
    edges = jnp.concatenate([states[:, n], jnp.zeros(1)])
    # states at the beginning of each panel, angle of its left and angle of its right edge
    inputs = jnp.concatenate([states, edges[1:, None]], axis=1)
    points = jnp.concatenate([factors.nodes, factors.ends], axis=1) @ inputs[:, :, None]
    points = points[:, :, 0] + jnp.concatenate([own_nodes[:, :, 0], own_ends], axis=1)
    return Unknowns(points.reshape(panels, s + 1, n), states[:, :n], edges)


class NewtonReport(NamedTuple):
    """Report on the end of Newton's method."""

    size: Float[Array, ""]  # [-] of the last step
    steps: Int[Array, ""]  # with a Jacobian of their own
    chord_steps: Int[Array, ""]  # steps with the Jacobian of the one before
    holds: Bool[Array, ""]  # whether all branches hold
    # [rad] where one is left most, infinite where they hold at all nodes
    left_at: Float[Array, ""]
    first: Any  # change of the waves in the first step
    border: Any  # factors of the first linearised equations of the waves


class AbstractEquations(eqx.Module):
    """The equations of a cycle on given panels, as Newton's method wants them."""

    system: eqx.AbstractVar[Cylinders]
    mesh: eqx.AbstractVar[Mesh]
    # [-] A step beyond this has lost the solution.
    lost: ClassVar[float] = LOST
    # [-] A step below this part of the one before is taken with the same Jacobian, so many at most
    # behind the first.
    fast: ClassVar[float] = 0.1
    most_with_one: ClassVar[int] = 6

    @abstractmethod
    def linearise(self, unknowns) -> tuple[Any, Any]:
        """Remainder and linearised equations, factorised."""

    @abstractmethod
    def evaluate(self, unknowns) -> tuple[Any, Array]:
        """Remainder and event functions."""

    @abstractmethod
    def solve(self, linear, right_hand_side) -> Any:
        """Solution of the linearised equations."""

    @abstractmethod
    def panels(self, unknowns) -> Unknowns:
        """The panels among the unknowns, or among their changes."""

    @abstractmethod
    def waves(self, unknowns) -> Any:
        """Waves among the unknowns, or among their changes; `None` without any."""

    def border(self, linear) -> Any:
        """Factors of the linearised equations of the waves; `None` without any."""
        del linear

    def blank_border(self, unknowns) -> Any:
        """An array for each of these factors."""
        del unknowns

    def keeps_within(self, unknowns) -> Bool[Array, ""]:
        """Whether free valves keep between seat and stop between the nodes as well."""
        return keeps_within(self.system, self.mesh, self.panels(unknowns))

    def weights(self, unknowns) -> Float[Array, " n"]:
        """[-] Weights of the states where steps are judged: one over the largest value, one at most.

        The scales of plates are lift and angle. A light plate at low speed moves a thousand times faster
        and its velocity is known to 1e-7, where the cycle is known to 1e-12.
        """
        points = lax.stop_gradient(self.panels(unknowns).points)
        largest = max_of(jnp.abs(points.reshape(-1, points.shape[-1])), axis=0)
        weights = 1 / maximum(1.0, jnp.where(jnp.isfinite(largest), largest, 1.0))
        # the velocity in the port of a shut valve may be anything at the start; it decides nothing
        return weights.at[self.system.columns(4, 7)].set(0.0)

    def size(self, step, weights: Float[Array, " n"]) -> Float[Array, ""]:
        """[-] Largest change of a step, with weights of the states."""
        panels = self.panels(step)
        size = max_of(jnp.abs(panels.points * weights))
        parts = [panels.edges, *jax.tree.leaves(self.waves(step))]
        for part in parts:
            if part.size:
                size = maximum(size, max_of(jnp.abs(part)))
        return jnp.where(jnp.isfinite(size), size, 2 * LOST)


class PanelEquations(AbstractEquations):
    """The equations of a cycle between lines of constant pressure."""

    system: Cylinders
    mesh: Mesh

    def linearise(self, unknowns):
        remainder, blocks, _ = linearise(self.system, self.mesh, unknowns)
        return remainder, factorise(blocks)

    def evaluate(self, unknowns):
        return evaluate(self.system, self.mesh, unknowns)

    def solve(self, linear, right_hand_side):
        return solve_factors(linear, right_hand_side)

    def panels(self, unknowns):
        return unknowns

    def waves(self, unknowns):
        return None


def newton(equations: AbstractEquations, start, tolerance, max_steps: int):
    """The periodic cycle near a start, with its report.

    Every Jacobian serves as long as the steps with it shrink fast: another costs as much as five of
    them.
    """
    lost = equations.lost
    # once and for all steps: with weights that move, sizes of steps could not be compared
    weights = equations.weights(start)

    def falling(size, previous_size, steps):
        going = (size > tolerance) & ((size > _ROUNDING) | (size < 0.3 * previous_size))
        return going & (size < lost) & (steps < max_steps)

    def going_on(carry):
        _, size, previous_size, steps, *_ = carry
        return falling(size, previous_size, steps) & equations.mesh.fits

    def advance(carry):
        unknowns, _, _, steps, chord_steps, _, first, border = carry
        remainder, linear = equations.linearise(unknowns)

        def fast(carry):
            _, _, size, previous_size, count, *_ = carry
            shrinks_fast = (
                (size > tolerance)
                & (size < lost)
                & (size < equations.fast * previous_size)
                & (count <= equations.most_with_one)
            )
            return shrinks_fast | (count == 0)

        def step(carry):
            unknowns, remainder, previous_size, _, count, _, moved = carry
            step = equations.solve(linear, jax.tree.map(jnp.negative, remainder))
            size = equations.size(step, weights)
            # a step that has lost the solution is not taken, so that the unknowns stay finite
            unknowns = jax.tree.map(lambda x, d: jnp.where(size < lost, x + d, x), unknowns, step)
            remainder, events = equations.evaluate(unknowns)
            steps_with_it = count + 1
            branches = branches_of(equations.panels(unknowns), events)
            moved = jax.tree.map(
                lambda new, old: jnp.where(count == 0, new, old), equations.waves(step), moved
            )
            return unknowns, remainder, size, previous_size, steps_with_it, branches, moved

        endless = jnp.asarray(jnp.inf)
        begin = (unknowns, remainder, endless, endless, none, unknown, first)
        unknowns, _, size, before, count, branches, moved = lax.while_loop(fast, step, begin)
        at_first = moved, equations.border(linear)
        at_first = jax.tree.map(partial(jnp.where, steps == 0), at_first, (first, border))
        return unknowns, size, before, steps + 1, chord_steps + count - 1, branches, *at_first

    none = jnp.zeros((), int)
    unknown = Branches(jnp.asarray(False), jnp.asarray(jnp.inf))
    unmoved = jax.tree.map(jnp.zeros_like, equations.waves(start))
    at_first = unmoved, equations.blank_border(start)
    # sizes below the bound, and falling, so that there is a first step in any case
    begin = (start, jnp.asarray(0.1 * lost), jnp.asarray(lost), none, none, unknown, *at_first)
    unknowns, size, _, steps, chord_steps, branches, first, border = lax.while_loop(
        going_on, advance, begin
    )
    report = NewtonReport(
        size=size,
        steps=steps,
        chord_steps=chord_steps,
        holds=branches.hold & equations.keeps_within(unknowns),
        left_at=branches.left_at,
        first=first,
        border=border,
    )
    return unknowns, report


class Branches(NamedTuple):
    """Branches of a solution."""

    hold: Bool[Array, ""]  # whether all do
    left_at: Float[Array, ""]  # [rad] where one is left most; infinite where none is


def branches_of(z: Unknowns, events) -> Branches:
    """Whether every branch holds at every node of a panel with some width, and where not."""
    widths = jnp.diff(z.edges)
    is_wide = (widths > 1e-7)[:, None, None]
    # at the nodes alone: at the end of its panel the function of an event is zero
    least = min_of(jnp.where(is_wide, events[:, :-1], jnp.inf), axis=2)
    panel, node = row_and_column(jnp.argmin(least), least.shape[1])
    angle = z.edges[panel] + widths[panel] * jnp.asarray(gauss(least.shape[1]).nodes)[node]
    is_left = ~(least[panel, node] > -_LEFT)  # NaN included
    # events that have changed places leave a panel of negative width between them
    in_order = jnp.all(widths > -1e-7)
    return Branches(~is_left & in_order, jnp.where(is_left, angle, jnp.inf))


def keeps_within(
    system: Cylinders, mesh: Mesh, z: Unknowns, of_last_terms: float | None = None
) -> Bool[Array, ""]:
    """Whether free valves keep between seat and stop between the nodes as well.

    Args:
        system: the cylinders.
        mesh, z: the panels.
        of_last_terms: [-] how far a lift may pass where its panel does not resolve it, in parts of the
            highest two terms of its polynomial.
    """
    free = (mesh.flags[:, :: FLAGS // 2] == FREE) & (jnp.diff(z.edges) > 1e-7)[:, None]
    # half the stop in the place of valves that rest, which is never beyond
    lift = jnp.where(free[:, None], z.points[..., system.columns(2, 5)], 0.5)
    beyond = jnp.moveaxis(jnp.concatenate([lift - 1, -lift], axis=-1), -1, 0)
    if of_last_terms is None:
        return jnp.all(jax.vmap(highest)(beyond) < _PASSED)
    allowed = maximum(_PASSED, of_last_terms * last_terms(beyond))
    return jnp.all(jax.vmap(highest)(beyond - allowed[..., None]) < 0)


class Attached(AbstractRoot):
    """The equations of a cycle that was found: their root follows the parameters, to any order."""

    system: Cylinders
    mesh: Mesh
    solution: Unknowns

    def solve(self):
        return self.solution

    def residual(self, unknowns):
        return evaluate(self.system, self.mesh, unknowns)[0]

    def newton_correction(self, unknowns, residual):
        _, blocks, _ = linearise(self.system, self.mesh, unknowns)
        return solve_factors(factorise(blocks), jax.tree.map(jnp.negative, residual))
