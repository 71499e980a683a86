"""Disconzi's correlation of the heat transfer."""

from typing import ClassVar

import jax.numpy as jnp

from ..._core.extremes import maximum
from ._heat_transfer import AbstractHeat


class Disconzi(AbstractHeat):
    """Nu = a Re^b Pr^0.6 by phase, with the speed in the open port (Disconzi et al. 2012).

    Compression 0.08 Re^0.8, discharge the same with u + u^0.8 c^0.2, expansion 0.12 Re^0.8, suction
    0.08 Re^0.9 with u + u^-0.4 c^1.4, u the mean piston speed and c the flow over density and bore.
    """

    kind: ClassVar[str] = "disconzi"

    def coefficient(self, at):
        u, c = at.piston_speed, at.port_speed
        c = maximum(c, 1e-6 * u)  # its powers have no slope at rest
        # exponents add up to one: both terms are speeds
        discharge = at.discharge_open * u**0.8 * c**0.2
        suction = at.suction_open * u**-0.4 * c**1.4
        factor = jnp.where(at.outward > 0, 0.12, 0.08)
        shut = factor * at.reynolds(u) ** 0.8
        out = 0.08 * at.reynolds(u + discharge) ** 0.8
        into = 0.08 * at.reynolds(u + suction) ** 0.9
        # an open valve decides before the sense of the piston, whichever way gas flows through it
        number = jnp.where(at.suction_open > 0, into, jnp.where(at.discharge_open > 0, out, shut))
        return number * at.prandtl**0.6 * at.conductivity / at.bore
