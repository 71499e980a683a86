"""Harmonic finite-element response of rotor, crankcase and housing.

Conventions (frame, degrees of freedom, time factor): `jaxcomp.rotor._conventions`.
"""

from ._bodies import Disks as Disks
from ._bodies import ModalDamping as ModalDamping
from ._bodies import PointMasses as PointMasses
from ._bodies import ProportionalDamping as ProportionalDamping
from ._bodies import RigidBody as RigidBody
from ._bodies import solid_disk as solid_disk
from ._campbell import CriticalSpeeds as CriticalSpeeds
from ._campbell import campbell as campbell
from ._campbell import critical_speeds as critical_speeds
from ._conventions import AXES as AXES
from ._crankshaft_of_rotor import crankshaft_of as crankshaft_of
from ._damped import DampedModes as DampedModes
from ._damped import damped_modes as damped_modes
from ._links import Clamped as Clamped
from ._links import ConstantLaw as ConstantLaw
from ._links import Link as Link
from ._links import LoadedFilm as LoadedFilm
from ._links import MagneticPull as MagneticPull
from ._links import Mount as Mount
from ._links import Pinned as Pinned
from ._links import SpeedTable as SpeedTable
from ._links import diagonal as diagonal
from ._links import isotropic as isotropic
from ._loads import CrankNodes as CrankNodes
from ._loads import LoadCase as LoadCase
from ._loads import Loads as Loads
from ._loads import PeriodicForce as PeriodicForce
from ._loads import PipeNode as PipeNode
from ._loads import Unbalances as Unbalances
from ._model import BalancingPlanes as BalancingPlanes
from ._model import CorrectionPlane as CorrectionPlane
from ._model import RotorModel as RotorModel
from ._model import TargetPlane as TargetPlane
from ._modes import Modes as Modes
from ._modes import matrices as matrices
from ._modes import mode_derivatives as mode_derivatives
from ._modes import undamped_modes as undamped_modes
from ._modes_at_speeds import CampbellDiagram as CampbellDiagram
from ._modes_at_speeds import RotorModes as RotorModes
from ._nodes import node_index as node_index
from ._response import Response as Response
from ._response import harmonic_response as harmonic_response
from ._response import orbit as orbit
from ._response import receptance as receptance
from ._response import relative_displacement as relative_displacement
from ._response import respond as respond
from ._response import transmitted_forces as transmitted_forces
from ._shaft import ShaftElements as ShaftElements
from ._shaft import shaft_line as shaft_line
from ._shaft import stepped_shaft as stepped_shaft
