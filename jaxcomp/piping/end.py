"""Ends of pipes that are neither flange nor line."""

from typing import ClassVar, Literal

import equinox as eqx

from .._core.fields import Part


class End(Part):
    """End of a pipe.

    Args:
        node: where it is.
        type: "closed", "open" to a constant pressure, or "anechoic", as a pipe without end.
    """

    kind: ClassVar[str] = "end"

    node: str = eqx.field(static=True)
    type: Literal["closed", "open", "anechoic"] = eqx.field(static=True, default="closed")
