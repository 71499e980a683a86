"""Double precision, switched on with the first module of the package that is imported."""

import os

import jax

if os.environ.get("JAXCOMP_X64", "1") != "0":
    jax.config.update("jax_enable_x64", True)
