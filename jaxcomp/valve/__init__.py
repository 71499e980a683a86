"""Valves and ports: oscillating plates and reeds, ideal check valves, and the flow through them."""

from ._flow import Side as Side
from ._flow import port_acceleration as port_acceleration
from ._flow import quasi_steady_flow as quasi_steady_flow
from ._flow import throat_density as throat_density
from ._valves import AbstractMovingValve as AbstractMovingValve
from ._valves import AbstractValve as AbstractValve
from ._valves import CheckValve as CheckValve
from ._valves import OilFilm as OilFilm
from ._valves import Oscillator as Oscillator
from ._valves import PlateValve as PlateValve
from ._valves import ReedBeam as ReedBeam
