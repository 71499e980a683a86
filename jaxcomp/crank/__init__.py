"""The crank's motion: its periodic state, its run in time, its films and its torsion.

A module is imported when a name of it is first used: what marches in time brings diffrax along, which the
solver of the whole revolution does not need.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
