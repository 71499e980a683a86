"""The cylinder's own thermodynamics: valves, real gas, heat and leakage over a periodic cycle."""

from . import interface as interface
from ._cycle import Cycle as Cycle
from ._cylinder import Cylinder as Cylinder
from ._cylinder import DischargeLine as DischargeLine
from ._cylinder import SuctionLine as SuctionLine
from ._heat import AbstractHeat as AbstractHeat
from ._heat import Adair as Adair
from ._heat import Annand as Annand
from ._heat import Disconzi as Disconzi
from ._heat import LaminarGap as LaminarGap
from ._heat import LiuZhou as LiuZhou
from ._heat import SuctionWarming as SuctionWarming
from ._heat import Todescat as Todescat
from ._heat import WallNetwork as WallNetwork
from ._heat import Woschni as Woschni
from ._plenum import Plenum as Plenum
from ._solve import CycleOptions as CycleOptions
from ._solve import solve_cycle as solve_cycle
