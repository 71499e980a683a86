"""A pressure that any function of the stroke gives."""

from collections.abc import Callable

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, quantity
from ._diagram import AbstractDiagram
from ._gas_law import Stroke


class CallableDiagram(AbstractDiagram):
    """Any function of the stroke; an `equinox.Module` with a `__call__` keeps its own parameters.

    Args:
        function: takes a `Stroke`, returns the cylinder pressure [Pa] in the shape of its angle.
        back_pressure: [Pa] behind the piston.
    """

    function: Callable[[Stroke], Float[Array, "*n"]]
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def pressure(self, stroke):
        return self.function(stroke)
