"""A volume of gas at a node."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, Part, quantity


class Volume(Part):
    r"""A bottle or vessel, small beside the wave: $\dot m = s V/c^2\,p$.

    One whose length matters, or whose shaking force is wanted, is a `Vessel`.

    Args:
        node: where it is.
        volume: [m^3]
    """

    kind: ClassVar[str] = "volume"

    node: str = eqx.field(static=True)
    volume: Float[Array, ""] = quantity("m^3", POSITIVE, usual=(1e-6, 10.0))
