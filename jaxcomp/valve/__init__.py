"""Valves and ports: oscillating plates and reeds, ideal check valves, and the flow through them."""

from ._valve import AbstractMovingValve as AbstractMovingValve
from ._valve import AbstractValve as AbstractValve
from ._valve import Oscillator as Oscillator
from .check import CheckValve as CheckValve
from .oil_film import OilFilm as OilFilm
from .plate import PlateValve as PlateValve
from .reed_beam import ReedBeam as ReedBeam
from .unloader import Unloader as Unloader
