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

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compressor import Compressor, without_crank
from ..mechanism import (
    AbstractMechanism,
    CrankState,
    SliderCrank,
    SliderLink,
    Vector,
    crank_pull,
    rod_motion,
    turned_with,
)
from ..mechanism._base import cross, rotating


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
    """Inertia forces of a mechanism on its block, about the origin of the mechanism's axes.

    Of a compressor they are those of its mechanism; with several cylinders those of all of them, in
    the axes of the machine with the origin on the shaft at z = 0, moments about all three axes.

    For a slider-link machine the origin lies on the shaft in the plane of the machine's mass
    centre. For a slider-crank it lies in the plane of motion, and the moment has a z-component
    only; move it with `wrench_about` by (0, 0, z) to an origin z below that plane.

    Args:
        mechanism: masses and geometry; or a compressor with several cylinders.
        state: angle, speed and acceleration of the crank, shape (n,).

    Raises:
        TypeError: for a mechanism whose shaking forces are not known.
    """
    raise TypeError(f"No shaking forces are known for a {type(mechanism).__name__}.")


@shaking_wrench.register
def _(mechanism: SliderLink, state: CrankState) -> Wrench:
    # U = w^2 cos + a sin, V = w^2 sin - a cos
    _, second = rotating(*state)
    minus = u, v = Vector(-second[0], -second[1])
    along = (mechanism.piston_mass + mechanism.slider_mass) * mechanism.crank_radius
    across = mechanism.slider_mass * mechanism.crank_radius
    pull = turned_with(mechanism.crank_unbalance, mechanism.crank_unbalance_across, minus)
    tilt = turned_with(mechanism.product_of_inertia, mechanism.product_of_inertia_across, minus)
    height, arm = mechanism.plane_height, -mechanism.offset - mechanism.piston_centre_offset
    with_shaft = mechanism.crank_inertia + across * mechanism.crank_radius
    force = [along * u + pull.x, across * v + pull.y, jnp.zeros_like(u)]
    moment = [
        across * height * v - tilt.y,
        tilt.x - along * height * u,
        -with_shaft * state.acceleration + mechanism.piston_mass * mechanism.crank_radius * arm * u,
    ]
    return Wrench(jnp.stack(force), jnp.stack(moment))


@shaking_wrench.register
def _(mechanism: SliderCrank, state: CrankState) -> Wrench:
    rod = rod_motion(mechanism, state.angle)
    big_end = mechanism.conrod_centre / mechanism.conrod_length  # weight of the small end, b/l
    direction, second = rotating(*state)
    piston_acceleration = rod.position_1 * state.acceleration + rod.position_2 * state.speed**2
    tilt_acceleration = rod.tilt_1 * state.acceleration + rod.tilt_2 * state.speed**2
    offset = jnp.broadcast_to(mechanism.offset, rod.position.shape)
    at_pin = (1 - big_end) * mechanism.crank_radius
    centre = at_pin * direction + big_end * jnp.stack([rod.position, offset])
    centre_acceleration = (at_pin * second).at[0].add(big_end * piston_acceleration)

    piston = mechanism.piston_mass * piston_acceleration
    conrod = mechanism.conrod_mass * centre_acceleration
    pull = crank_pull(mechanism, Vector(*second)).stacked()
    force = -(conrod + pull).at[0].add(piston)
    # the rod turns at -d(tilt)/dt; the piston's force acts along y = offset
    moment = -(
        mechanism.crank_inertia * state.acceleration
        + cross(centre, conrod)
        - mechanism.conrod_inertia * tilt_acceleration
        - offset * piston
    )
    zero = jnp.zeros_like(moment)
    return Wrench(jnp.concatenate([force, zero[None]]), jnp.stack([zero, zero, moment]))


@shaking_wrench.register
def _(compressor: Compressor, state: CrankState) -> Wrench:
    cylinders, mechanism = compressor.cylinders, compressor.mechanism
    if cylinders is None:
        return shaking_wrench(mechanism, state)
    single = without_crank(compressor)
    own = state._replace(angle=cylinders.own_angle(state.angle))
    each = shaking_wrench(cylinders.each(single, state.angle), own)
    pull, tilting = cylinders.crank_pulls(state, mechanism, [(1.0, 0.0), (0.0, 1.0)])
    force = cylinders.turned(Vector(each.force[0], each.force[1])).stacked()
    place = cylinders.along(cylinders.position, state.angle)
    total = jnp.sum(force, axis=1) - pull.stacked()
    levered = jnp.sum(place * force, axis=1) - tilting.stacked()  # sum of z F
    turning = jnp.sum(each.moment[2], axis=0) - mechanism.crank_inertia * state.acceleration
    return Wrench(
        jnp.stack([*total, jnp.zeros_like(turning)]), jnp.stack([-levered[1], levered[0], turning])
    )


def wrench_about(wrench: Wrench, point: Float[Array, "3"]) -> Wrench:
    """The same wrench with its moment about another point [m] (Eq. 41), M - r x F."""
    point = jnp.asarray(point)
    lever = jnp.cross(point, wrench.force, axisb=0, axisc=0)
    return Wrench(wrench.force, wrench.moment - lever)


class HalfBalance(NamedTuple):
    """Balance of the crank that makes forces and moments equal in x and y.

    Attributes:
        crank_eccentricity: [m] e_cr.
        crank_product: [kg m^2] about the piston plane, as in `SliderLink`.
    """

    crank_eccentricity: Float[Array, ""]
    crank_product: Float[Array, ""]


def half_balance(mechanism: SliderLink) -> HalfBalance:
    r"""Counterweight that takes half the piston's first harmonic.

    $m_r e_{cr} = (m_s + m_p/2)R$ and $J_{xz} = (m_s + m_p/2) R z_s$: one rotating weight cannot do
    better than turn the force along x into one of half the size that rotates backwards.

    Args:
        mechanism: needs a crank mass; its present balance does not matter.
    """
    unbalance = mechanism.half_balance
    # J_xz = crank_product + z_s m_r e_cr, which leaves nothing about the piston plane
    return HalfBalance(unbalance / mechanism.crank_mass, jnp.zeros_like(unbalance))
