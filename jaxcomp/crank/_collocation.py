r"""Periodic orbit by collocation on Gauss panels: the whole turn at once.

The unknown is the kinetic energy $E = \tfrac12 J\omega^2$ at the nodes. It obeys

$$dE/d\theta = M_D + M_{gas} - M_{loss}(\theta, \omega, \alpha), \qquad
  \alpha = (dE/d\theta - \tfrac12 J'\omega^2)/J .$$

One pass evaluates the torques at all nodes from the last $E$ and $\alpha$, integrates them along the
panels and closes the turn: with a given mean speed by the level of the motor torque and by the energy
at the first edge, with a torque curve by a Newton step in which the slope of the torques over $E$ is
carried along (an implicit step on every panel). Friction depends weakly on the motion, so a pass gains
two to three digits. The panels end at the kinks of the torques, so the error falls exponentially with
the number of nodes, apart from the places in mid-stroke where a load changes its side: those are
located on a first solution and become panel edges as well.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from .._implicit import FixedPointReport, fixed_point
from .._status import Status
from ..compressor import Compressor, conservative_torque, gas_force, kink_angles, loads_at
from ..friction import JointLoads
from ..mechanism import CrankState
from ..motor import MeanSpeed
from ._orbit import Energy, Orbit
from ._panels import Panels, panels
from ._turn import orbit_on_panels

# Kinetic energy over its mean below which the crank counts as stalled.
_ENERGY_FLOOR = 1e-6


class Collocation(eqx.Module):
    """Options of the collocation solver.

    Attributes:
        nodes: Gauss nodes on every panel.
        kinks: how many changes of side in mid-stroke may become panel edges; 0 looks for none.
        grading: how often the panels beside a vanishing pin load are cut again, towards it.
        tolerance: [-] change of the relative kinetic energy at which the passes stop.
        max_passes: passes after which the result is marked as not converged.
    """

    nodes: int = eqx.field(static=True, default=8)
    kinks: int = eqx.field(static=True, default=4)
    grading: int = eqx.field(static=True, default=3)
    tolerance: float = eqx.field(static=True, default=1e-13)
    max_passes: int = eqx.field(static=True, default=80)

    name: ClassVar[str] = "collocation"

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        turn, motion, report = solve_motion(compressor, self)
        now = torques(compressor, turn, motion)
        motor = now.motor
        if isinstance(compressor.motor, MeanSpeed):
            motor = motor_level(turn, now) * motor
        stalled = jnp.min(motion.energy) <= _ENERGY_FLOOR
        status = Status.where(report.settled, Status.converged, Status.not_converged)
        status = Status.where(stalled, Status.stalled, status)
        grid = turn.grid
        loads = loads_at(compressor, now.state, turn.gas_force)
        energy = Energy(
            grid.total(motor),
            -grid.total(turn.conservative),
            {name: grid.total(torque) for name, torque in loads.loss_torque.items()},
        )
        return orbit_on_panels(
            compressor, grid, now.state, motor, loads, energy, status, report, self.name
        )


class Motion(eqx.Module):
    """Solution on the panels, in units of the mean speed and the mean kinetic energy.

    Attributes:
        energy: [-] kinetic energy at the nodes over `energy_scale`.
        acceleration: [-] crank acceleration at the nodes over the square of the speed scale.
        first_energy: [-] kinetic energy at the first edge.
    """

    energy: Float[Array, "p s"]
    acceleration: Float[Array, "p s"]
    first_energy: Float[Array, ""]


class Turn(eqx.Module):
    """All that is known of one turn before anything moves.

    Attributes:
        grid: the panels.
        inertia, inertia_1: [kg m^2] J and J' at the nodes.
        gas_force: [N] at the nodes.
        conservative: [N m] torque of gas and weights at the nodes.
        speed_scale, energy_scale: [rad/s], [J].
    """

    grid: Panels
    inertia: Float[Array, "p s"]
    inertia_1: Float[Array, "p s"]
    gas_force: Float[Array, "p s"]
    conservative: Float[Array, "p s"]
    speed_scale: Float[Array, ""]
    energy_scale: Float[Array, ""]


class Torques(eqx.Module):
    """Everything that a motion implies at the nodes."""

    state: CrankState
    motor: Float[Array, "p s"]  # [N m], at unit level for a given mean speed
    loss: Float[Array, "p s"]  # [N m]


def solve_motion(
    compressor: Compressor, options: Collocation
) -> tuple[Turn, Motion, FixedPointReport]:
    """Find the periodic motion; the report tells whether the passes came to rest."""
    edges = turn_edges(kink_angles(compressor))
    if not (options.kinks and compressor.friction is not None):
        turn = lay_turn(compressor, edges, options.nodes)
        start = lax.stop_gradient(initial_motion(turn))
        return turn, *_iterate(compressor, turn, start, options.tolerance, options.max_passes)

    changes, base, motion = place_changes(lax.stop_gradient(compressor), options)

    def lay(inner):
        return lay_turn(compressor, _merge(edges, _graded(inner, options)), options.nodes)

    def one_pass(unknowns):
        # The edges at the changes of side are unknowns too: the panels follow a change when a
        # parameter moves it, so that derivatives are as accurate as values.
        motion, inner = unknowns
        turn = lay(inner)
        new = _pass(compressor, turn, motion)
        value = _change_values(compressor, turn, new, changes.row, inner)
        moved = jnp.where(changes.row >= 0, inner - value / changes.slope, edges[0])
        return new, moved

    start = lax.stop_gradient((_transfer(base, motion, lay(changes.angle)), changes.angle))
    (motion, inner), report = fixed_point(one_pass, start, options.tolerance, options.max_passes)
    return lay(inner), motion, report


def turn_edges(kinks: Float[Array, " k"]) -> Float[Array, " k_plus_1"]:
    """Close the turn: the first edge once more, a turn later."""
    return jnp.append(kinks, kinks[0] + 2 * jnp.pi)


def lay_turn(compressor: Compressor, edges: Float[Array, " k"], nodes: int) -> Turn:
    """Panels between the edges, with inertia and conservative torques at their nodes."""
    grid = panels(edges, nodes)
    inertia, inertia_1 = compressor.mechanism.inertia(grid.angle)
    force = gas_force(compressor, grid.angle)
    speed = lax.stop_gradient(compressor.motor.speed_guess)
    mean = lax.stop_gradient(grid.total(inertia)) / (2 * jnp.pi)
    return Turn(
        grid,
        inertia,
        inertia_1,
        force,
        conservative_torque(compressor, grid.angle, force),
        speed,
        0.5 * mean * speed**2,
    )


def initial_motion(turn: Turn) -> Motion:
    """Constant speed."""
    energy = 0.5 * turn.inertia * turn.speed_scale**2 / turn.energy_scale
    return Motion(energy, jnp.zeros_like(energy), energy[0, 0])


def torques(compressor: Compressor, turn: Turn, motion: Motion) -> Torques:
    """Motor and loss torques of a motion at the nodes."""
    # A motion that comes to a halt is reported; the floor keeps its numbers finite.
    energy = jnp.maximum(motion.energy, _ENERGY_FLOOR) * turn.energy_scale
    speed = jnp.sqrt(2 * energy / turn.inertia)
    state = CrankState(turn.grid.angle, speed, motion.acceleration * turn.speed_scale**2)
    if compressor.friction is None:
        loss = jnp.zeros_like(speed)
    else:
        loads = loads_at(compressor, state, turn.gas_force, evidence=False)
        loss = loads.total_loss_torque
    return Torques(state, compressor.motor.torque(speed), loss)


def motor_level(turn: Turn, now: Torques) -> Float[Array, ""]:
    """Level of the motor torque that makes the net work of a turn vanish."""
    net = turn.grid.total(now.loss - turn.conservative)
    return net / turn.grid.total(now.motor)


def _iterate(compressor, turn, start, tolerance, max_passes):
    return fixed_point(lambda m: _pass(compressor, turn, m), start, tolerance, max_passes)


def _pass(compressor: Compressor, turn: Turn, motion: Motion) -> Motion:
    if isinstance(compressor.motor, MeanSpeed):
        return _pass_at_mean_speed(compressor, compressor.motor, turn, motion)
    return _pass_on_torque_curve(compressor, turn, motion)


def _pass_at_mean_speed(
    compressor: Compressor, motor: MeanSpeed, turn: Turn, motion: Motion
) -> Motion:
    now = torques(compressor, turn, motion)
    slope = motor_level(turn, now) * now.motor + turn.conservative - now.loss
    gained, _ = turn.grid.cumulative(slope)
    first = _energy_for_period(
        turn,
        gained / turn.energy_scale,
        motion.first_energy,
        2 * jnp.pi / motor.mean_speed,
    )
    return _motion(turn, gained / turn.energy_scale + first, slope, first)


def _energy_for_period(turn: Turn, gained, first, period):
    """Kinetic energy at the first edge for which the turn takes the period.

    Newton's method on period^-2, which is nearly linear in the energy.
    """
    root = jnp.sqrt(turn.inertia / (2 * turn.energy_scale)) * turn.grid.weight
    lowest = lax.stop_gradient(jnp.min(gained))
    first = jnp.maximum(first, 1e-3 * jnp.abs(lowest) - lowest)
    for _ in range(2):
        level = jnp.maximum(gained + first, 1e-6)
        time = jnp.sum(root / jnp.sqrt(level))
        slope = -0.5 * jnp.sum(root / level**1.5)  # d time / d first
        first = first + (time**3 / period**2 - time) / (2 * slope) * -1.0
        first = jnp.maximum(first, 1e-3 * jnp.abs(lowest) - lowest)
    return first


def _pass_on_torque_curve(compressor: Compressor, turn: Turn, motion: Motion) -> Motion:
    scale = turn.energy_scale
    grid = turn.grid

    def slope_at(energy, acceleration):
        now = torques(compressor, turn, Motion(energy, acceleration, motion.first_energy))
        return now.motor + turn.conservative - now.loss

    # The slope of the torques over E only steers the iteration, so it needs no derivative.
    frozen = lax.stop_gradient((motion.energy, motion.acceleration))
    along = (
        jnp.ones_like(frozen[0]),
        -turn.inertia_1 / turn.inertia**2 * scale / turn.speed_scale**2,
    )
    _, steepness = jax.jvp(slope_at, frozen, lax.stop_gradient(along))
    steepness = lax.stop_gradient(steepness) / scale
    slope = slope_at(motion.energy, motion.acceleration)
    # dE/dtheta = slope + steepness (E - E_last), all over `scale`, panel by panel
    rest = slope / scale - steepness * motion.energy
    count = grid.rule.nodes.size
    width = grid.width[:, None, None]
    matrix = jnp.eye(count) - width * grid.rule.integral * steepness[:, None, :]
    right = jnp.stack(
        [jnp.ones_like(rest), grid.width[:, None] * (rest @ grid.rule.integral.T)], axis=-1
    )
    answer = jnp.linalg.solve(matrix, right)  # E at the nodes = answer[0] E_left + answer[1]
    weight = grid.weight
    factor = 1 + jnp.sum(weight * steepness * answer[..., 0], axis=1)
    shift = jnp.sum(weight * (rest + steepness * answer[..., 1]), axis=1)

    def over_panel(left, map_):
        return map_[0] * left + map_[1], left

    total_factor = jnp.prod(factor)
    end_from_zero, _ = lax.scan(over_panel, jnp.zeros(()), (factor, shift))
    first = end_from_zero / (1 - total_factor)
    _, lefts = lax.scan(over_panel, first, (factor, shift))
    energy = answer[..., 0] * lefts[:, None] + answer[..., 1]
    new_slope = (rest + steepness * energy) * scale
    return _motion(turn, energy, new_slope, first)


def _motion(turn: Turn, energy, slope, first) -> Motion:
    floored = jnp.maximum(energy, _ENERGY_FLOOR) * turn.energy_scale
    acceleration = (slope - turn.inertia_1 * floored / turn.inertia) / turn.inertia
    return Motion(energy, acceleration / turn.speed_scale**2, first)


class _Brackets(eqx.Module):
    """Where changes of side were seen: the first kinks, then pinches."""

    low: Float[Array, " k"]
    high: Float[Array, " k"]
    row: Int[Array, " k"]  # which quantity changes; -1 for a place not used


class _Changes(eqx.Module):
    """Changes of side, each with the slope of the quantity that changes."""

    angle: Float[Array, " k"]
    slope: Float[Array, " k"]
    row: Int[Array, " k"]


def place_changes(compressor: Compressor, options: Collocation):
    """The changes of side, with the motion that placed them.

    All rounds have the same shapes, so that they compile once.
    """
    edges = turn_edges(kink_angles(compressor))
    unused = jnp.full(2 * options.kinks, edges[0])
    nowhere = _Brackets(unused, unused, jnp.full(2 * options.kinks, -1))

    def lay(inner):
        return lay_turn(compressor, _merge(edges, _graded(inner, options)), options.nodes)

    def place(round_, carry):
        changes, turn, motion, brackets = carry
        new = lay(changes.angle)
        motion = _transfer(turn, motion, new)
        motion, _ = _iterate(compressor, new, motion, 1e-7, options.max_passes)
        brackets = lax.cond(
            round_ == 0,
            lambda: _find_changes(compressor, new, motion, options.kinks),
            lambda: brackets,
        )
        return _bisect(compressor, new, motion, brackets), new, motion, brackets

    base = lay(unused)
    none = _Changes(unused, jnp.ones_like(unused), nowhere.row)
    changes, turn, motion, _ = lax.fori_loop(
        0, 2, place, (none, base, initial_motion(base), nowhere)
    )
    return changes, turn, motion


def _loads_between(compressor: Compressor, turn: Turn, motion: Motion, angle) -> JointLoads:
    energy = jnp.maximum(turn.grid.interpolate(motion.energy, angle), _ENERGY_FLOOR)
    inertia, _ = compressor.mechanism.inertia(angle)
    speed = jnp.sqrt(2 * energy * turn.energy_scale / inertia)
    acceleration = turn.grid.interpolate(motion.acceleration, angle) * turn.speed_scale**2
    return loads_at(compressor, CrankState(angle, speed, acceleration), evidence=False)


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


def _change_values(compressor, turn: Turn, motion: Motion, row, angle):
    """The quantity of each row at its angle."""
    loads = _loads_between(compressor, turn, motion, angle)
    every = jnp.concatenate([loads.kinks, loads.pinches])
    return jnp.take_along_axis(every, jnp.maximum(row, 0)[None], axis=0)[0]


def _bisect(compressor, turn: Turn, motion: Motion, brackets: _Brackets) -> _Changes:
    """Place the changes. The brackets are widened, since a better motion moves them a little."""
    room = 0.3 * (brackets.high - brackets.low)

    def value(angle):
        return _change_values(compressor, turn, motion, brackets.row, angle)

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
    start = (low, high, value(low), value(high))
    low, high, at_low, at_high = lax.fori_loop(0, 16, halve, start)
    used = brackets.row >= 0
    rise, width = at_high - at_low, high - low
    steep = used & (rise != 0) & (width > 0)
    slope = jnp.where(steep, rise / jnp.where(steep, width, 1.0), 1.0)
    angle = jnp.where(steep, low - at_low / slope, turn.grid.edges[0])
    return _Changes(angle, slope, jnp.where(steep, brackets.row, -1))


def _graded(inner, options: Collocation):
    """Inner edges with the panels beside the pinches cut in geometric progression."""
    kinks, pinches = jnp.split(inner, 2)
    distance = 0.1 * 0.15 ** jnp.arange(options.grading)
    around = jnp.concatenate([-distance, distance, jnp.zeros(1)])
    return jnp.concatenate([kinks, (pinches[:, None] + around).ravel()])


def _merge(edges, inner):
    return jnp.sort(jnp.concatenate([edges, jnp.clip(inner, edges[0], edges[-1])]))


def _transfer(turn: Turn, motion: Motion, to: Turn) -> Motion:
    angle = jnp.clip(to.grid.angle, turn.grid.edges[0], turn.grid.edges[-1])
    rescale = turn.energy_scale / to.energy_scale
    return Motion(
        turn.grid.interpolate(motion.energy, angle) * rescale,
        turn.grid.interpolate(motion.acceleration, angle),
        motion.first_energy * rescale,
    )
