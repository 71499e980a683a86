r"""The support of an overhung crankshaft as one journal of a planar mechanism.

Two radial bearings below the plane of the piston share the load F of the shaft,

$$F_a = F\,(1 + z_p/z_b), \qquad F_b = F\,z_p/z_b ,$$

which is Eqs. (27) and (28) of Dagilis et al., *Slider-link driven compressor (I)*, for a crank
without product of inertia about that plane. The thrust bearing carries its weight.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, POSITIVE, quantity
from ._journals import STANDARD_GRAVITY, OilPump, ThrustBearing
from ._laws import AbstractJournal


class OverhungSupport(AbstractJournal):
    """Upper and lower bearing of an overhung shaft, with thrust bearing and oil pump.

    It serves where a mechanism has a single main journal in its plane, as the slider-crank.

    Args:
        upper: law of the upper bearing.
        lower: law of the lower bearing.
        overhang: [m] z_p, from the piston plane to the upper bearing.
        bearing_span: [m] z_b, between the bearings.
        shaft_mass: [kg] shaft with rotor, on the thrust bearing.
        thrust_bearing: its law; `None` for none.
        pump: drag of the oil pump; `None` for none.
    """

    kind: ClassVar[str] = "overhung"

    upper: AbstractJournal
    lower: AbstractJournal
    overhang: Float[Array, ""] = quantity(
        "m", NONNEGATIVE, doc="z_p, from the piston plane to the upper bearing"
    )
    bearing_span: Float[Array, ""] = quantity("m", POSITIVE, doc="z_b, between the bearings")
    shaft_mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, default=0.0, doc="shaft with rotor, on the thrust bearing"
    )
    thrust_bearing: ThrustBearing | None = None
    pump: OilPump | None = None

    def moments(
        self, load: Float[Array, "*n"], rate: Float[Array, "*n"]
    ) -> dict[str, Float[Array, "*n"]]:
        """[N m] of every part by name, for a load [N] and a relative rate of rotation [rad/s]."""
        share = self.overhang / self.bearing_span
        found = {
            "upper_bearing": self.upper.moment(load * (1 + share), rate),
            "lower_bearing": self.lower.moment(load * share, rate),
        }
        weight = self.shaft_mass * STANDARD_GRAVITY
        for name in ("thrust_bearing", "pump"):
            law = getattr(self, name)
            if law is not None:
                found[name] = law.moment(rate, weight)
        return found

    def moment(self, load, rate):
        return sum(self.moments(load, rate).values(), start=jnp.zeros_like(rate))
