"""What packages that are built on this one take from it, and users need not."""

from ._blends import Blend as Blend
from ._blends import blends as blends
from ._blends import usable_blends as usable_blends
from ._blends import without_equation as without_equation
from ._helmholtz import Saturation as Saturation
from ._helmholtz import fluid_data as fluid_data
from ._multi_fluid import pairs_of as pairs_of
from ._real import FAR as FAR
from ._real import has_dew_line as has_dew_line
from .real_gas import fluid_named as fluid_named
