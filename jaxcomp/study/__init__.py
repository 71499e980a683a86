"""Studies of designs: variables, design rules, optimisation, sensitivity, comparison, identification.

Sweeps, tolerances and the accuracy of the solvers are packages in it. A module is imported when a name of
it is first used.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
