"""The perfect gas with constant heat capacities."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, Bound, quantity
from ._fluid import AbstractFluid, GasState

_ZERO = 273.15  # [K] where u and s count from, s from 1 kg/m^3


class PerfectGas(AbstractFluid):
    r"""A gas with constant heat capacities.

    $p = \rho R T$

    Args:
        gas_constant: [J/(kg K)] specific.
        kappa: [-] ratio of the heat capacities.
        viscosity: [Pa s] dynamic; air at 330 K if absent.
        conductivity: [W/(m K)] thermal; air at 330 K if absent.
    """

    kind: ClassVar[str] = "perfect_gas"

    gas_constant: Float[Array, ""] = quantity(
        "J/(kg K)", POSITIVE, doc="specific", usual=(30.0, 5000.0)
    )
    kappa: Float[Array, ""] = quantity(
        "", Bound(1.0, 2.0, low_open=True), doc="ratio of the heat capacities"
    )
    viscosity: Float[Array, ""] = quantity(
        "Pa s", POSITIVE, default=2.0e-5, doc="dynamic", usual=(1e-6, 1e-4)
    )
    conductivity: Float[Array, ""] = quantity(
        "W/(m K)", POSITIVE, default=0.0285, doc="thermal", usual=(5e-3, 0.5)
    )

    @property
    def specific_gas_constant(self):
        return self.gas_constant

    @property
    def temperature_range(self):
        return 50.0, 2000.0

    def state(self, T, rho):
        R = self.gas_constant
        c_v = R / (self.kappa - 1) + 0 * T
        s = c_v * jnp.log(T / _ZERO) - R * jnp.log(rho)
        return GasState(T, rho, rho * R * T, c_v * (T - _ZERO), s, c_v, rho * R, R * T)

    def transport(self, T, rho):
        return self.viscosity + 0 * T, self.conductivity + 0 * T
