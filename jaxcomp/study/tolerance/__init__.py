"""Tolerances of production: moments, Monte Carlo, reliability and robust design."""

from ._moments import Local as Local
from ._moments import Moments as Moments
from ._moments import Sampled as Sampled
from ._reliability import Limit as Limit
from ._reliability import Reliability as Reliability
from ._robust import Permitted as Permitted
from ._robust import Robust as Robust
from ._robust import permitted as permitted
from ._robust import robust as robust
from ._scatter import Scatter as Scatter
from ._scatter import Within as Within
from ._scatter import scatter_of as scatter_of
from ._scatter import within as within
from ._tolerance import Tolerances as Tolerances
from ._tolerance import tolerance as tolerance
