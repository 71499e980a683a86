"""What packages that are built on this one take from it, and users need not."""

from ._flow import choose as choose
from ._flow import critical_ratio as critical_ratio
