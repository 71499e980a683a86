r"""A plate with a hole, or another resistance, between two nodes.

$$\Delta p = K\,\dot m|\dot m|,\quad K = \frac{\zeta}{2\rho A^2}$$

with the loss coefficient of a sharp edge (Idelchik 1986, Handbook of Hydraulic Resistance, diagram 4-14)
over the dynamic pressure in the hole of area $A$ in a pipe of area $A/\beta^2$,
$\zeta = (1 - \beta^2 + 0.707\sqrt{1-\beta^2})^2$; or $\Delta p = R\,\dot m$.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import clip
from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from ._network_nodes import check_nodes


class Orifice(Part):
    """A resistance between two nodes.

    Args:
        nodes: names of its two sides.
        diameter: [m] of the hole; with `loss_coefficient` of the section that it counts in.
        loss_coefficient: [-] pressure loss over the dynamic pressure at `diameter`; that of a sharp hole
            in the widest pipe at its nodes if absent.
        resistance: [Pa s/kg] of a loss proportional to the flow, instead of both.

    Raises:
        BadInput: not two different nodes, or neither or both of diameter and resistance.
    """

    kind: ClassVar[str] = "orifice"

    nodes: tuple[str, ...] = eqx.field(static=True)
    diameter: Float[Array, ""] | None = quantity(
        "m", POSITIVE, default=None, doc="of the hole", usual=(1e-3, 1.0)
    )
    loss_coefficient: Float[Array, ""] | None = quantity(
        "", NONNEGATIVE, default=None, doc="over the dynamic pressure at `diameter`"
    )
    resistance: Float[Array, ""] | None = quantity(
        "Pa s/kg", NONNEGATIVE, default=None, doc="of a loss proportional to the flow"
    )

    def __check_init__(self):
        check_nodes(self.nodes, pair=True)
        if (self.diameter is None) == (self.resistance is None):
            value = "neither" if self.diameter is None else "both"
            raise BadInput("diameter", value, "given, or `resistance` in its place: one of them")
        if self.resistance is not None and self.loss_coefficient is not None:
            bound = "absent beside `resistance`, which it would multiply"
            raise BadInput("loss_coefficient", self.loss_coefficient, bound)

    @property
    def is_linear(self) -> bool:
        """Whether the loss is proportional to the flow."""
        return self.resistance is not None

    def coefficient(
        self, density: Float[Array, ""], pipe_diameter: Float[Array, ""]
    ) -> Float[Array, ""]:
        """K [Pa s^2/kg^2] of the loss over the square of the flow.

        Args:
            density: [kg/m^3] of the gas.
            pipe_diameter: [m] of the widest pipe at its nodes.
        """
        area = np.pi / 4 * self.diameter**2
        loss = self.loss_coefficient
        if loss is None:
            # short of one, where the slope of the root is infinite
            share = clip((self.diameter / pipe_diameter) ** 2, 0.0, 1.0 - 1e-9)
            loss = (1 - share + 0.707 * jnp.sqrt(1 - share)) ** 2
        return loss / (2 * density * area**2)
