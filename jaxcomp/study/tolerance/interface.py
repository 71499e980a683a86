"""What packages that are built on this one take from it, and users need not."""

from ._answer import Permitted as Permitted
from ._moments import Local as Local
from ._moments import Moments as Moments
from ._moments import Sampled as Sampled
from ._reliability import Limit as Limit
from ._scatter import Scatter as Scatter
from ._scatter import Within as Within
