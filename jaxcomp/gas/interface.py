"""What packages that are built on this one take from it, and users need not."""

from ._base import EachGas as EachGas
