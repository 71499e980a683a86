"""Gas in the cylinder: the polytropic cycle and prescribed indicator diagrams."""

from ._base import AbstractGas as AbstractGas
from ._base import Stroke as Stroke
from ._cycles import DoubleActing as DoubleActing
from ._cycles import PolytropicCycle as PolytropicCycle
from ._cycles import StagedCycle as StagedCycle
from ._diagram import CallableDiagram as CallableDiagram
from ._diagram import CrankAngleTable as CrankAngleTable
from ._diagram import FourierDiagram as FourierDiagram
from ._diagram import VolumeTable as VolumeTable
