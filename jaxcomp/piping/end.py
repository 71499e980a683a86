"""Ends of pipes that are neither flange nor line."""

from typing import ClassVar

import equinox as eqx

from .._core.fields import Part


class AbstractEnd(Part):
    """End of a pipe."""

    kind: ClassVar[str]

    node: eqx.AbstractVar[str]


class ClosedEnd(AbstractEnd):
    """End through which nothing flows, as of every pipe that leads to neither flange nor line.

    Args:
        node: where it is.
    """

    kind: ClassVar[str] = "closed"

    node: str = eqx.field(static=True)


class OpenEnd(AbstractEnd):
    """End towards a constant pressure, that of the line.

    Args:
        node: where it is.
    """

    kind: ClassVar[str] = "open"

    node: str = eqx.field(static=True)


class AnechoicEnd(AbstractEnd):
    """End where a wave goes on as in a pipe without end; the mean pressure there is that of the line.

    Args:
        node: where it is.
    """

    kind: ClassVar[str] = "anechoic"

    node: str = eqx.field(static=True)
