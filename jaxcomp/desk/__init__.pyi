from ._page import page as page
from ._page import serve as serve
from ._state import Desk as Desk
from ._state import View as View
