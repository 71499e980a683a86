r"""A crank that turns at a given constant speed: nothing is solved, everything is evaluated.

With $\omega$ constant the equation of motion gives the torque that holds it,
$M_D = \tfrac12 J'(\theta)\,\omega^2 - M_{gas} + M_{loss}(\theta,\omega,0)$.
"""

import jax.numpy as jnp
from jax import lax

from .._implicit import FixedPointReport
from .._status import Status
from ..compressor import Compressor, kink_angles, loads_at
from ..mechanism import CrankState
from ..motor import ConstantSpeed
from ._changes import Resolution, change_values, changes_of, lay_with_changes
from ._orbit import Energy, Orbit
from ._passes import Motion, Turn, initial_motion, lay_turn, turn_edges
from ._turn import orbit_on_panels


def orbit_at_given_speed(
    compressor: Compressor, motor: ConstantSpeed, resolution: Resolution
) -> Orbit:
    """The turn of an admissible compressor at the speed of its motor.

    Args:
        compressor: the machine.
        motor: its motor.
        resolution: of the panels; `kinks=0` places no edges at changes of side.
    """
    turn = _turn(compressor, resolution)
    grid = turn.grid
    speed = jnp.full_like(grid.angle, motor.mean_speed)
    state = CrankState(grid.angle, speed, jnp.zeros_like(speed))
    loads = loads_at(compressor, state, turn.gas_force)
    torque = 0.5 * turn.inertia_1 * speed**2 - turn.conservative + loads.total_loss_torque
    energy = Energy(
        grid.total(torque),
        -grid.total(turn.conservative),
        {name: grid.total(loss) for name, loss in loads.loss_torque.items()},
    )
    nothing = FixedPointReport(jnp.asarray(0), jnp.zeros(()), jnp.asarray(True))
    return orbit_on_panels(
        compressor,
        grid,
        state,
        torque,
        loads,
        energy,
        Status.converged,
        nothing,
        "given speed",
    )


def _turn(compressor: Compressor, resolution: Resolution) -> Turn:
    """Panels between the kinks; with friction, edges at the changes of side, which follow them."""
    edges = turn_edges(kink_angles(compressor))
    plain = lay_turn(compressor, edges, resolution.nodes)
    if not (resolution.kinks and compressor.friction is not None):
        return plain
    frozen, coarse = lax.stop_gradient((compressor, plain))
    changes = changes_of(frozen, coarse, _motion(frozen, coarse), resolution.kinks)

    def closer(machine, turn, angle):
        value = change_values(machine, turn, _motion(machine, turn), changes.row, angle)
        return jnp.where(changes.row >= 0, angle - value / changes.slope, edges[0])

    # The first step polishes the place, the second lets the edge move with the parameters.
    angle = lax.stop_gradient(closer(frozen, coarse, changes.angle))
    return lay_with_changes(compressor, edges, closer(compressor, plain, angle), resolution)


def _motion(compressor: Compressor, turn: Turn) -> Motion:
    """The given speed, in the units of the turn, which do not follow it in derivatives."""
    share = compressor.motor.speed_guess / turn.speed_scale
    start = initial_motion(turn)
    return Motion(start.energy * share**2, start.acceleration, start.first_energy * share**2)
