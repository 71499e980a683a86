"""The cylinder's own thermodynamics: valves, real gas, heat and leakage over a periodic cycle."""

from ._cycle import Cycle as Cycle
from ._cycle_options import CycleOptions as CycleOptions
from ._cylinder import Cylinder as Cylinder
from ._line_resonances import LineResonance as LineResonance
from ._line_resonances import line_resonances as line_resonances
from ._lines import DischargeLine as DischargeLine
from ._lines import SuctionLine as SuctionLine
from ._plenum import Plenum as Plenum
from ._pulsation import Pulsation as Pulsation
from ._solve_cycle import solve_cycle as solve_cycle
from .crank_end import CrankEnd as CrankEnd
from .heat._heat_transfer import AbstractHeat as AbstractHeat
from .heat.adair import Adair as Adair
from .heat.annand import Annand as Annand
from .heat.disconzi import Disconzi as Disconzi
from .heat.liu_zhou import LiuZhou as LiuZhou
from .heat.todescat import Todescat as Todescat
from .heat.woschni import Woschni as Woschni
from .laminar_gap import LaminarGap as LaminarGap
from .load_step import ClearancePocket as ClearancePocket
from .load_step import LoadStep as LoadStep
from .stage import Intercooler as Intercooler
from .stage import Stage as Stage
from .suction_warming import SuctionWarming as SuctionWarming
from .wall_network import WallNetwork as WallNetwork
