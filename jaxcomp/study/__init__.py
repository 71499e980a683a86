"""Studies of measured machines: least squares with bounds and priors, and what its answer is worth."""

from ._fit import Fit as Fit
from ._fit import Parameter as Parameter
from ._fit import Prediction as Prediction
from ._fit import fit as fit
from ._identify import CommonFactor as CommonFactor
from ._identify import HeldOut as HeldOut
from ._identify import Identification as Identification
from ._identify import identify as identify
from ._identify import varied as varied
from ._kinds import ModalTest as ModalTest
from ._kinds import Table as Table
from ._kinds import Trace as Trace
from ._kinds import VibrationTest as VibrationTest
from ._measurement import AbstractMeasurement as AbstractMeasurement
from ._measurement import Entries as Entries
from ._measurement import Kind as Kind
from ._readings import MEASURED as MEASURED
from ._readings import Readings as Readings
from ._readings import terms_of as terms_of
