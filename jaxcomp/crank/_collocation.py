"""Periodic orbit by collocation on Gauss panels: the whole turn at once.

The panels end at the kinks of the torques, so the error falls exponentially with the number of
nodes, apart from the places in mid-stroke where a load changes its side: those are located on a
first solution and become panel edges as well, which move with the solution.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._implicit import FixedPointReport, fixed_point
from .._status import Status
from ..compressor import Compressor, kink_angles, loads_at
from ..motor import MeanSpeed
from ._changes import Resolution, change_values, lay_with_changes, place_changes
from ._orbit import Energy, Orbit
from ._passes import (
    ENERGY_FLOOR,
    Motion,
    Turn,
    better_motion,
    initial_motion,
    iterate,
    lay_turn,
    motor_level,
    resolved_turn,
    steepness,
    torques,
    transfer,
    turn_edges,
)
from ._turn import orbit_on_panels

# [-] Change of the duration of a turn with twice the nodes beyond which the turn counts as not resolved.
# Ordinary turns stay below 1e-5 with 8 nodes on a panel, and below 1e-4 with 5.
_PERIOD_ERROR = 1e-3


class Collocation(eqx.Module):
    """Options of the collocation solver.

    Attributes:
        nodes: Gauss nodes on every panel.
        kinks: how many changes of side in mid-stroke may become panel edges; 0 looks for none.
        grading: how often the panels beside a vanishing pin load are cut again, towards it.
        tolerance: [-] change of the relative kinetic energy at which the passes stop. Given as an
            array, all tolerances share one compiled program.
        max_passes: passes after which the result is marked as not converged.
    """

    nodes: int = eqx.field(static=True, default=8)
    kinks: int = eqx.field(static=True, default=4)
    grading: int = eqx.field(static=True, default=3)
    tolerance: float | Float[Array, ""] = 1e-13
    max_passes: int = eqx.field(static=True, default=80)

    name: ClassVar[str] = "collocation"

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        turn, motion, report = solve_motion(compressor, self)
        now = torques(compressor, turn, motion)
        loads = loads_at(compressor, now.state, turn.gas_force)
        settled = report.settled & loads.agrees(now.loss)
        # The accounts are of these loads, which are a little finer than those of the passes.
        now = eqx.tree_at(lambda t: t.loss, now, loads.total_loss_torque)
        motor = now.motor
        status = Status.where(settled, Status.converged, Status.not_converged)
        period = turn.grid.total(1 / now.state.speed)
        finer_period, lowest = resolved_turn(*lax.stop_gradient((compressor, turn, motion)))
        resolved = jnp.abs(finer_period - period) < _PERIOD_ERROR * period
        status = Status.where(settled & ~resolved, Status.unresolved, status)
        stalled = lowest <= ENERGY_FLOOR
        if isinstance(compressor.motor, MeanSpeed):
            motor = motor_level(turn, now) * motor
            # No level of torque turns a crank slower than it needs to get over the compression.
            stalled |= ~(period * compressor.motor.mean_speed > 0.999 * 2 * jnp.pi)
        else:
            growth = turn.grid.total(steepness(compressor, turn, motion))
            status = Status.where(growth < 0, status, Status.no_periodic_state)
        status = Status.where(stalled, Status.stalled, status)
        grid = turn.grid
        energy = Energy(
            grid.total(motor),
            -grid.total(turn.conservative),
            {name: grid.total(torque) for name, torque in loads.loss_torque.items()},
        )
        return orbit_on_panels(
            compressor, grid, now.state, motor, loads, energy, status, report, self.name
        )


def solve_motion(
    compressor: Compressor, options: Collocation
) -> tuple[Turn, Motion, FixedPointReport]:
    """Find the periodic motion; the report tells whether the passes came to rest."""
    edges = turn_edges(kink_angles(compressor))
    if not (options.kinks and compressor.friction is not None):
        turn = lay_turn(compressor, edges, options.nodes)
        start = lax.stop_gradient(initial_motion(turn))
        return turn, *iterate(compressor, turn, start, options.tolerance, options.max_passes)

    resolution = Resolution(options.nodes, options.kinks, options.grading, options.max_passes)
    changes, base, motion = place_changes(lax.stop_gradient(compressor), resolution)

    def lay(inner):
        return lay_with_changes(compressor, edges, inner, resolution)

    def one_pass(unknowns):
        # The edges at the changes of side are unknowns too: the panels follow a change when a
        # parameter moves it, so that derivatives are as accurate as values.
        motion, inner = unknowns
        turn = lay(inner)
        new = better_motion(compressor, turn, motion)
        value = change_values(compressor, turn, new, changes.row, inner)
        moved = jnp.where(changes.row >= 0, inner - value / changes.slope, edges[0])
        return new, moved

    start = lax.stop_gradient((transfer(base, motion, lay(changes.angle)), changes.angle))
    (motion, inner), report = fixed_point(one_pass, start, options.tolerance, options.max_passes)
    return lay(inner), motion, report
