"""Grids and samples of designs: many at a time, streamed to disk, on all devices and hosts."""

from ._best import best_curve as best_curve
from ._best import best_design as best_design
from ._points import Distribution as Distribution
from ._points import grid as grid
from ._points import log_grid as log_grid
from ._points import log_uniform as log_uniform
from ._points import normal as normal
from ._points import uniform as uniform
from ._run import sweep as sweep
from ._store import open_sweep as open_sweep
