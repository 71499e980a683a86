"""Vibration: forces of a running crank on rotor and block, the films they load, and how both answer.

A module is imported when a name of it is first used.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
