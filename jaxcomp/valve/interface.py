"""What packages that are built on this one take from it, and users need not."""

from ._flow import Side as Side
from ._flow import choose as choose
from ._flow import critical_ratio as critical_ratio
from ._flow import enthalpy_drop as enthalpy_drop
from ._flow import port_acceleration as port_acceleration
from ._flow import quasi_steady_flow as quasi_steady_flow
from ._flow import throat_density as throat_density
