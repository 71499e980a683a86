"""Shaking forces of a mechanism and the vibration of the block that carries it."""

from ._suspension import Spring as Spring
from ._suspension import Suspension as Suspension
from ._suspension import block_points as block_points
from ._suspension import damping_matrix as damping_matrix
from ._suspension import mass_matrix as mass_matrix
from ._suspension import natural_frequencies as natural_frequencies
from ._suspension import retuned as retuned
from ._suspension import stiffness_matrix as stiffness_matrix
from ._suspension import viscous_damping as viscous_damping
from ._vibration import BlockMotion as BlockMotion
from ._vibration import Harmonics as Harmonics
from ._vibration import block_response as block_response
from ._vibration import free_body_error as free_body_error
from ._vibration import free_body_response as free_body_response
from ._vibration import harmonics as harmonics
from ._vibration import orbit_load as orbit_load
from ._vibration import point_motion as point_motion
from ._vibration import simulate_block as simulate_block
from ._vibration import time_response as time_response
from ._wrench import Wrench as Wrench
from ._wrench import shaking_wrench as shaking_wrench
from ._wrench import wrench_about as wrench_about
