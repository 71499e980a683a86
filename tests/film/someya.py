"""Someya's published bearing with two axial grooves, between its points."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxcomp import BadInput

# S, eps, phi [deg], (R/c) f, c K/W (xx, xy, yx, yy), c omega C/W (xx, xy, yx, yy)
_TABLES = {
    0.5: np.array(
        [
            [2.07, 0.2, 71.6, 39.5, 1.88, 5.63, -4.41, 2.56, 11.2, 2.22, 2.22, 6.43],
            [0.517, 0.5, 51.1, 11.3, 2.89, 3.57, -0.924, 2.03, 6.81, 2.10, 2.10, 2.60],
            [0.187, 0.7, 38.2, 5.13, 4.92, 3.88, 0.0235, 1.83, 7.32, 2.16, 2.16, 1.70],
            [0.0315, 0.9, 22.7, 1.56, 13.8, 5.76, 1.24, 1.72, 10.6, 2.03, 2.03, 0.846],
        ]
    ),
    1.0: np.array(
        [
            [0.689, 0.2, 69.9, 13.2, 1.99, 5.45, -4.38, 2.56, 11.3, 1.78, 1.78, 4.39],
            [0.194, 0.5, 49.1, 4.37, 2.67, 3.09, -1.00, 1.89, 6.99, 2.00, 2.00, 2.31],
            [0.0828, 0.7, 38.4, 2.39, 4.16, 3.29, -0.0851, 1.75, 7.07, 2.00, 2.00, 1.59],
            [0.0195, 0.9, 25.0, 1.04, 11.9, 5.28, 1.32, 1.80, 10.1, 2.06, 2.06, 0.916],
        ]
    ),
}
_SIGNED = 6  # column of K_yx, the only one that changes sign: it is not interpolated by logarithm


class TwoAxialGrooves(NamedTuple):
    """A point of Someya's bearing with two axial grooves.

    Attributes:
        eccentricity_ratio: [-] eps.
        attitude_angle: [rad] phi.
        friction_number: [-] (R/c) f Phi_p = Phi_T.
        stiffness: [-] c K/W, rows and columns (x, y), x along the load, y ahead with rotation.
        damping: [-] c omega C/W.
        inside: whether S lies in the published range; outside, the logarithms go on along straight
            lines.
    """

    eccentricity_ratio: Float[Array, ""]
    attitude_angle: Float[Array, ""]
    friction_number: Float[Array, ""]
    stiffness: Float[Array, "2 2"]
    damping: Float[Array, "2 2"]
    inside: Bool[Array, ""]


def someya_two_axial_grooves(
    sommerfeld_number: Float[Array, ""], length_ratio: float
) -> TwoAxialGrooves:
    """Someya's published bearing with two axial grooves, interpolated in ln S.

    Someya, T. (ed.), Journal-Bearing Databook, Springer 1989: cylindrical bearing with two axial
    grooves, L/D = 0.5 and 1. The grooves cut the film to about 170 degrees. At the same Sommerfeld
    number the plain ring (`Reynolds`) differs by up to 10 % in stiffness and 8 % in damping, of the
    largest entry, for L/D = 0.5 and S < 0.8, and by up to 23 % and 14 % for L/D = 1 and S < 0.3; at
    lighter load its C_yy is up to twice Someya's.

    The cubic through the four published points in ln S, of the logarithm of every column that keeps
    its sign: exact at the points, smooth between them.

    Args:
        sommerfeld_number: [-] S = (eta n/p)(R/c)^2 > 0 with n in rev/s, see `convert_load_number`.
        length_ratio: [-] 0.5 or 1, the published ones; not traced.

    Returns:
        `TwoAxialGrooves`.

    Raises:
        BadInput: for another L/D.
    """
    if float(length_ratio) not in _TABLES:
        raise BadInput("length_ratio", length_ratio, "0.5 or 1, as published")
    table = _TABLES[float(length_ratio)]
    knots = np.log(table[:, 0])
    columns = table[:, 1:].copy()
    logarithmic = np.arange(1, table.shape[1]) != _SIGNED
    columns[:, logarithmic] = np.log(columns[:, logarithmic])
    cubic = np.polynomial.polynomial.polyfit(knots, columns, 3)
    slopes = np.polynomial.polynomial.polyder(cubic)

    t = jnp.log(sommerfeld_number)
    inside = (t >= knots[-1]) & (t <= knots[0])
    held = jnp.where(t < knots[-1], knots[-1], jnp.where(t > knots[0], knots[0], t))
    values = jnp.polyval(cubic[::-1], held) + (t - held) * jnp.polyval(slopes[::-1], held)
    values = jnp.where(logarithmic, jnp.exp(jnp.where(logarithmic, values, 0.0)), values)
    return TwoAxialGrooves(
        eccentricity_ratio=values[0],
        attitude_angle=jnp.deg2rad(values[1]),
        friction_number=values[2] / (2 * jnp.pi * sommerfeld_number),
        stiffness=jnp.reshape(values[3:7], (2, 2)),
        damping=jnp.reshape(values[7:], (2, 2)),
        inside=inside,
    )
