"""A pressure that is given by its harmonics."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import ANY, NONNEGATIVE, quantity
from ._diagram import AbstractDiagram, check_same_length


class FourierDiagram(AbstractDiagram):
    r"""Pressure over crank angle by its harmonics.

    $$p = a_0 + \sum_k a_k\cos k\theta + b_k\sin k\theta$$

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        mean: [Pa] a_0, absolute.
        cosine: [Pa] (k,) a_1, a_2, ...
        sine: [Pa] (k,) b_1, b_2, ...
    """

    kind: ClassVar[str] = "fourier"

    mean: Float[Array, ""] = quantity("Pa", ANY, doc="a_0")
    cosine: Float[Array, " n"] = quantity("Pa", ANY, shape=(None,), doc="a_1, a_2, ...")
    sine: Float[Array, " n"] = quantity("Pa", ANY, shape=(None,), doc="b_1, b_2, ...")
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def __check_init__(self):
        check_same_length(self, "cosine", "sine")

    def pressure(self, stroke):
        order = jnp.arange(1, self.cosine.size + 1)
        phase = stroke.angle[..., None] * order
        return self.mean + jnp.cos(phase) @ self.cosine + jnp.sin(phase) @ self.sine
