"""Valves and ports: oscillating plates and reeds, ideal check valves, and the flow through them."""

from ._valves import AbstractMovingValve as AbstractMovingValve
from ._valves import AbstractValve as AbstractValve
from ._valves import CheckValve as CheckValve
from ._valves import OilFilm as OilFilm
from ._valves import Oscillator as Oscillator
from ._valves import PlateValve as PlateValve
from ._valves import ReedBeam as ReedBeam
