"""Crank mechanisms: kinematics, reduced inertia and the balances that give joint forces."""

from ._mechanism import AbstractKinematics as AbstractKinematics
from ._mechanism import AbstractMechanism as AbstractMechanism
from ._mechanism import CrankState as CrankState
from ._mechanism import Vector as Vector
from ._mechanism import rotating as rotating
from ._slider_crank import SliderCrank as SliderCrank
from ._slider_crank import rod_motion as rod_motion
from ._slider_link import LinkMotion as LinkMotion
from ._slider_link import SliderLink as SliderLink
from ._slider_link import contact as contact
