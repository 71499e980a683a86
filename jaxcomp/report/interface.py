"""What packages that are built on this one take from it, and users need not."""

from ._checks import Check as Check
from ._checks import checks as checks
from ._page import Provenance as Provenance
