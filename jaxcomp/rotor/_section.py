r"""Circular sections: area, second moments, shear coefficient."""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

ShearLaw = Literal["cowper", "hutchinson", "constant"]
SHEAR_LAWS = ("cowper", "hutchinson", "constant")


def area(outer: Float[Array, "*n"], inner: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[m2] Area between two diameters [m]."""
    return jnp.pi / 4 * (outer**2 - inner**2)


def second_moment(outer: Float[Array, "*n"], inner: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[m4] Second moment about a diameter; the polar one is twice that."""
    return jnp.pi / 64 * (outer**4 - inner**4)


def shear_coefficient(
    law: ShearLaw,
    outer: Float[Array, "*#n"],
    inner: Float[Array, "*#n"],
    poisson: Float[Array, "*#n"],
    constant: Float[Array, "*#n"],
) -> Float[Array, "*#n"]:
    r"""Shear coefficient of a hollow circle; the effective shear area is this times the area.

    `"cowper"`: G. R. Cowper (1966), The shear coefficient in Timoshenko's beam theory, J. Appl.
    Mech. 33, hollow circle, with m = inner/outer,
    $6(1+\nu)(1+m^2)^2 / [(7+6\nu)(1+m^2)^2 + (20+12\nu)m^2]$.

    `"hutchinson"`: J. R. Hutchinson (2001), Shear coefficients for Timoshenko beam theory, J. Appl.
    Mech. 68, hollow circle, in units of the outer radius,
    $6(1+\nu)^2(1+m^2)^2 / [7+34m^2+7m^4 + \nu(12+48m^2+12m^4) + \nu^2(4+16m^2+4m^4)]$.

    `"constant"`: the given number.

    Args:
        law: which of the three.
        outer: [m] outer diameter.
        inner: [m] inner diameter.
        poisson: [-] Poisson's ratio.
        constant: [-] the value for `"constant"`.
    """
    if law == "constant":
        return jnp.broadcast_to(constant, jnp.shape(outer))
    m2 = (inner / outer) ** 2
    s = (1 + m2) ** 2
    if law == "cowper":
        return 6 * (1 + poisson) * s / ((7 + 6 * poisson) * s + (20 + 12 * poisson) * m2)
    ring = 1 + 4 * m2 + m2**2
    lead = 7 + 34 * m2 + 7 * m2**2
    return 6 * (1 + poisson) ** 2 * s / (lead + 12 * poisson * ring + 4 * poisson**2 * ring)
