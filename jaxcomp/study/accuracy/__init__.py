"""Error against run time of every solver, and a machine at its extremes."""

from ._accuracy import STUDIES as STUDIES
from ._accuracy import accuracy as accuracy
from ._extremes import Extreme as Extreme
from ._extremes import Extremes as Extremes
from ._extremes import extremes as extremes
from ._report import Report as Report
