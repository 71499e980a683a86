"""What the crank needs to know of the gas, and laws of different kinds for the cylinders of a machine."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import AbstractEach
from .._core.fields import Part


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

    def event_angles(self) -> tuple[Float[Array, ""], ...] | Float[Array, "*c k"]:
        """Crank angles [rad] where the pressure has a kink, besides those of `valve_events`.

        Many may be one array, of several cylinders with an axis of them before.
        """
        return ()

    def event_shares(self) -> Float[Array, " k"] | None:
        """[-] Displaced over swept volumes where the pressure of a table bends, on both strokes."""
        return None


class EachGas(AbstractEach, AbstractGas):
    """A gas of another kind for single cylinders of several, such as one with a measured curve.

    Args:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.

    Raises:
        BadInput: numbers that are not those of the laws, a law of the whole machine (stages, valves),
            or a list in a law.
    """

    kind: ClassVar[str] = "each"

    laws: tuple[AbstractGas, ...]

    @property
    def behind_piston(self):
        return self.each(lambda law: law.behind_piston)

    def pressure(self, stroke):
        return self.each(lambda law, stroke: law.pressure(stroke), _alike(stroke))

    def on_piston(self, stroke, area):
        area = jnp.broadcast_to(area, stroke.angle.shape)
        return self.each(
            lambda law, stroke, area: law.on_piston(stroke, area), _alike(stroke), area
        )

    def valve_events(self, swept):
        """Events of each cylinder; where one has fewer than another, at its top dead centre."""
        count = len(self.of_cylinder)
        swept = jnp.broadcast_to(swept, (count,))
        events_by_cylinder = []
        for place, law in enumerate(self._laws_of_cylinders()):
            events_by_cylinder.append(law.valve_events(swept[place]))
        events = []
        for inward in (True, False):
            rows = []
            for valve_events in events_by_cylinder:
                rows.append(_volumes(valve_events, inward))
            for column in _columns(rows):
                events.append((column, inward))
        return tuple(events)

    def event_angles(self):
        """One array: angles of each cylinder; where one has fewer than another, its top dead centre."""
        rows = [jnp.asarray(law.event_angles()) for law in self._laws_of_cylinders()]
        if not any(row.size for row in rows):
            return ()
        return _filled(rows)

    def event_shares(self):
        rows = [law.event_shares() for law in self._laws_of_cylinders()]
        if all(row is None for row in rows):
            return None
        shares = []
        for row in rows:
            shares.append(jnp.zeros(0) if row is None else row)
        return _filled(shares)


def _volumes(valve_events, inward: bool) -> list[Float[Array, ""]]:
    """[m^3] Displaced volumes of the events on the stroke in one direction."""
    return [volume for volume, direction in valve_events if direction == inward]


def _columns(rows) -> tuple[Float[Array, " k"], ...]:
    """The columns of rows of scalars; zeros stand at the ends of those that are shorter."""
    longest = max(map(len, rows))
    zero = jnp.zeros(())
    filled = []
    for row in rows:
        filled.append(row + [zero] * (longest - len(row)))
    return tuple(map(jnp.stack, zip(*filled, strict=True)))


def _filled(rows: list[Float[Array, " _"]]) -> Float[Array, "c k"]:
    """Rows of one length, with zeros behind those that are shorter."""
    longest = max(row.size for row in rows)
    filled = []
    for row in rows:
        filled.append(jnp.pad(row, (0, longest - row.size)))
    return jnp.stack(filled)


def _alike(stroke: Stroke) -> Stroke:
    return Stroke(*(jnp.broadcast_to(value, stroke.angle.shape) for value in stroke))
