r"""A vessel with a length, which waves run along and push to and fro.

A wide pipe with end plates. Along it, from its first node to its last, the gas pushes it with

$$F_n = A\,(p_b - p_a)_n,$$

minus the rate of the gas's momentum in it, as for a run of pipe: so the forces of vessels and runs that
lie behind each other add up to that on all of them. Where a pipe opens into a plate, the plate lacks its
area, and that pipe the push at its end: in the sum both are right. A pipe at a node between the ends
comes from the side.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, NONNEGATIVE, Bound, Part, is_traced, quantity, spread_columns
from ._network_nodes import check_nodes
from .run import check_direction


class Vessel(Part):
    """A bottle whose length counts: a wide pipe with end plates, and the force along it.

    Args:
        nodes: names of its ends, and of the places between where pipes come from the side.
        length: [m] from each node to the next.
        diameter: [m] inside.
        attenuation: [1/m] of waves, instead of the losses of the wall.
        direction: [-] (3,) from its first node to its last, in the frame of the machine; along z if
            absent.

    Raises:
        BadInput: fewer than two nodes, a node twice, lengths that are not one for each gap between nodes,
            more than one diameter, or a direction without length.
    """

    kind: ClassVar[str] = "vessel"
    # the waves' part of its friction is that of a smooth wall
    roughness: ClassVar[None] = None

    nodes: tuple[str, ...] = eqx.field(static=True)
    length: Float[Array, " p"] = quantity(
        "m",
        Bound(0.0, 1e3, low_open=True),
        shape=(None,),
        spread=True,
        doc="from each node to the next",
        usual=(0.02, 10.0),
    )
    diameter: Float[Array, " p"] = quantity(
        "m", Bound(1e-3, 5.0), shape=(None,), spread=True, doc="inside", usual=(0.01, 3.0)
    )
    attenuation: Float[Array, " p"] | None = quantity(
        "1/m",
        NONNEGATIVE,
        shape=(None,),
        spread=True,
        default=None,
        doc="of waves, instead of the losses of the wall",
    )
    direction: Float[Array, "3"] | None = quantity("", ANY, shape=(3,), default=None)

    def __post_init__(self):
        check_nodes(self.nodes)
        spread_columns(self, len(self.nodes) - 1, "gaps between nodes")

    def __check_init__(self):
        check_direction(self.direction)
        if not is_traced(self.diameter) and bool(jnp.any(self.diameter != self.diameter[0])):
            bound = "one diameter: a vessel in steps is several"
            raise BadInput("diameter", self.diameter, bound)

    @property
    def ends(self) -> tuple[str, str]:
        """Names of the nodes at its plates."""
        return self.nodes[0], self.nodes[-1]
