"""Tolerances of production: moments, Monte Carlo, reliability and robust design."""

from ._reliability import Reliability as Reliability
from ._robust import Robust as Robust
from ._robust import permitted as permitted
from ._robust import robust as robust
from ._scatter import scatter_of as scatter_of
from ._scatter import within as within
from ._tolerance import Tolerances as Tolerances
from ._tolerance import tolerance as tolerance
