"""Friction: the laws of single joints, and the joint loops that they couple."""

from ..film import AbstractJournal as AbstractJournal
from . import _slider_crank as _slider_crank
from . import _slider_link as _slider_link
from ._base import AbstractSlide as AbstractSlide
from ._loads import AbstractFriction as AbstractFriction
from ._loads import AbstractJointLoop as AbstractJointLoop
from ._loads import Balance as Balance
from ._loads import JointLoads as JointLoads
from ._loads import Marks as Marks
from ._loads import joint_loop as joint_loop
from ._slider_crank import SliderCrankFriction as SliderCrankFriction
from ._slider_link import SliderLinkFriction as SliderLinkFriction
from .coulomb import CoulombJournal as CoulombJournal
from .coulomb import CoulombSlide as CoulombSlide
from .mixed_slide import MixedSlide as MixedSlide
from .mixed_thrust import MixedThrust as MixedThrust
from .oil_pump import OilPump as OilPump
from .packing import Packing as Packing
from .piston_film import PistonFilm as PistonFilm
from .regularised import RegularisedJournal as RegularisedJournal
from .regularised import RegularisedSlide as RegularisedSlide
from .thrust_bearing import ThrustBearing as ThrustBearing
