"""What packages that are built on this one take from it, and users need not."""

from ._helmholtz import Saturation as Saturation
from ._helmholtz import fluid_data as fluid_data
