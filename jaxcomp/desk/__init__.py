"""The desk: a machine in the browser, whose results follow while its numbers are dragged.

`jaxcomp desk MACHINE` serves it; in a notebook `page(load(MACHINE))` at the end of a cell shows it. Needs
Panel (`pip install jaxcomp[desk]`); `Desk` does not.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
