"""Friction: the laws of single joints, and the joint loops that they couple."""

from . import _slider_crank as _slider_crank
from . import _slider_link as _slider_link
from ._drag import AbstractDrag as AbstractDrag
from ._drag import OilPump as OilPump
from ._drag import ThrustBearing as ThrustBearing
from ._laws import AbstractJournal as AbstractJournal
from ._laws import AbstractSlide as AbstractSlide
from ._laws import CoulombJournal as CoulombJournal
from ._laws import CoulombSlide as CoulombSlide
from ._laws import PistonFilm as PistonFilm
from ._laws import RegularisedJournal as RegularisedJournal
from ._laws import RegularisedSlide as RegularisedSlide
from ._loads import AbstractJointLoop as AbstractJointLoop
from ._loads import JointLoads as JointLoads
from ._loads import closed as closed
from ._loads import joint_loads as joint_loads
from ._loads import joint_loop as joint_loop
from ._loads import magnitude as magnitude
from ._loads import newton_step as newton_step
from ._several import several_loops as several_loops
from ._slider_crank import SliderCrankFriction as SliderCrankFriction
from ._slider_link import SliderLinkFriction as SliderLinkFriction
from ._slider_link import substitution as substitution
from ._support import MainBearings as MainBearings
from ._support import film_journals as film_journals
from ._support import shares as shares
