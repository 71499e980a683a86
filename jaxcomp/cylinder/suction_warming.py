"""Gas that is warmed on its way to the suction valve."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, Bound, Part, quantity
from ..fluid import GasState


class SuctionWarming(Part):
    r"""Warming of the gas on its way to the suction valve by losses, and by the gas that is delivered.

    $$\dot m\,(h_s - h_1) = \dot m c_p (T_2 - T_1)\left(1 - e^{-UA/(\dot m c_p)}\right)
      + \varphi\dot W_{loss}$$

    The rise grows where little gas flows, which a constant one does not. The periodic state closes it:
    flow, discharge temperature and losses are those at the rise that they cause.

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

    def heat(self, comes: GasState, discharge_temperature, mass_flow, loss) -> Float[Array, ""]:
        """[W] Into the gas before the suction valve.

        Args:
            comes: the gas as it comes to the compressor.
            discharge_temperature: [K]
            mass_flow: [kg/s]
            loss: [W] of motor and friction.
        """
        delivered = self.from_discharge(comes, discharge_temperature, mass_flow)
        return delivered + self.loss_share * loss

    def from_discharge(self, comes: GasState, discharge_temperature, mass_flow) -> Float[Array, ""]:
        """[W] The part of `heat` that the gas delivered gives; arguments as there."""
        flow = mass_flow * comes.c_p
        share = -jnp.expm1(-self.discharge_conductance / flow)
        return flow * (discharge_temperature - comes.T) * share
