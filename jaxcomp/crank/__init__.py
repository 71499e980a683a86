"""Crank motion: the equation of motion, the periodic orbit, transients and energy."""

from ._collocation import Collocation as Collocation
from ._films import film_thickness as film_thickness
from ._films import journal_rates as journal_rates
from ._motion import acceleration as acceleration
from ._orbit import Energy as Energy
from ._orbit import Orbit as Orbit
from ._orbit import Verification as Verification
from ._orbit import rod_load_reversal as rod_load_reversal
from ._orbit import time_harmonics as time_harmonics
from ._panels import panels as panels
from ._performance import POWER as POWER
from ._performance import Performance as Performance
from ._performance import performance as performance
from ._result import orbit_on_panels as orbit_on_panels
from ._shooting import Shooting as Shooting
from ._solve import solve_orbit as solve_orbit
from ._torsion import CrankTrain as CrankTrain
from ._torsion import TorsionalChain as TorsionalChain
from ._torsion import TrainTorques as TrainTorques
from ._torsion import throw_inertias as throw_inertias
from ._torsion import throw_torques as throw_torques
from ._torsion import train_over_speed as train_over_speed
from ._torsion import train_torques as train_torques
from ._transient import TimeIntegration as TimeIntegration
from ._transient import Transient as Transient
from ._transient import simulate as simulate
