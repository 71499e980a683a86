"""What packages that are built on this one take from it, and users need not."""

from ._network import Drag as Drag
from ._network import Network as Network
from ._network import Response as Response
from ._network import harmonic_responses as harmonic_responses
from ._network import no_drag as no_drag
from ._network import response as response
from ._network import steady_response as steady_response
from ._network import steady_transfers as steady_transfers
from ._network import transfers as transfers
from .pipe import friction_factor as friction_factor
from .pipe import turbulent_share as turbulent_share
from .pipe import wall_function as wall_function
