"""Leakage past the piston."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, Bound, Part, quantity
from ..valve._flow import Side


class LaminarGap(Part):
    r"""A round gap between piston and cylinder; the crankcase has the gas of the suction line.

    The leakage is the laminar flow of a compressible gas through the gap,

    $$\dot m = \frac{\pi D g^3}{12\mu L}\left(1 + \tfrac32\varepsilon^2\right)
    (p - p_c)\,\frac{\rho + \rho_c}{2} .$$

    Args:
        gap: [m] radial clearance.
        length: [m] of the piston's sealing surface.
        viscosity: [Pa s] of the gas; the fluid's own at its temperature in the cylinder if absent.
        eccentricity: [-] of the piston over the clearance.
    """

    kind: ClassVar[str] = "laminar_gap"

    gap: Float[Array, ""] = quantity("m", NONNEGATIVE, doc="radial clearance", usual=(5e-7, 1e-3))
    length: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="of the sealing surface", usual=(1e-3, 1.0)
    )
    viscosity: Float[Array, ""] | None = quantity(
        "Pa s", POSITIVE, default=None, doc="of the gas; the fluid's own if absent"
    )
    eccentricity: Float[Array, ""] = quantity("", Bound(0.0, 1.0), default=0.0)

    def flow(self, cylinder: Side, crankcase: Side, bore, viscosity) -> Float[Array, ""]:
        """Mass flow out of the cylinder [kg/s].

        Args:
            cylinder: the gas in the cylinder.
            crankcase: the gas behind the piston.
            bore: [m]
            viscosity: [Pa s] of the gas.
        """
        conductance = jnp.pi * bore * self.gap**3 / (12 * viscosity * self.length)
        # the cube of the local gap, 1 + e cos(phi) of the clearance, has this mean around the
        # piston
        conductance = conductance * (1 + 1.5 * self.eccentricity**2)
        # the mean density is exact for a perfect gas of one temperature: (p^2 - p_c^2)/(2 R T)
        return conductance * (cylinder.p - crankcase.p) * 0.5 * (cylinder.rho + crankcase.rho)
