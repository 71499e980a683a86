"""Error against run time of every solver, and the cost of each part of a scene."""

from ._accuracy import STUDIES as STUDIES
from ._accuracy import StudyKind as StudyKind
from ._accuracy import accuracy as accuracy
from ._report import Cost as Cost
from ._report import DerivativeCheck as DerivativeCheck
from ._report import Growth as Growth
from ._report import Measurement as Measurement
from ._report import Order as Order
from ._report import Reference as Reference
from ._report import Report as Report
from ._study import Program as Program
from ._study import median_time as median_time
from ._variants import Extreme as Extreme
from ._variants import LeanScene as LeanScene
from ._variants import SceneCost as SceneCost
from ._variants import extremes as extremes
from ._variants import lean_program as lean_program
from ._variants import lean_scenes as lean_scenes
from ._variants import scene_costs as scene_costs
