"""Rings about a piston rod."""

from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, Part, quantity


class Packing(Part):
    """Rings about a piston rod: a drag that depends on neither load nor speed.

    Args:
        drag: [N] against the motion.
    """

    kind: ClassVar[str] = "packing"
    for_each_cylinder: ClassVar[bool] = True

    drag: Float[Array, ""] = quantity("N", NONNEGATIVE, doc="against the motion")
