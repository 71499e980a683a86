"""Fluids: the perfect gas, and real gases by their Helmholtz energy."""

from ._base import AbstractFluid as AbstractFluid
from ._base import GasState as GasState
from ._helmholtz import fluids as fluids
from .perfect_gas import PerfectGas as PerfectGas
from .real_gas import RealGas as RealGas
