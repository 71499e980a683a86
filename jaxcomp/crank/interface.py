"""What packages that are built on this one take from it, and users need not.

A module is imported when a name of it is first used.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__package__, __file__)
