r"""Resultant force and moment of all moving parts on the block, by d'Alembert.

The wrench is minus the rate of change of the momentum and of the angular momentum of everything
that moves. It holds whatever the gas, the motor and the friction do, because these act within the
machine; the reaction of the stator is in it. Axes of the mechanism: x along the cylinder towards
the head, y across, z along the shaft, rotation from x to y.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (36)-(41); (39) and (40) with $m_s R^2\ddot\varphi$ where the print has $m_s R\ddot\varphi$.
"""

from functools import singledispatch
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compressor import Compressor
from ..mechanism import (
    AbstractMechanism,
    CrankState,
    SliderCrank,
    SliderLink,
    Vector,
    rod_motion,
    rotating,
)
from ..mechanism._mechanism import cross


class Wrench(NamedTuple):
    """Force and moment on the block in x, y, z.

    Attributes:
        force: [N] (3, n)
        moment: [N m] (3, n)
    """

    force: Float[Array, "3 *n"]
    moment: Float[Array, "3 *n"]


@singledispatch
def shaking_wrench(mechanism: AbstractMechanism | Compressor, state: CrankState) -> Wrench:
    """Inertia forces of all moving parts on the block, in the axes of the machine.

    Moments are about all three axes through the origin of the crankshaft, `Crankshaft.origin`. Of a
    mechanism alone they are those of its linkage, without the crankshaft, in the plane of motion.

    Args:
        mechanism: a compressor, or the mechanism of one cylinder.
        state: angle, speed and acceleration of the crank, shape (n,).

    Raises:
        TypeError: for a mechanism whose shaking forces are not known.
    """
    raise TypeError(f"No shaking forces are known for a {type(mechanism).__name__}.")


def _in_plane(force: Float[Array, "2 *n"], moment: Float[Array, "*n"]) -> Wrench:
    # one cylinder's forces lie in its plane; its tilting moments come with its place along the shaft
    zero = jnp.zeros_like(moment)
    return Wrench(jnp.concatenate([force, zero[None]]), jnp.stack([zero, zero, moment]))


@shaking_wrench.register
def _(mechanism: SliderLink, state: CrankState) -> Wrench:
    # U = w^2 cos + a sin, V = w^2 sin - a cos
    _, second = rotating(*state)
    u = -second[0]
    v = -second[1]
    static_moment_along = (mechanism.piston_mass + mechanism.slider_mass) * mechanism.crank_radius
    static_moment_across = mechanism.slider_mass * mechanism.crank_radius
    # e - e_cl of Eq. (40): the mass centre of the piston lies at y = -arm
    arm = -mechanism.offset - mechanism.piston_centre_offset
    turning = mechanism.piston_mass * mechanism.crank_radius * arm * u
    moment = turning - static_moment_across * mechanism.crank_radius * state.acceleration
    # Eq. (40) but for J_z and the crankshaft's unbalance, which the compressor adds.
    return _in_plane(jnp.stack([static_moment_along * u, static_moment_across * v]), moment)


@shaking_wrench.register
def _(mechanism: SliderCrank, state: CrankState) -> Wrench:
    rod = rod_motion(mechanism, state.angle)
    small_end = mechanism.conrod_centre / mechanism.conrod_length  # weight of the small end, b/l
    direction, second = rotating(*state)
    piston_acceleration = rod.position_1 * state.acceleration + rod.position_2 * state.speed**2
    tilt_acceleration = rod.tilt_1 * state.acceleration + rod.tilt_2 * state.speed**2
    offset = jnp.broadcast_to(mechanism.offset, rod.position.shape)
    # the mass centre lies on the line of the eyes, between pin and piston: the lever's shares are exact
    at_pin = (1 - small_end) * mechanism.crank_radius
    centre = at_pin * direction + small_end * jnp.stack([rod.position, offset])
    centre_acceleration = (at_pin * second).at[0].add(small_end * piston_acceleration)

    piston = mechanism.piston_mass * piston_acceleration
    conrod = mechanism.conrod_mass * centre_acceleration
    # the rod turns at -d(tilt)/dt; the piston's force acts along y = offset
    turning = cross(centre, conrod) - mechanism.conrod_inertia * tilt_acceleration
    return _in_plane(-conrod.at[0].add(piston), offset * piston - turning)


@shaking_wrench.register
def _(compressor: Compressor, state: CrankState) -> Wrench:
    return _of_compressor(compressor, state)


@eqx.filter_jit  # one program instead of sixty
def _of_compressor(compressor: Compressor, state: CrankState) -> Wrench:
    crankshaft = compressor.crankshaft
    cylinder_state = CrankState(crankshaft.own_angle(state.angle), state.speed, state.acceleration)
    wrenches = shaking_wrench(crankshaft.each(compressor.mechanism, state.angle), cylinder_state)
    second = Vector(*rotating(*state)[1])
    # all of the force, and all of its moment: sums of m a and of z m a over the unbalances
    pulls = crankshaft.crank_pulls(second, compressor.mechanism, [(1.0, 0.0), (0.0, 1.0)])
    pull, tilting = (vector.stacked() for vector in pulls)
    force = crankshaft.turned(Vector(wrenches.force[0], wrenches.force[1])).stacked()
    place = crankshaft.along(crankshaft.position, state.angle)
    total = jnp.sum(force, axis=1) - pull
    # sum of z F, from the origin
    levered = jnp.sum(place * force, axis=1) - tilting - crankshaft.origin * total
    # r x F of a force across the shaft: M_x = -z F_y, M_y = z F_x.
    assert crankshaft.inertia is not None
    turning = jnp.sum(wrenches.moment[2], axis=0) - crankshaft.inertia * state.acceleration
    return Wrench(
        jnp.stack([*total, jnp.zeros_like(turning)]), jnp.stack([-levered[1], levered[0], turning])
    )


def wrench_about(wrench: Wrench, point: Float[Array, "3"]) -> Wrench:
    """This wrench with its moment about another point [m] (Eq. 41), M - r x F."""
    point = jnp.asarray(point)
    lever = jnp.cross(point, wrench.force, axisb=0, axisc=0)
    return Wrench(wrench.force, wrench.moment - lever)
