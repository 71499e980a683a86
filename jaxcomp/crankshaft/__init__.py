"""The crankshaft: throws and banks, counterweights, main bearings, and the joints that meet on it."""

from ._bearings import MainBearings as MainBearings
from ._crankshaft import Crankshaft as Crankshaft
from ._crankshaft import counterweights as counterweights
from ._throws import Throw as Throw
