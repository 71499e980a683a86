"""Reports: one HTML file with results, pictures, evidence and the sources of all values."""

from ._checks import Check as Check
from ._checks import checks as checks
from ._page import Provenance as Provenance
from ._page import report as report
