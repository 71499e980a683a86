from ._state import Desk as Desk
from ._state import View as View
