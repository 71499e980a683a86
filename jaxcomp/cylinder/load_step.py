"""Steps of the capacity of a machine: ends without load and pockets that are open."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, Bound, Part, quantity

_SHARES = Bound(0.0, 1.0)


class ClearancePocket(Part):
    """Volume beside the clearance of an end, which a valve opens and shuts.

    Args:
        volume: [m^3] of the pocket.
    """

    kind: ClassVar[str] = "clearance_pocket"

    volume: Float[Array, ""] = quantity("m^3", POSITIVE, usual=(1e-6, 1.0))


class LoadStep(Part):
    """Settings of all ends of a machine, cylinder after cylinder, head before crank end.

    Args:
        name: of the step.
        unloaded: [-] (e,) share of the force with which the unloader of every end acts, 1 or 0 as a
            rule; none if absent.
        pockets: [-] (e,) share of the volume of the pocket of every end that is open: 1 or 0, anything
            between of a variable one; none if absent.
    """

    kind: ClassVar[str] = "load_step"

    name: str = eqx.field(static=True)
    unloaded: Float[Array, " e"] | None = quantity(
        "", _SHARES, shape=(None,), default=None, doc="share of the unloader's force, of every end"
    )
    pockets: Float[Array, " e"] | None = quantity(
        "", _SHARES, shape=(None,), default=None, doc="open share of the pocket, of every end"
    )
