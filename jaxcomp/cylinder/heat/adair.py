"""Adair's correlation of the heat transfer."""

from typing import ClassVar

import jax.numpy as jnp

from ._heat_transfer import AbstractHeat


class Adair(AbstractHeat):
    """Nu = 0.053 Re^0.8 Pr^0.6 with the equivalent diameter 6 V/A_w and a swirl (Adair et al. 1972).

    The swirl 2 w (1.04 + cos 2 theta) is halved in the half of the revolution about the bottom dead
    centre, where cos theta is negative: a jump of the coefficient at 90 degrees on either side.
    """

    kind: ClassVar[str] = "adair"

    def coefficient(self, at):
        # diameter of a sphere with this ratio of volume to surface
        length = 6 * at.volume / at.wall_area
        swirl = 2 * at.speed * (1.04 + jnp.cos(2 * at.angle))
        swirl = jnp.where(jnp.cos(at.angle) > 0, swirl, 0.5 * swirl)
        # the swirl is an angular velocity: at the wall of the bore it is a speed
        reynolds = at.reynolds(0.5 * at.bore * swirl, length)
        return 0.053 * reynolds**0.8 * at.prandtl**0.6 * at.conductivity / length
