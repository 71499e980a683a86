"""Friction: the laws of single joints, and the joint loops that they couple."""

from ..film import AbstractJournal as AbstractJournal
from . import _slider_crank_joints as _slider_crank_joints
from . import _slider_link_joints as _slider_link_joints
from ._joint_laws import AbstractSlide as AbstractSlide
from ._joint_loads import AbstractFriction as AbstractFriction
from ._joint_loads import AbstractJointLoop as AbstractJointLoop
from ._joint_loads import Balance as Balance
from ._joint_loads import JointLoads as JointLoads
from ._joint_loads import Marks as Marks
from ._joint_loads import joint_loop as joint_loop
from ._slider_crank_joints import SliderCrankFriction as SliderCrankFriction
from ._slider_link_joints import SliderLinkFriction as SliderLinkFriction
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
