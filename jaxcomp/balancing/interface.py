"""What packages that are built on this one take from it, and users need not."""

from ._balance import PlacedWeights as PlacedWeights
from ._classical import PlanePair as PlanePair
from ._discrete import Split as Split
from ._discrete import split as split
from ._further_trial import FurtherTrial as FurtherTrial
from ._further_trial import further_trial as further_trial
from ._influence import Influence as Influence
from ._influence import InfluenceRow as InfluenceRow
from ._influence import Trials as Trials
from ._influence import fitted_influence as fitted_influence
from ._influence import flexibilities as flexibilities
from ._influence import influence_of as influence_of
from ._places import as_weights as as_weights
