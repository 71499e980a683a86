"""Studies of designs: variables, design rules, optimisation, sensitivity, comparison, identification.

Sweeps, tolerances and the accuracy of the solvers are packages in it. A module is imported when a name of
it is first used.
"""

import lazy_loader as _lazy

_lazily, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)


def __getattr__(name: str):
    try:
        return _lazily(name)
    except AttributeError:
        from .._core.words import elsewhere

        raise AttributeError(f"jaxcomp.study has no {name}{elsewhere(name, __all__)}") from None
