"""What packages that are built on this one take from it, and users need not."""

from ._accuracy import StudyKind as StudyKind
from ._report import Cost as Cost
from ._report import DerivativeCheck as DerivativeCheck
from ._report import Measurement as Measurement
from ._report import Reference as Reference
from ._study import Program as Program
from ._study import median_time as median_time
