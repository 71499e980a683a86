"""Tolerances of production: moments, Monte Carlo, reliability and robust design."""

from ._local import Local as Local
from ._local import Moments as Moments
from ._monte_carlo import Sampled as Sampled
from ._permitted import Permitted as Permitted
from ._permitted import permitted as permitted
from ._reliability import Limit as Limit
from ._reliability import Reliability as Reliability
from ._robust import Robust as Robust
from ._robust import robust as robust
from ._scatter import Scatter as Scatter
from ._scatter import scatter_of as scatter_of
from ._tolerance import Tolerances as Tolerances
from ._tolerance import tolerance as tolerance
from ._within import Within as Within
from ._within import within as within
