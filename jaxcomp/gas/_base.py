"""What the crank needs to know of the gas."""

from abc import abstractmethod
from typing import NamedTuple

from jaxtyping import Array, Float

from .._fields import Part


class Stroke(NamedTuple):
    """Where the piston is in its cylinder.

    Attributes:
        angle: [rad] crank angle.
        displaced: [m^3] volume between the piston and its top dead centre, without clearance.
        swept: [m^3] the same at the bottom dead centre.
        inward: [-] +1 while the piston moves towards the head, -1 while it moves away.
    """

    angle: Float[Array, "*n"]
    displaced: Float[Array, "*n"]
    swept: Float[Array, ""]
    inward: Float[Array, "*n"]


class AbstractGas(Part):
    """Pressure in the cylinder as a function of the stroke."""

    @abstractmethod
    def pressure(self, stroke: Stroke) -> Float[Array, "*n"]:
        """[Pa] absolute pressure in the cylinder."""

    @property
    @abstractmethod
    def behind_piston(self) -> Float[Array, ""]:
        """[Pa] absolute pressure on the other side of the piston."""

    def on_piston(
        self, stroke: Stroke, area: Float[Array, ""]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """[Pa] Pressure in the cylinder, and the net pressure on the piston's area towards the crank.

        Args:
            stroke: where the piston is.
            area: [m^2] of the piston.
        """
        del area
        pressure = self.pressure(stroke)
        return pressure, pressure - self.behind_piston

    def valve_events(self, swept: Float[Array, ""]) -> tuple[tuple[Float[Array, ""], bool], ...]:
        """Where the pressure has a kink: (displaced volume [m^3], on the stroke towards the head?)."""
        del swept
        return ()

    def event_angles(self) -> tuple[Float[Array, ""], ...]:
        """Crank angles [rad] where the pressure has a kink, besides those of `valve_events`."""
        return ()
