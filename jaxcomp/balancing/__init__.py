"""Balancing: from influence coefficients to correction masses, with or without a model.

`jaxcomp.scene.measurements` reads the coefficients from a table of measured vibration.
"""

from ._amplitudes import amplitude_influence as amplitude_influence
from ._amplitudes import balance_each as balance_each
from ._balance import Balance as Balance
from ._classical import balance_rotor_alone as balance_rotor_alone
from ._classical import classical_balance as classical_balance
from ._classical import permissible_unbalance as permissible_unbalance
from ._classical import rigid_balance as rigid_balance
from ._classical import rod_ring as rod_ring
from ._discrete import discrete as discrete
from ._discrete import stock as stock
from ._influence import direct_influence as direct_influence
from ._influence import machine_influence as machine_influence
from ._influence import select as select
from ._influence import trial_influence as trial_influence
from ._influence import with_weights as with_weights
from ._least_squares import bounded as bounded
from ._least_squares import least_squares as least_squares
from ._least_squares import predicted as predicted
from ._least_squares import quadratic as quadratic
from ._objectives import least_masses as least_masses
from ._objectives import min_max as min_max
from ._weight_places import Places as Places
from ._weight_places import placed as placed
