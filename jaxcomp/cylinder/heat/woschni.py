"""Woschni's correlation of the heat transfer."""

from typing import ClassVar

from ..._core.extremes import maximum
from ._heat_transfer import AbstractHeat


class Woschni(AbstractHeat):
    """Nu = 0.035 Re^0.8 with 2.28 times the mean piston speed, 6.18 times with a valve open."""

    kind: ClassVar[str] = "woschni"

    def coefficient(self, at):
        # a jump, but at events of the valves, where panels end: the law is smooth on each of them
        open_now = maximum(at.suction_open, at.discharge_open)
        velocity = (2.28 + (6.18 - 2.28) * open_now) * at.piston_speed
        return 0.035 * at.reynolds(velocity) ** 0.8 * at.conductivity / at.bore
