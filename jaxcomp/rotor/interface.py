"""What packages that are built on this one take from it, and users need not."""

from ._campbell import critical_speeds_between as critical_speeds_between
from ._crankshaft import axial_positions as axial_positions
from ._crankshaft import bearing_positions as bearing_positions
from ._crankshaft import main_films as main_films
from ._crankshaft import shaft_bearings as shaft_bearings
from ._links import LinkLaw as LinkLaw
from ._loads import load_vector as load_vector
from ._loads import nodal_load as nodal_load
from ._model import node_positions as node_positions
from ._model import subset_names as subset_names
from ._model import subsets as subsets
from ._modes import Matrices as Matrices
from ._modes import ModeDerivatives as ModeDerivatives
from ._modes import magnetic_pull_limit as magnetic_pull_limit
from ._modes_at_speeds import SIZE as SIZE
from ._modes_at_speeds import size_of as size_of
from ._nodes import node_names as node_names
from ._prepare import prepare as prepare
from ._response import SingularResponse as SingularResponse
from ._response import WhirlOrbit as WhirlOrbit
from ._shaft import Node as Node
from ._shaft import shaft_mass as shaft_mass
from ._shaft import shaft_polar_inertia as shaft_polar_inertia
from ._solve import NO_CRANK as NO_CRANK
from ._system import System as System
