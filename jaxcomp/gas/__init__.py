"""Gas in the cylinder: the polytropic cycle and prescribed indicator diagrams, one law a file."""

from ._gas_law import AbstractGas as AbstractGas
from ._gas_law import Stroke as Stroke
from .callable import CallableDiagram as CallableDiagram
from .crank_angle_table import CrankAngleTable as CrankAngleTable
from .double_acting import DoubleActing as DoubleActing
from .fourier import FourierDiagram as FourierDiagram
from .polytropic import PolytropicCycle as PolytropicCycle
from .staged import StagedCycle as StagedCycle
from .volume_table import VolumeTable as VolumeTable
