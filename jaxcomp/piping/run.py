"""Straight pieces between bends, which waves push along."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, Part, is_traced, quantity


class Run(Part):
    r"""A straight piece between two bends, on whose ends the pressure acts: $F_n = A(p_a - p_b)_n$.

    Args:
        nodes: names of both ends, of one pipe or of a chain of equal ones.
        direction: [-] (3,) of the force, in the frame of the machine; along z if absent.

    Raises:
        BadInput: not two different nodes, or a direction without length.
    """

    kind: ClassVar[str] = "run"

    nodes: tuple[str, ...] = eqx.field(static=True)
    direction: Float[Array, "3"] | None = quantity("", ANY, shape=(3,), default=None)

    def __check_init__(self):
        if len(self.nodes) != 2 or self.nodes[0] == self.nodes[1]:
            raise BadInput("nodes", str(list(self.nodes)), "two different names")
        if self.direction is None or is_traced(self.direction):
            return
        if not bool(jnp.any(self.direction != 0)):
            raise BadInput("direction", self.direction, "not of length 0")
