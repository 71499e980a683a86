"""Pictures: functions that return matplotlib figures and keep no state.

With the option `interactive=True` each of them returns figures of plotly with hover and zoom.
"""

from ._accuracy import work_precision_diagram as work_precision_diagram
from ._animate import gif as gif
from ._animate import machine_views as machine_views
from ._bearings import loaded_film as loaded_film
from ._bearings import loaded_path as loaded_path
from ._bearings import stribeck as stribeck
from ._crank import by_number_of_cylinders as by_number_of_cylinders
from ._crank import order_spectra as order_spectra
from ._crank import pv_diagram as pv_diagram
from ._designs import sensitivity_bars as sensitivity_bars
from ._designs import tolerance_histogram as tolerance_histogram
from ._designs import tornado as tornado
from ._drawing import drawings as drawings
from ._interactive import interactive as interactive
from ._sweep import sweep_map as sweep_map
from ._vibration import shaking_force as shaking_force
