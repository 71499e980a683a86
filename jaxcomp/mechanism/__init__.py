"""Crank mechanisms: kinematics, reduced inertia and the balances that give joint forces."""

from ._base import AbstractKinematics as AbstractKinematics
from ._base import AbstractMechanism as AbstractMechanism
from ._base import CrankState as CrankState
from ._base import Vector as Vector
from ._base import rotating as rotating
from ._slider_crank import SliderCrank as SliderCrank
from ._slider_crank import rod_motion as rod_motion
from ._slider_link import LinkMotion as LinkMotion
from ._slider_link import SliderLink as SliderLink
from ._slider_link import contact as contact
