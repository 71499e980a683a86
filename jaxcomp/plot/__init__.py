"""Pictures: functions that return matplotlib figures and keep no state."""

from ._balance import balance_bars as balance_bars
from ._balance import balance_figures as balance_figures
from ._balance import balance_polar as balance_polar
from ._film import film_coefficients as film_coefficients
from ._film import film_figures as film_figures
from ._film import film_pressure as film_pressure
from ._orbit import crank_torques as crank_torques
from ._orbit import joint_forces as joint_forces
from ._orbit import joint_friction as joint_friction
from ._orbit import loss_shares as loss_shares
from ._orbit import orbit_figures as orbit_figures
from ._orbit import pv_diagram as pv_diagram
from ._orbit import speed_over_turn as speed_over_turn
from ._polar import bearing_loads as bearing_loads
from ._rotor import campbell_diagram as campbell_diagram
from ._rotor import deflection_shape as deflection_shape
from ._rotor import mode_shapes as mode_shapes
from ._rotor import response_curves as response_curves
from ._rotor import response_orbits as response_orbits
from ._rotor import rotor_drawing as rotor_drawing
from ._shaking import free_body_errors as free_body_errors
from ._shaking import shaking_force as shaking_force
from ._shaking import vibration_orbits as vibration_orbits
