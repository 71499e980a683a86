"""Reciprocating compressors in JAX: from geometry to efficiency and to vibration.

Importing the package turns on JAX's 64-bit mode at once, because the balances it solves lose too many
digits in single precision. Set the environment variable `JAXCOMP_X64=0` before the import to leave
JAX's setting alone. Where JAX is not imported yet, the import sets `JAX_ENABLE_X64=1` in the
environment, which programs started from here inherit.

The public names stand in `__init__.pyi`, for editors and type checkers as well. A package is imported
when a name of it is first used, so that the command line can answer a question without starting JAX.
"""

import os as _os
import sys as _sys

import lazy_loader as _lazy

if _os.environ.get("JAXCOMP_X64", "1") != "0":
    if "jax" in _sys.modules:
        _sys.modules["jax"].config.update("jax_enable_x64", True)
    else:  # without the second that importing JAX takes
        _os.environ["JAX_ENABLE_X64"] = "1"

_lazily, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)


def __getattr__(name: str):
    try:
        return _lazily(name)
    except AttributeError:
        from ._core.words import elsewhere

        raise AttributeError(f"jaxcomp has no {name}{elsewhere(name, __all__)}") from None
