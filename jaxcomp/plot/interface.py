"""What packages that are built on this one take from it, and users need not."""

from ._animate import front_view as front_view
from ._animate import line_look as line_look
from ._fine import fine_turn as fine_turn
from ._fine import first_diagram as first_diagram
from ._style import INK as INK
from ._style import colour as colour
from ._style import words as words
