"""Crank mechanisms: kinematics, reduced inertia and the balances that give joint forces."""

from ._base import AbstractMechanism as AbstractMechanism
from ._base import CrankState as CrankState
from ._slider_crank import PinForces as PinForces
from ._slider_crank import RodBalance as RodBalance
from ._slider_crank import RodMotion as RodMotion
from ._slider_crank import SliderCrank as SliderCrank
from ._slider_crank import pin_forces as pin_forces
from ._slider_crank import rod_balance as rod_balance
from ._slider_crank import rod_moment as rod_moment
from ._slider_crank import rod_motion as rod_motion
