r"""Orbits: the ellipse of a node from the complex amplitudes of u_x and u_y."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float


class Orbit(NamedTuple):
    """Ellipse u_x + i u_y = F e^{i w t} + B e^{-i w t}.

    Attributes:
        major: [m] semi-major axis, |F| + |B|.
        minor: [m] semi-minor axis with a sign, |F| - |B|: positive in forward whirl.
        inclination: [rad] of the major axis from x, in (-pi/2, pi/2].
        forward: [m] complex amplitude F.
        backward: [m] complex amplitude B.
    """

    major: Array
    minor: Array
    inclination: Array
    forward: Array
    backward: Array


def orbit(x: Complex[Array, "*batch"], y: Complex[Array, "*batch"]) -> Orbit:
    """The orbit of a node.

    Args:
        x: [m] amplitude of u_x, time factor e^{i w t}.
        y: [m] amplitude of u_y.
    """
    forward, backward = (x + 1j * y) / 2, jnp.conj((x - 1j * y) / 2)
    f, b = magnitude(forward), magnitude(backward)
    # Half the angle of F B is that of the major axis; where one of them is zero the orbit is a
    # circle without one.
    product = forward * backward
    circle = product == 0
    angle = jnp.where(circle, 0.0, jnp.angle(jnp.where(circle, 1.0, product)) / 2)
    return Orbit(f + b, f - b, angle, forward, backward)


def magnitude(z: Complex[Array, "*batch"]) -> Float[Array, "*batch"]:
    """|z| with a zero derivative at zero, where that of `abs` is not a number."""
    zero = z == 0
    return jnp.where(zero, 0.0, jnp.abs(jnp.where(zero, 1.0, z)))
