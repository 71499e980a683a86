"""One revolution at many more angles than a solver needs, so that curves look as smooth as they are."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import of_cylinder
from .._core.polynomials import cubics
from ..compressor import (
    Compressor,
    crank_end_pressure,
    cylinder_pressure,
    kink_angles,
    mechanisms_of,
)
from ..crank import Orbit
from ..crank._crank_motion import acceleration
from ..crank._journals import orbiting_journals, with_journals
from ..friction import JointLoads
from ..mechanism import CrankState

_SAMPLES = 720
# Both sides of a kink are drawn, so that jumps stand upright and corners are sharp.
_BESIDE_KINK = 1e-7


class FineTurn(NamedTuple):
    """The turn at n rising angles; quantities and units as in `Orbit`."""

    state: CrankState
    pressure: Float[Array, "k n"] | None
    gas_torque: Float[Array, " n"]
    motor_torque: Float[Array, " n"]
    loads: JointLoads


@eqx.filter_jit
def fine_turn(
    compressor: Compressor, orbit: Orbit, angle: Float[Array, " n"] | None = None
) -> FineTurn:
    """Evaluate the laws of the machine between the nodes of its orbit.

    The speed is the cubic through the nodes with the slope that the acceleration gives; everything
    else follows from speed and angle.

    Args:
        compressor: whose orbit it is.
        orbit: the periodic state.
        angle: [rad] of the crank; a revolution from the first kink, with both sides of each, if absent.
    """
    compressor = orbit.under_gas(compressor)
    if angle is None:
        kinks = kink_angles(compressor)
        even = kinks[0] + jnp.linspace(0.0, 2 * jnp.pi, _SAMPLES + 1)
        angle = jnp.sort(jnp.concatenate([even, kinks - _BESIDE_KINK, kinks + _BESIDE_KINK]))
    nodes, speeds, rises = orbit.state
    speed = _periodic_cubic(angle, nodes, speeds, rises / speeds)
    motor = jnp.interp(angle, nodes, orbit.motor_torque, period=2 * jnp.pi)
    journals = None
    if orbit.positions is not None:
        positions = []
        for journal in orbiting_journals(compressor):
            positions.append(orbit.positions[journal.joint])
        places = jnp.stack(positions, axis=1)
        at = partial(jnp.interp, angle, nodes, period=2 * jnp.pi)
        flat = jax.vmap(lambda row: at(row))(places.reshape(-1, nodes.size))
        journals = flat.reshape(*places.shape[:2], -1)

    def evaluated(angle, speed, motor, journals):
        return acceleration(with_journals(compressor, journals), angle, speed, motor)

    journal_axis = None if journals is None else -1
    over_angles = jax.vmap(evaluated, (0, 0, 0, journal_axis))
    rise, gas_torque, loads = over_angles(angle, speed, motor, journals)
    # mapped over angles, forces come out as (n, 2); figures want them as orbits have them
    forces = {name: force.T for name, force in loads.forces.items()}
    loads = eqx.tree_at(lambda x: x.forces, loads, forces)
    pressure = None
    if compressor.gas is not None:
        pressure = cylinder_pressure(compressor, angle)
    return FineTurn(
        state=CrankState(angle, speed, rise),
        pressure=pressure,
        gas_torque=gas_torque,
        motor_torque=motor,
        loads=loads,
    )


def first_diagram(
    compressor: Compressor, turn: FineTurn
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """[m^3], [Pa] Displaced volume and pressure of the first cylinder; the revolution must have gas."""
    assert turn.pressure is not None
    mechanism = of_cylinder(compressor.mechanism)
    angle = turn.state.angle + compressor.crankshaft.phase[0]
    pressure = turn.pressure[0]
    top = mechanism.piston_extremes()[0]
    return mechanism.piston_area * (top - mechanism.piston(angle)[0]), pressure


class EndDiagram(NamedTuple):
    """Indicator diagram of one end of a double-acting cylinder.

    Attributes:
        cylinder: its number, from 1.
        end: "head" or "crank".
        volume: [m^3] (n,) that the piston displaces there.
        pressure: [Pa] (n,)
    """

    cylinder: int
    end: str
    volume: Float[Array, " n"]
    pressure: Float[Array, " n"]


def diagrams_of_ends(compressor: Compressor, orbit: Orbit, turn: FineTurn) -> list[EndDiagram]:
    """Indicator diagrams of both ends of all cylinders; none of cylinders that act on one side.

    Args:
        compressor: whose orbit it is.
        orbit: the periodic state.
        turn: of `fine_turn`.
    """
    solved = orbit.under_gas(compressor)
    behind = crank_end_pressure(solved, turn.state.angle)
    if behind is None or turn.pressure is None:
        return []
    gas: Any = solved.gas
    rods = jnp.broadcast_to(jnp.pi / 4 * gas.rod_diameter**2, behind.shape[:1])
    diagrams = []
    for number, mechanism in enumerate(mechanisms_of(compressor)):
        angle = turn.state.angle + compressor.crankshaft.phase[number]
        top, bottom = mechanism.piston_extremes()
        position = mechanism.piston(angle)[0]
        head = mechanism.piston_area * (top - position)
        crank = (mechanism.piston_area - rods[number]) * (position - bottom)
        diagrams.append(EndDiagram(number + 1, "head", head, turn.pressure[number]))
        diagrams.append(EndDiagram(number + 1, "crank", crank, behind[number]))
    return diagrams


def _periodic_cubic(x, knots, values, slopes):
    # a knot of the neighbouring revolutions at each end, so that no interval is left out
    turn = 2 * jnp.pi
    knots = jnp.concatenate([knots[-1:] - turn, knots, knots[:1] + turn])
    values = jnp.concatenate([values[-1:], values, values[:1]])
    slopes = jnp.concatenate([slopes[-1:], slopes, slopes[:1]])
    x = knots[1] + jnp.mod(x - knots[1], turn)
    return cubics(x, knots, values, slopes)
