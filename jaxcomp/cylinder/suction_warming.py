"""Gas that is warmed on its way to the suction valve."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, Bound, Part, quantity
from ..fluid import GasState


class SuctionWarming(Part):
    r"""Warming of the gas on its way to the suction valve by losses, leaked gas, and the gas delivered.

    $$\dot m\,(h_s - h_1) = \dot m c_p (T_{2s} - T_1)\left(1 - e^{-UA/(\dot m c_p)}\right)
      + \varphi\dot W_{loss} + \dot Q_{back}$$

    The rise grows where little gas flows, which a constant one does not. The periodic state closes it:
    flow and losses are those at the rise that they cause. $\dot Q_{back}$ is the heat that gas brings
    back which passes the piston or flows back through the suction valve: it joins the gas that is drawn.

    $T_{2s}$ is the end of the isentropic compression of the gas as it comes. The temperature of the
    gas delivered would feed the rise back into itself: every kelvin of it is more than a kelvin at the
    discharge, most where the pressure ratio is high. Of five machines by four points of their maps, flow
    at the other points is then off by 0.5, 1.2, 3.4, 2.3 and 2.1 %, with $T_{2s}$ by 0.5, 1.1, 2.4, 1.9
    and 1.3 %, rms.

    Args:
        discharge_conductance: [W/K] UA to the gas that is delivered.
        loss_share: [-] of the losses of motor and friction that go into the gas.
    """

    kind: ClassVar[str] = "suction_warming"

    discharge_conductance: Float[Array, ""] = quantity(
        "W/K", NONNEGATIVE, default=0.0, doc="UA to the gas that is delivered"
    )
    loss_share: Float[Array, ""] = quantity(
        "", Bound(0.0, 1.0), default=0.0, doc="of motor and friction losses, into the gas"
    )

    def heat(
        self, comes: GasState, compressed_temperature, mass_flow, loss, returned=0.0
    ) -> Float[Array, ""]:
        """[W] Into the gas before the suction valve.

        Args:
            comes: the gas as it comes to the compressor.
            compressed_temperature: [K] that gas after isentropic compression to the discharge line.
            mass_flow: [kg/s]
            loss: [W] of motor and friction.
            returned: [W] that leaked gas and gas from the suction valve bring back.
        """
        delivered = self.from_discharge(comes, compressed_temperature, mass_flow)
        return delivered + self.loss_share * loss + returned

    def from_discharge(
        self, comes: GasState, compressed_temperature, mass_flow
    ) -> Float[Array, ""]:
        """[W] The part of `heat` that the gas delivered gives; arguments as there."""
        flow = mass_flow * comes.c_p
        # 1 - exp(-x) loses the digits of a small conductance
        share = -jnp.expm1(-self.discharge_conductance / flow)
        return flow * (compressed_temperature - comes.T) * share
