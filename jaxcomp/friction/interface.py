"""What packages that are built on this one take from it, and users need not."""

from ._base import STANDARD_GRAVITY as STANDARD_GRAVITY
from ._base import AbstractDrag as AbstractDrag
from ._base import EachJournal as EachJournal
from ._base import EachSlide as EachSlide
from ._loads import closed as closed
from ._loads import joint_loads as joint_loads
from ._loads import magnitude as magnitude
from ._loads import newton_step as newton_step
from ._loads import shaft_loss as shaft_loss
