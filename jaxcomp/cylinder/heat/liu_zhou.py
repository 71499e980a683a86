"""Liu and Zhou's correlation of the heat transfer."""

from typing import ClassVar

from ._heat_transfer import AbstractHeat


class LiuZhou(AbstractHeat):
    """Nu = 0.75 Re^0.8 Pr^0.6 with the mean piston speed (Liu and Zhou 1984)."""

    kind: ClassVar[str] = "liu_zhou"

    def coefficient(self, at):
        # one law for all phases of the revolution, which differ by the state of the gas alone
        number = 0.75 * at.reynolds(at.piston_speed) ** 0.8 * at.prandtl**0.6
        return number * at.conductivity / at.bore
