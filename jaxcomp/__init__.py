"""Reciprocating compressors in JAX: from geometry to efficiency and to vibration.

Importing the package turns on JAX's 64-bit mode, because the balances it solves lose too many
digits in single precision. Set the environment variable `JAXCOMP_X64=0` before the import to leave
JAX's setting alone.
"""

import os

import jax

if os.environ.get("JAXCOMP_X64", "1") != "0":
    jax.config.update("jax_enable_x64", True)

from ._fields import BadInput as BadInput
from ._status import SolveFailed as SolveFailed
from ._status import Status as Status
from .compressor import Compressor as Compressor
from .crank import Collocation as Collocation
from .crank import Energy as Energy
from .crank import Orbit as Orbit
from .crank import Shooting as Shooting
from .crank import solve_orbit as solve_orbit
