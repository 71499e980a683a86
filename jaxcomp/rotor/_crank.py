r"""From the crank's periodic state to loads on the rotor and the crankcase.

The rod pushes the crank pin, the gas the cylinder head, the piston the cylinder wall, and the motor
and the main journal turn rotor and stator against each other. All are real forces on real places, with
the friction of the pins, so that force and moment over the machine are minus those of the inertia of
rod and piston, and nothing else. The crank's own unbalance belongs to `Unbalances`.

The frames are the same: x along the cylinder, the crank turns from x to y. The harmonics are those
of time, with the crank at angle zero at W t = 0 on the mean; W is the mean speed.

Source: *Balancing a hermetic single-cylinder refrigeration compressor* (paper 000), Eq. (5), where
polynomials are fitted first; here the forces themselves are integrated. The mean force in the bearings
is its Eq. (6).
"""

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import BadInput
from ..mechanism import SliderCrank, rod_motion
from ._loads import CrankNodes, PeriodicForce
from ._model import RotorModel

if TYPE_CHECKING:  # the crank's solvers are not needed to read their results
    from ..compressor import Compressor
    from ..crank import Orbit


class CrankForces(NamedTuple):
    """Loads of one periodic state of the crank.

    Attributes:
        forces: on rod end, head and wall, and of the motor where it was asked for.
        spin_speed: [rad/s] mean speed, at which these forces hold.
        missing: [-] by load, what the orders leave out: root mean square of the rest over that of
            the force.
    """

    forces: tuple[PeriodicForce, ...]
    spin_speed: Float[Array, ""]
    missing: dict[str, Float[Array, ""]]


def crank_forces(
    compressor: "Compressor",
    state: "Orbit",
    nodes: CrankNodes,
    orders: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
) -> CrankForces:
    """Fourier coefficients of the crank's forces, by the quadrature of its own solver.

    Args:
        compressor: with a slider-crank.
        state: its periodic state, from `solve_orbit`; its nodes respect the kinks of the gas, and
            the orders should stay well below half their number.
        nodes: where the forces act.
        orders: harmonics to keep, 0 for the mean.

    Raises:
        BadInput: another mechanism.
    """
    mechanism = compressor.mechanism
    if not isinstance(mechanism, SliderCrank):
        raise BadInput("mechanism", type(mechanism).__name__, "a slider-crank")
    angle = state.state.angle
    none = jnp.zeros_like(angle)
    position, _, _ = mechanism.piston(angle)
    rod = -state.loads.forces["crank_pin"]
    side = -state.loads.forces["wall"]
    gas = none
    if state.pressure is not None and compressor.gas is not None:
        gas = (state.pressure - compressor.gas.behind_piston) * mechanism.piston_area
    radius, offset = mechanism.crank_radius, mechanism.offset
    # Friction turns the pin against the crank, and the piston (so the wall) along with the rod.
    lost, tilt = state.loads.loss_torque, rod_motion(mechanism, angle).tilt_1
    torque = radius * (jnp.cos(angle) * rod[1] - jnp.sin(angle) * rod[0])
    torque = torque - lost.get("crank_pin", none) / (1 + tilt)
    lever = (position - nodes.wall_position) * side[1] - offset * side[0]
    lever = lever - lost.get("piston_pin", none) / jnp.where(tilt == 0, 1.0, tilt)
    wrenches = {
        nodes.pin: ("rod", rod[0], rod[1], torque),
        nodes.head: ("gas", gas, none, -offset * gas),
        nodes.wall: ("wall", side[0], side[1], lever),
    }
    phase = state.mean_speed * state.time + mechanism.dead_centres()[0]
    share = state.weight / state.state.speed
    share = share / jnp.sum(share)
    forces, missing = [], {}
    for node, (name, fx, fy, mz) in wrenches.items():
        force = jnp.stack([fx, fy, none])
        (cosine, sine), missing[name] = _harmonics(force, phase, share, orders)
        (turning_cosine, turning_sine), _ = _harmonics(
            jnp.stack([none, none, mz]), phase, share, orders
        )
        forces.append(PeriodicForce(node, None, orders, cosine, sine, turning_cosine, turning_sine))
    if nodes.rotor is not None:
        between = state.motor_torque - lost.get("main_journal", none)
        turning = jnp.stack([none, none, between])
        (cosine, sine), missing["motor"] = _harmonics(turning, phase, share, orders)
        zero = jnp.zeros_like(cosine)
        forces.append(PeriodicForce(nodes.rotor, nodes.stator, orders, zero, zero, cosine, sine))
    return CrankForces(tuple(forces), state.mean_speed, missing)


def loaded_films(model: RotorModel, nodes: CrankNodes, forces: CrankForces) -> RotorModel:
    """The model with its film bearings under the mean force of the rod at this state.

    Paper 000, Eqs (6) and (7): each bearing of `nodes.bearings` carries its share of the mean rod
    force as its static load, whose Sommerfeld number sets stiffness and damping.

    Args:
        model: with the links that `nodes` names.
        nodes: the bearings and their shares.
        forces: of `crank_forces`, with order 0 among the orders.

    Raises:
        BadInput: forces without order 0.
    """
    rod = forces.forces[0]
    if 0 not in rod.orders:
        raise BadInput("orders", str(rod.orders), "with 0, the mean force that loads the bearings")
    if not nodes.bearings:
        return model
    mean = rod.cosine[rod.orders.index(0), :2]
    share = nodes.bearing_share
    share = jnp.full(len(nodes.bearings), 0.5) if share is None else share
    return eqx.tree_at(
        lambda m: [m.links[number].law.load for number in nodes.bearings],
        model,
        [part * mean for part in share],
    )


def _harmonics(values: Float[Array, "3 n"], phase, share, orders):
    """Coefficients (orders, 3) of cosine and sine, and the relative size of what is left out."""
    table = [((1.0 if n == 0 else 2.0), n * phase) for n in orders]
    cosine = jnp.stack([f * values @ (share * jnp.cos(p)) for f, p in table])
    sine = jnp.stack([f * values @ (share * jnp.sin(p)) for f, p in table])
    kept = sum(
        a[:, None] * jnp.cos(p) + b[:, None] * jnp.sin(p)
        for a, b, (_, p) in zip(cosine, sine, table, strict=True)
    )
    rest, whole = (jnp.sum(share * v**2) for v in (values - kept, values))
    return (cosine, sine), jnp.sqrt(rest / jnp.where(whole == 0, 1.0, whole))
