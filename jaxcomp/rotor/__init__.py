"""Harmonic finite-element response of rotor, crankcase and housing.

Conventions (frame, degrees of freedom, time factor): `jaxcomp.rotor._conventions`.
"""

from ._assembly import Matrices as Matrices
from ._assembly import matrices as matrices
from ._bodies import RigidBody as RigidBody
from ._campbell import CriticalSpeeds as CriticalSpeeds
from ._campbell import campbell as campbell
from ._campbell import critical_speeds as critical_speeds
from ._damped import DampedModes as DampedModes
from ._damped import damped_modes as damped_modes
from ._damping import ModalDamping as ModalDamping
from ._damping import ProportionalDamping as ProportionalDamping
from ._inertia import Disks as Disks
from ._inertia import PointMasses as PointMasses
from ._inertia import solid_disk as solid_disk
from ._links import ConstantLaw as ConstantLaw
from ._links import Link as Link
from ._links import LinkLaw as LinkLaw
from ._links import SidePull as SidePull
from ._links import SpeedTable as SpeedTable
from ._links import diagonal as diagonal
from ._links import isotropic as isotropic
from ._loads import PeriodicForce as PeriodicForce
from ._loads import Unbalances as Unbalances
from ._loads import load_vector as load_vector
from ._loads import nodal_load as nodal_load
from ._loads import total_load as total_load
from ._mesh import node_positions as node_positions
from ._mesh import shaft_line as shaft_line
from ._mesh import stepped_shaft as stepped_shaft
from ._mode_derivatives import ModeDerivatives as ModeDerivatives
from ._mode_derivatives import mode_derivatives as mode_derivatives
from ._model import RotorModel as RotorModel
from ._model import node_index as node_index
from ._model import node_names as node_names
from ._modes import Modes as Modes
from ._modes import undamped_modes as undamped_modes
from ._orbit import Orbit as Orbit
from ._orbit import orbit as orbit
from ._response import Response as Response
from ._response import SingularResponse as SingularResponse
from ._response import harmonic_response as harmonic_response
from ._response import receptance as receptance
from ._response import relative_displacement as relative_displacement
from ._response import respond as respond
from ._response import transmitted_forces as transmitted_forces
from ._shaft import ShaftElements as ShaftElements
from ._shaft import shaft_mass as shaft_mass
from ._stability import side_pull_limit as side_pull_limit
from ._updating import Update as Update
from ._updating import fit_frequencies as fit_frequencies
