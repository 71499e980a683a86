"""Error against run time of every solver, and a machine at its extremes."""

from ._accuracy import STUDIES as STUDIES
from ._accuracy import StudyKind as StudyKind
from ._accuracy import accuracy as accuracy
from ._extremes import Extreme as Extreme
from ._extremes import Extremes as Extremes
from ._extremes import extremes as extremes
from ._report import Cost as Cost
from ._report import DerivativeCheck as DerivativeCheck
from ._report import Measurement as Measurement
from ._report import Reference as Reference
from ._report import Report as Report
from ._study import Program as Program
from ._study import median_time as median_time
