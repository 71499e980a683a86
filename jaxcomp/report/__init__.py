"""Reports: one HTML file with results, pictures, evidence and the sources of all values."""

from ._page import report as report
