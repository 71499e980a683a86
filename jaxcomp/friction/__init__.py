"""Friction: the laws of single joints, and the joint loops that they couple."""

from . import _slider_crank as _slider_crank
from . import _slider_link as _slider_link
from ._laws import AbstractJournal as AbstractJournal
from ._laws import AbstractSlide as AbstractSlide
from ._laws import CoulombJournal as CoulombJournal
from ._laws import CoulombSlide as CoulombSlide
from ._laws import OilPump as OilPump
from ._laws import Packing as Packing
from ._laws import PistonFilm as PistonFilm
from ._laws import RegularisedJournal as RegularisedJournal
from ._laws import RegularisedSlide as RegularisedSlide
from ._laws import ThrustBearing as ThrustBearing
from ._loads import AbstractFriction as AbstractFriction
from ._loads import AbstractJointLoop as AbstractJointLoop
from ._loads import Balance as Balance
from ._loads import JointLoads as JointLoads
from ._loads import Marks as Marks
from ._loads import joint_loop as joint_loop
from ._mixed import MixedSlide as MixedSlide
from ._mixed import MixedThrust as MixedThrust
from ._slider_crank import SliderCrankFriction as SliderCrankFriction
from ._slider_link import SliderLinkFriction as SliderLinkFriction
