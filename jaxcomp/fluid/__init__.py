"""Fluids: the perfect gas, real gases by their Helmholtz energy, and mixtures of these."""

from ._fluid import AbstractFluid as AbstractFluid
from ._fluid import GasState as GasState
from ._helmholtz import fluids as fluids
from ._real import AbstractRealGas as AbstractRealGas
from .mixture import Mixture as Mixture
from .perfect_gas import PerfectGas as PerfectGas
from .real_gas import RealGas as RealGas
