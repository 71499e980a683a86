"""Limits of pulsation of API Standard 618, fifth edition (2007), section 7.9.

Peak to peak in parts of the mean absolute pressure. At the flange of the cylinder of the unfiltered
pulsation, on the side of the line of each component by itself; the two are not mixed.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import minimum


def flange_limit(pressure_ratio: Float[Array, ""] | float) -> Float[Array, ""]:
    """Allowed pulsation [-] at the cylinder's flange, unfiltered: the lesser of 7 % and 3 R %.

    Args:
        pressure_ratio: [-] R of the stage.
    """
    return minimum(7.0, 3.0 * pressure_ratio) / 100


def line_limit(
    sound_speed: Float[Array, ""] | float,
    pressure: Float[Array, ""] | float,
    diameter: Float[Array, ""] | float,
    frequency: Float[Array, "*f"] | float,
) -> Float[Array, "*f"]:
    """Allowed pulsation [-] of one component in the line, of approaches 2 and 3.

    P1 = 400 sqrt(a/(350 P_L ID f)) per cent, with a in m/s, P_L in bar, ID in mm and f in Hz.

    Args:
        sound_speed: [m/s] in the gas.
        pressure: [Pa] mean, absolute.
        diameter: [m] inside of the line.
        frequency: [Hz] of the component.
    """
    product = 350 * (pressure / 1e5) * (diameter * 1e3) * frequency
    return 4.0 * jnp.sqrt(sound_speed / product)


def line_limit_of_approach_1(pressure: Float[Array, ""] | float) -> Float[Array, ""]:
    """Allowed pulsation [-] in the line of approach 1, unfiltered: 4.1/P_L^(1/3) per cent.

    Args:
        pressure: [Pa] mean, absolute.
    """
    return 0.041 / jnp.cbrt(pressure / 1e5)
