"""Networks of pipes between valves and lines: acoustics by harmonics, one element a file."""

from ._gas import PipeGas as PipeGas
from ._gas import pipe_gas as pipe_gas
from ._network import impedances as impedances
from ._network import network_of as network_of
from ._network import pressures_at_nodes as pressures_at_nodes
from ._piping import Piping as Piping
from ._resonances import Resonances as Resonances
from ._resonances import resonances as resonances
from ._resonances import root_near as root_near
from .api_618 import flange_limit as flange_limit
from .api_618 import line_limit as line_limit
from .api_618 import line_limit_of_approach_1 as line_limit_of_approach_1
from .end import AbstractEnd as AbstractEnd
from .end import AnechoicEnd as AnechoicEnd
from .end import ClosedEnd as ClosedEnd
from .end import OpenEnd as OpenEnd
from .orifice import Orifice as Orifice
from .pipe import Pipes as Pipes
from .run import Run as Run
from .vessel import Vessel as Vessel
from .volume import Volume as Volume
