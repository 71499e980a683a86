"""Crank mechanisms: kinematics, reduced inertia and the balances that give joint forces."""

from ._base import AbstractKinematics as AbstractKinematics
from ._base import AbstractMechanism as AbstractMechanism
from ._base import CrankState as CrankState
from ._base import Vector as Vector
from ._base import cross as cross
from ._base import rotating as rotating
from ._base import turned_with as turned_with
from ._slider_crank import PinForces as PinForces
from ._slider_crank import RodBalance as RodBalance
from ._slider_crank import RodMotion as RodMotion
from ._slider_crank import SliderCrank as SliderCrank
from ._slider_crank import pin_forces as pin_forces
from ._slider_crank import rod_balance as rod_balance
from ._slider_crank import rod_moment as rod_moment
from ._slider_crank import rod_motion as rod_motion
from ._slider_link import Contact as Contact
from ._slider_link import ContactArms as ContactArms
from ._slider_link import LinkMotion as LinkMotion
from ._slider_link import PistonLoads as PistonLoads
from ._slider_link import SliderLink as SliderLink
from ._slider_link import contact as contact
from ._slider_link import contact_arms as contact_arms
