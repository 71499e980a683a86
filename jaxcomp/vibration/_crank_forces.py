r"""The forces of the crank on rotor and housing, as harmonics of time.

The rod pushes the crank pin, the gas the cylinder head, the piston the cylinder wall, and the motor
and the main journal turn rotor and stator against each other. All are real forces on real places, with
the friction of the pins, so that force and moment over the machine are minus those of the inertia of
rod and piston, and nothing else. The crank's own unbalance belongs to `Unbalances`.

The frames are the same: x along the cylinder, the crank turns from x to y; the forces of several
cylinders are turned from the axes of each to those of the machine. The harmonics are those of time,
with the crank at angle zero at W t = 0 on the mean; W is the mean speed.

Source: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, Eq. (5), where
polynomials are fitted first; here the forces themselves are integrated.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import of_cylinder
from .._core.errors import BadInput, kind_text
from ..compressor import Compressor, first_top, instants
from ..crank import Orbit
from ..mechanism import SliderCrank, SliderLink, rod_motion
from ..mechanism._slider_link import contact_arms
from ..rotor import CrankNodes, PeriodicForce


class CrankForces(NamedTuple):
    """Loads of one periodic state of the crank.

    Attributes:
        forces: on rod end, head and wall of every cylinder, and of the motor where it was asked for.
        spin_speed: [rad/s] mean speed, at which these forces hold.
        missing: [-] by load, "rod" or "rod_2" of several, what the orders leave out: root mean square of
            the rest over that of the force.
    """

    forces: tuple[PeriodicForce, ...]
    spin_speed: Float[Array, ""]
    missing: dict[str, Float[Array, ""]]


def crank_forces(
    compressor: Compressor,
    state: Orbit,
    nodes: CrankNodes,
    orders: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
) -> CrankForces:
    """Fourier coefficients of the crank's forces, by the quadrature of its own solver.

    Args:
        compressor: with a slider-crank or slider-link.
        state: its periodic state, from `solve_orbit`; its nodes respect the kinks of the gas, and
            the orders should stay well below half their number.
        nodes: where the forces act.
        orders: harmonics to keep, 0 for the mean.

    Raises:
        BadInput: another mechanism.
    """
    mechanism = compressor.mechanism
    crankshaft = compressor.crankshaft
    if not isinstance(mechanism, SliderCrank | SliderLink):
        raise BadInput("mechanism", kind_text(mechanism), "a slider-crank or slider-link")
    angle = state.state.angle
    loss_torques = state.loads.loss_torque
    none = jnp.zeros_like(angle)
    # time counts from the first top dead centre, the phase from the crank at angle zero
    phase = state.mean_speed * state.time + first_top(compressor)
    # The nodes stand in angle; a mean over time weighs them by dt = d(angle)/speed.
    share = state.weight / state.state.speed
    share = share / jnp.sum(share)
    gas_forces = instants(state.under_gas(compressor), angle).gas_force
    cylinder_angles = crankshaft.own_angle(angle)
    of_joints = _rod_and_wall if isinstance(mechanism, SliderCrank) else _slider_and_wall
    forces = []
    missing = {}
    of_pins = set()
    for place, cylinder_nodes in enumerate(nodes.of_cylinders):
        number = place + 1
        single = of_cylinder(mechanism, number)
        cylinder_angle = cylinder_angles[place]
        gas = gas_forces[place]
        joints = {name: crankshaft.joint(name, number) for name in _OF_CYLINDER}
        of_pins |= set(joints.values())
        at = {}
        for name in _PRESSED:
            if joints[name] in state.loads.forces:
                at[name] = state.loads.forces[joints[name]]
        losses = {}
        for name in ("crank_pin", "piston_pin"):
            losses[name] = loss_torques.get(joints[name], none)
        pin, torque, side, lever = of_joints(single, cylinder_angle, at, losses)
        # M_z = x F_y - y F_x about the node of the wall: the friction acts along y = offset.
        lever = lever - nodes.wall_position * side[1] - single.offset * side[0]
        # the gas pushes its head along +x on the line y = offset: M_z = -y F_x
        wrenches = (
            ("rod", pin[0], pin[1], torque),
            ("gas", gas, none, -single.offset * gas),
            ("wall", side[0], side[1], lever),
        )
        c = jnp.cos(crankshaft.bank_angle[place])
        s = jnp.sin(crankshaft.bank_angle[place])
        for node, (name, fx, fy, mz) in zip(cylinder_nodes, wrenches, strict=True):
            # from the axes of the cylinder into those of the machine; mz is the same in both
            along = jnp.stack([c * fx - s * fy, s * fx + c * fy, none])
            table, missing[crankshaft.joint(name, number)] = _harmonics(along, phase, share, orders)
            turning, _ = _harmonics(jnp.stack([none, none, mz]), phase, share, orders)
            forces.append(PeriodicForce(node, None, orders, *table, *turning))
    if nodes.rotor is not None:
        # What brakes the shaft in the crankcase acts between rotor and stator, as the motor does.
        at_shaft = none
        for name, loss_torque in loss_torques.items():
            if name not in of_pins:
                at_shaft = at_shaft + loss_torque
        between = state.motor_torque - at_shaft
        turning = jnp.stack([none, none, between])
        (cosine, sine), missing["motor"] = _harmonics(turning, phase, share, orders)
        zero = jnp.zeros_like(cosine)
        forces.append(PeriodicForce(nodes.rotor, nodes.stator, orders, zero, zero, cosine, sine))
    return CrankForces(tuple(forces), state.mean_speed, missing)


# Joints whose forces act on crank pin and cylinder, and all of a cylinder.
_PRESSED = ("crank_pin", "wall", "wall_crown", "wall_edge", "piston_film")
_OF_CYLINDER = (*_PRESSED, "packing", "piston_pin", "link_slider")


def _rod_and_wall(mechanism: SliderCrank, angle, forces, loss_torques):
    """Forces of a slider-crank on crank and crankcase, in the axes of its cylinder.

    Returns:
        Force on the pin [N] (2, n), its torque on the crank [N m], force on the wall [N] (2, n), and its
        moment [N m] about the shaft but for that of the force along the axis.
    """
    rod = -forces["crank_pin"]
    side = -forces["wall"]
    tilt = rod_motion(mechanism, angle).tilt_1
    # Friction turns the pin against the crank, and the piston (so the wall) along with the rod.
    # A loss torque is power over crank speed; the crank pin slides at 1 + tilt' times that speed,
    # the piston pin at tilt', without which it loses nothing.
    torque = _pin_torque(mechanism, angle, rod) - loss_torques["crank_pin"] / (1 + tilt)
    lever = mechanism.piston(angle)[0] * side[1]
    return rod, torque, side, lever - loss_torques["piston_pin"] / jnp.where(tilt == 0, 1.0, tilt)


def _slider_and_wall(mechanism: SliderLink, angle, forces, loss_torques):
    """Forces of a slider-link on crank and crankcase. The piston touches with opposite sides of its
    diameter.

    With `slider_moment = "paper"` the couple between slider and link is in none of the forces, and
    missing in the moments.
    """
    # joints hold the forces on piston and slider, of which crank and wall feel the opposite
    pin = -forces["crank_pin"]
    torque = _pin_torque(mechanism, angle, pin) - loss_torques["crank_pin"]
    crown = -forces["wall_crown"]
    edge = -forces["wall_edge"]
    at_crown = mechanism.piston(angle)[0]
    at_edge = at_crown - contact_arms(mechanism, angle).engaged
    lever = at_crown * crown[1] + at_edge * edge[1]
    for touch in (crown, edge):
        # the wall is pressed along y where y is on the same side of the axis
        lever = lever - 0.5 * mechanism.bore * jnp.sign(touch[1]) * touch[0]
    return pin, torque, crown + edge - forces["piston_film"], lever


def _pin_torque(mechanism: SliderCrank | SliderLink, angle, force):
    # M_z = x F_y - y F_x at the pin, whose centre lies at r (cos, sin)
    return mechanism.crank_radius * (jnp.cos(angle) * force[1] - jnp.sin(angle) * force[0])


def _harmonics(values: Float[Array, "3 n"], phase, share, orders):
    """Coefficients (orders, 3) of cosine and sine, and the relative size of what is left out."""
    table = []
    for n in orders:
        # The mean of cos^2 over a period is a half, but that of 1 is one.
        table.append((1.0 if n == 0 else 2.0, n * phase))
    # Products with the nodes' weights instead of an FFT, which needs nodes at even steps of time.
    cosine = jnp.stack([f * values @ (share * jnp.cos(p)) for f, p in table])
    sine = jnp.stack([f * values @ (share * jnp.sin(p)) for f, p in table])
    fitted = jnp.zeros_like(values)
    for a, b, (_, p) in zip(cosine, sine, table, strict=True):
        fitted = fitted + a[:, None] * jnp.cos(p) + b[:, None] * jnp.sin(p)
    left_out = jnp.sum(share * (values - fitted) ** 2)
    total = jnp.sum(share * values**2)
    # a load that is zero leaves nothing out
    return (cosine, sine), jnp.sqrt(left_out / jnp.where(total == 0, 1.0, total))
