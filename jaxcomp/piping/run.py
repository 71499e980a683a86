r"""Straight pieces between bends, which waves push along.

At its bends the gas pushes a piece outwards. Along it, from the first node to the second, that is

$$F_n = A\,(p_b - p_a)_n,$$

without friction minus the rate of the gas's momentum, $-i n\Omega\int\dot m_n\,dx$.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, Part, is_traced, quantity
from ._network_nodes import check_nodes


class Run(Part):
    """A straight piece between two bends, on which the pressure acts.

    Args:
        nodes: names of both ends, of one pipe or of a chain of equal ones.
        direction: [-] (3,) from its first node to its second, in the frame of the machine; along z if
            absent.

    Raises:
        BadInput: not two different nodes, or a direction without length.
    """

    kind: ClassVar[str] = "run"

    nodes: tuple[str, ...] = eqx.field(static=True)
    direction: Float[Array, "3"] | None = quantity("", ANY, shape=(3,), default=None)

    def __check_init__(self):
        check_nodes(self.nodes, pair=True)
        check_direction(self.direction)

    @property
    def ends(self) -> tuple[str, ...]:
        """Names of the nodes at its bends."""
        return self.nodes


def check_direction(direction: Float[Array, "3"] | None) -> None:
    """Refuse a direction without length.

    Args:
        direction: [-] (3,) or none.

    Raises:
        BadInput: of a direction of zeros.
    """
    if direction is None or is_traced(direction):
        return
    if not bool(jnp.any(direction != 0)):
        raise BadInput("direction", direction, "not of length 0")


def unit_direction(direction: Float[Array, "3"] | None) -> Float[Array, "3"]:
    """Direction of length one; along z where none is given."""
    if direction is None:
        return jnp.array([0.0, 0.0, 1.0])
    return direction / jnp.linalg.norm(direction)
