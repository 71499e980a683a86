"""Pictures: functions that return matplotlib figures and keep no state.

With the option `interactive=True` each of them returns figures of plotly with hover and zoom.
"""

import inspect as _inspect

from matplotlib.figure import Figure as _Figure

from ._accuracy import accuracy_figures as accuracy_figures
from ._accuracy import extreme_errors as extreme_errors
from ._accuracy import work_precision_diagram as work_precision_diagram
from ._animate import Motion as Motion
from ._animate import cylinders_motion as cylinders_motion
from ._animate import gif as gif
from ._animate import journal_motion as journal_motion
from ._animate import machine_views as machine_views
from ._animate import mechanism_motion as mechanism_motion
from ._bearings import bearing_loads as bearing_loads
from ._bearings import film_coefficients as film_coefficients
from ._bearings import film_figures as film_figures
from ._bearings import film_pressure as film_pressure
from ._bearings import journal_films_over_turn as journal_films_over_turn
from ._bearings import journal_paths as journal_paths
from ._bearings import loaded_film as loaded_film
from ._bearings import loaded_journal_figures as loaded_journal_figures
from ._bearings import loaded_path as loaded_path
from ._bearings import stribeck as stribeck
from ._crank import by_number_of_cylinders as by_number_of_cylinders
from ._crank import crank_torques as crank_torques
from ._crank import joint_forces as joint_forces
from ._crank import joint_friction as joint_friction
from ._crank import loss_shares as loss_shares
from ._crank import orbit_figures as orbit_figures
from ._crank import order_spectra as order_spectra
from ._crank import pv_diagram as pv_diagram
from ._crank import speed_over_turn as speed_over_turn
from ._crank import torsion_over_speed as torsion_over_speed
from ._crank import transient_figure as transient_figure
from ._crank import transient_gas_figure as transient_gas_figure
from ._cylinder import cylinder_figures as cylinder_figures
from ._cylinder import log_p_h as log_p_h
from ._cylinder import power_use as power_use
from ._cylinder import rating_figures as rating_figures
from ._cylinder import valve_losses as valve_losses
from ._cylinder import valve_motion as valve_motion
from ._designs import compared_losses as compared_losses
from ._designs import sensitivity_bars as sensitivity_bars
from ._designs import sensitivity_figures as sensitivity_figures
from ._designs import tolerance_figures as tolerance_figures
from ._designs import tolerance_histogram as tolerance_histogram
from ._designs import tornado as tornado
from ._identified import identification_figures as identification_figures
from ._interactive import interactive as interactive
from ._interactive import interactive_page as interactive_page
from ._interactive import offering_interactive as _offering_interactive
from ._optimise import optimum_convergence as optimum_convergence
from ._optimise import optimum_figures as optimum_figures
from ._optimise import optimum_path as optimum_path
from ._optimise import pareto_front as pareto_front
from ._rotor import balance_motion as balance_motion
from ._rotor import campbell_diagram as campbell_diagram
from ._rotor import deflection_shape as deflection_shape
from ._rotor import mode_shapes as mode_shapes
from ._rotor import response_curves as response_curves
from ._rotor import response_orbits as response_orbits
from ._rotor import rotor_drawing as rotor_drawing
from ._sweep import machine_figures as machine_figures
from ._sweep import optimum_curve as optimum_curve
from ._sweep import sample_cloud as sample_cloud
from ._sweep import sweep_curves as sweep_curves
from ._sweep import sweep_figures as sweep_figures
from ._sweep import sweep_map as sweep_map
from ._vibration import balance_bars as balance_bars
from ._vibration import balance_figures as balance_figures
from ._vibration import balance_polar as balance_polar
from ._vibration import free_body_errors as free_body_errors
from ._vibration import shaking_force as shaking_force
from ._vibration import vibration_orbits as vibration_orbits

_FIGURES = (_Figure, dict[str, _Figure])
for _name, _function in list(globals().items()):
    if _inspect.isfunction(_function) and not _name.startswith("_"):
        _draws = _inspect.signature(_function).return_annotation in _FIGURES
        globals()[_name] = _offering_interactive(_function) if _draws else _function
