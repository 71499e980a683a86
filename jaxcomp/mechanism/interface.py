"""What packages that are built on this one take from it, and users need not."""

from ._base import cross as cross
from ._base import turned_with as turned_with
from ._slider_crank import PinForces as PinForces
from ._slider_crank import RodBalance as RodBalance
from ._slider_crank import RodMotion as RodMotion
from ._slider_crank import pin_forces as pin_forces
from ._slider_crank import rod_balance as rod_balance
from ._slider_crank import rod_moment as rod_moment
from ._slider_link import Contact as Contact
from ._slider_link import ContactArms as ContactArms
from ._slider_link import PistonLoads as PistonLoads
from ._slider_link import contact_arms as contact_arms
