"""Design variables and the rules that keep a machine consistent while they change; studies."""

from ._drive import DriveComparison as DriveComparison
from ._drive import RodDrive as RodDrive
from ._drive import compare_drives as compare_drives
from ._drive import rod_driven as rod_driven
from ._rules import DesignRule as DesignRule
from ._rules import design_rules as design_rules
from ._rules import with_bore as with_bore
from ._rules import with_cylinder_eccentricity as with_cylinder_eccentricity
from ._rules import with_piston_clearance as with_piston_clearance
from ._rules import with_stroke_bore_ratio as with_stroke_bore_ratio
from ._study import Figures as Figures
from ._study import design_study as design_study
from ._study import figures_of as figures_of
