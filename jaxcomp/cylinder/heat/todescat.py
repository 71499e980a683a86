"""Todescat's correlation of the heat transfer."""

from typing import ClassVar

from ._heat_transfer import AbstractHeat


class Todescat(AbstractHeat):
    """Three times Annand's, as fitted to a household compressor (Todescat et al. 1992)."""

    kind: ClassVar[str] = "todescat"

    def coefficient(self, at):
        # 2.1 is three times the 0.7 of `Annand`
        return 2.1 * at.reynolds(at.piston_speed) ** 0.7 * at.conductivity / at.bore
