"""Settings of the environment that are read before JAX is imported. Imports no JAX."""

import os

from .errors import BadInput

_XLA_FLAGS = "JAXCOMP_XLA_FLAGS"


def xla_setting() -> str:
    """The word for XLA's flags.

    "1" for those of the package, "0" for none, "quick" for programs that are called a few times, and
    "optimised" for those that are called often.

    Raises:
        BadInput: the environment variable has another word.
    """
    setting = os.environ.get(_XLA_FLAGS, "1")
    if setting not in ("0", "1", "quick", "optimised"):
        raise BadInput(_XLA_FLAGS, setting, "0, 1, quick or optimised")
    return setting
