"""Fluids: the perfect gas, and real gases by their Helmholtz energy."""

from ._base import AbstractFluid as AbstractFluid
from ._base import GasState as GasState
from ._base import PerfectGas as PerfectGas
from ._helmholtz import RealGas as RealGas
from ._helmholtz import fluids as fluids
