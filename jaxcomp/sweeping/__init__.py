"""Grids and samples of designs: many at a time, streamed to disk, on all devices and hosts."""

from ._axes import Distribution as Distribution
from ._axes import grid as grid
from ._axes import log_grid as log_grid
from ._axes import log_uniform as log_uniform
from ._axes import normal as normal
from ._axes import uniform as uniform
from ._best import BestCurve as BestCurve
from ._best import best_curve as best_curve
from ._best import best_design as best_design
from ._best import shown_column as shown_column
from ._machines import sweep_machines as sweep_machines
from ._run import sweep as sweep
from ._store import open_sweep as open_sweep
